"""Courses of picks for robots that are not as described: the true centre of mass where the plan has it over the feet.

A book's plan balances the robot of the description. One whose torso weighs otherwise, or elsewhere, stands on it with
one leg loaded and one knee giving way. Here each course is changed for the robot that plays it: the pelvis moves until
the true centre of mass is where the plan's would be, feet and hands staying where they are, and the torques that hold
it are those of the true masses. Only teachers know them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.picks.book import BOOK_PHASES, PickBook
from hotice.sim.pickup.standing import Standing

Array = NDArray[np.float64]
EVERY = 10
"""Steps between the poses that are solved; between them the change is linear."""


@dataclass(frozen=True, kw_only=True)
class Course:
    """What holds one robot along one pick: joint_pos, torque (K, 20) [rad], [N m]; pelvis (K, 2) in G [m]."""

    joint_pos: Array
    torque: Array
    pelvis: Array


def true_course(book: PickBook, row: int, described: mujoco.MjModel, true: mujoco.MjModel) -> Course:
    """The course of a robot with the masses of `true` for pick `row`, planned for those of `described`.

    From the plan's at the start to the whole change at the end of the crouch.
    """
    kp, _ = g1.gains()
    joints = np.asarray(book.joint_pos[row], float)
    torque = (np.asarray(book.target[row], float) - joints) * kp
    pelvis = np.asarray(book.pelvis[row], float)[:, :2]
    phase = np.asarray(book.phase)
    load = _load(phase) * float(book.mass[row])
    last = len(phase) - 1
    ramp = _ramp(phase)
    plan, robot = Standing(described, book, row), Standing(true, book, row)
    at = np.unique(np.append(np.arange(0, last, EVERY), last))
    change = {name: np.zeros((len(at), n)) for name, n in (("q", g1.ACTIONS), ("torque", g1.ACTIONS), ("p", 2))}
    for i, k in enumerate(at):
        kg = float(load[k])
        plan.stand(joints[k])
        meant, needed = plan.com(kg)[:2], plan.static(kg)
        before = plan.data.qpos[:2].copy()
        robot.data.qpos[:] = plan.data.qpos
        robot.forward()
        goal = meant + (1.0 - ramp[k]) * (robot.com(kg)[:2] - meant)
        robot.lean(goal, kg)
        change["q"][i] = robot.data.qpos[g1.JOINT_POS] - joints[k]
        change["torque"][i] = (robot.static(kg) - needed)[6:]
        change["p"][i] = robot.data.qpos[:2] - before
    steps = np.arange(last + 1)
    whole = {n: np.stack([np.interp(steps, at, c) for c in v.T], axis=1) for n, v in change.items()}
    return Course(joint_pos=joints + whole["q"], torque=torque + whole["torque"], pelvis=pelvis + whole["p"])


def _load(phase: NDArray[np.int64]) -> Array:
    """Share of the object's weight that the hands carry at each step, (K,)."""
    squeeze, lift = BOOK_PHASES.index("squeeze"), BOOK_PHASES.index("lift")
    share = (phase >= lift).astype(float)
    rows = np.flatnonzero(phase == squeeze)
    share[rows] = np.clip(2.0 * np.arange(1, len(rows) + 1) / max(len(rows), 1) - 1.0, 0.0, 1.0)
    return share


def _ramp(phase: NDArray[np.int64]) -> Array:
    """Share of the change that is made at each step, (K,): all of it from the end of the crouch on."""
    count = int((phase <= BOOK_PHASES.index("crouch")).sum())
    s = np.clip(np.arange(1, len(phase) + 1) / max(count, 1), 0.0, 1.0)
    return s * s * (3.0 - 2.0 * s)
