"""A robot that stands on both feet: where its mass is, what holds it, and how it leans without moving feet or hands."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1
from hotice.model.frames import GRAVITY
from hotice.model.picks.book import PickBook

Array = NDArray[np.float64]
SUPPORT = "support"
"""Obstacle on which the object stands."""
SOLVES = 4
CLEAR_M = 0.06
"""Between legs and support, where the plan comes closer."""
KNEE_RAD = 0.05
"""Knees are bent at least so much, where the plan's are: straight ones cannot move the pelvis."""


@dataclass(frozen=True, kw_only=True)
class Weights:
    """Of the least squares, by what is to stay or to be reached; metres and radians alike."""

    feet: float = 100.0
    com: float = 100.0
    hands: float = 30.0
    palms: float = 1.0
    clear: float = 10.0
    pelvis: float = 0.1
    """Its turn."""
    height: float = 3.0
    joints: float = 0.3


WEIGHTS = Weights()


class Wishes:
    """Rows of a least squares problem of the 26 velocities, each `weight` (jac v - error)."""

    def __init__(self) -> None:
        self._rows: list[Array] = []
        self._errors: list[Array] = []

    def add(self, weight: float, jac: Array, error: Array) -> None:
        """jac: (n, 26). error: (n,) what is to change."""
        self._rows.append(weight * jac)
        self._errors.append(weight * error)

    def step(self, low: Array, high: Array) -> Array:
        """The best step (26,) whose joints, the last 20, stay within `low` and `high`, (20,) each.

        Those that would leave are held at their bound.
        """
        A, b = np.concatenate(self._rows), np.concatenate(self._errors)
        fixed, step = np.zeros(26, dtype=bool), np.zeros(26)
        for _ in range(4):
            free = ~fixed
            step[free] = np.linalg.lstsq(A[:, free], b - A[:, fixed] @ step[fixed], rcond=None)[0]
            out = np.zeros(26, dtype=bool)
            out[6:] = (step[6:] < low - 1e-9) | (step[6:] > high + 1e-9)
            step[6:] = np.clip(step[6:], low, high)
            if not (out & free).any():
                break
            fixed |= out
        return step


class Standing:
    """One robot that stands on both feet, heading along x."""

    def __init__(self, model: mujoco.MjModel, book: PickBook, row: int) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        self.pelvis = model.body("pelvis").id
        self.feet = [model.body(f"{side}_ankle_roll_link").id for side in g1.SIDES]
        legs = [model.body(f"{side}_{link}").id for side in g1.SIDES for link in ("hip_yaw_link", "knee_link")]
        solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
        self.legs = [g for g in range(model.ngeom) if model.geom_bodyid[g] in legs and solid[g]]
        self.support = model.geom(f"{builder.OBSTACLE_PREFIX}{SUPPORT}").id
        self.hands = [model.site(f"{side}_hand").id for side in g1.SIDES]
        self.mass = float(model.body_subtreemass[self.pelvis])
        self.data.qpos[:] = book.qpos(row)
        mujoco.mj_kinematics(model, self.data)
        self.at = self.data.xpos[self.feet[0]].copy()
        self.turn = self.data.xmat[self.feet[0]].reshape(3, 3).copy()
        nv = model.nv
        self.low, self.high = model.jnt_range[1 : 1 + g1.ACTIONS].T.copy()
        for side in g1.SIDES:
            self.low[g1.ACTION_JOINTS.index(f"{side}_knee_joint")] = KNEE_RAD
        self._jac = np.zeros((3, nv)), np.zeros((3, nv))

    def forward(self) -> None:
        """Places and centres of mass for the configuration in `data`."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)

    def stand(self, joint_pos: Array) -> None:
        """Puts the left foot where it stood at the start."""
        d = self.data
        d.qpos[:3], d.qpos[3:7], d.qpos[g1.JOINT_POS] = 0.0, [1.0, 0.0, 0.0, 0.0], joint_pos
        mujoco.mj_kinematics(self.model, d)
        R = self.turn @ d.xmat[self.feet[0]].reshape(3, 3).T
        d.qpos[:3] = self.at - R @ d.xpos[self.feet[0]]
        mujoco.mju_mat2Quat(d.qpos[3:7], R.ravel())
        self.forward()

    def near_support(self) -> list[tuple[float, Array, Array, int]]:
        """Legs nearer to the support than `CLEAR_M`: distance [m], nearest point (3,), way off (3,), and body."""
        found, ends = [], np.zeros(6)
        for geom in self.legs:
            gap = mujoco.mj_geomDistance(self.model, self.data, geom, self.support, CLEAR_M, ends)
            if gap < CLEAR_M and abs(gap) > 1e-9:
                found.append((gap, ends[:3].copy(), (ends[:3] - ends[3:]) / gap, int(self.model.geom_bodyid[geom])))
        return found

    def held(self) -> Array:
        """Where the load hangs, (3,): between the hands."""
        return self.data.site_xpos[self.hands].mean(axis=0)

    def com(self, load_kg: float) -> Array:
        """Of robot and load, (3,)."""
        own = self.data.subtree_com[self.pelvis]
        return (self.mass * own + load_kg * self.held()) / (self.mass + load_kg)

    def jacobian(self, body: int, point: Array) -> tuple[Array, Array]:
        """Of a point of a body: (3, 26) of its place and of the body's turn."""
        mujoco.mj_jac(self.model, self.data, *self._jac, point, body)
        return self._jac[0][:, :26].copy(), self._jac[1][:, :26].copy()

    def lean(self, goal: Array, load_kg: float) -> None:
        """Moves the pelvis until the centre of mass is over `goal` (2,), feet and hands staying where they are."""
        d, w = self.data, WEIGHTS
        hand_bodies = [int(self.model.site_bodyid[i]) for i in self.hands]
        start = [d.site_xpos[i].copy() for i in self.hands]
        feet = [(d.xpos[i].copy(), d.xmat[i].reshape(3, 3).copy()) for i in self.feet]
        palms = [d.xmat[i].reshape(3, 3).copy() for i in hand_bodies]
        height, turn = float(d.qpos[2]), d.xmat[self.pelvis].reshape(3, 3).copy()
        own = np.zeros((3, self.model.nv))
        # a plan may be past the bounds by itself
        low = np.minimum(self.low, d.qpos[g1.JOINT_POS])
        high = np.maximum(self.high, d.qpos[g1.JOINT_POS])
        for _ in range(SOLVES):
            wishes = Wishes()
            ask = wishes.add
            for body, (p, R) in zip(self.feet, feet, strict=True):
                place, spin = self.jacobian(body, d.xpos[body])
                ask(w.feet, place, p - d.xpos[body])
                ask(w.feet, spin, _turn(R, d.xmat[body]))
            held = np.zeros((3, 26))
            for site, body, p, R in zip(self.hands, hand_bodies, start, palms, strict=True):
                place, spin = self.jacobian(body, d.site_xpos[site])
                held += 0.5 * place
                ask(w.hands, place, p - d.site_xpos[site])
                ask(w.palms, spin, _turn(R, d.xmat[body]))
            mujoco.mj_jacSubtreeCom(self.model, d, own, self.pelvis)
            com = (self.mass * own[:, :26] + load_kg * held) / (self.mass + load_kg)
            ask(w.com, com[:2], goal - self.com(load_kg)[:2])
            _, spin = self.jacobian(self.pelvis, d.xpos[self.pelvis])
            ask(w.pelvis, spin, _turn(turn, d.xmat[self.pelvis]))
            ask(w.height, np.eye(26)[2:3], np.array([height - d.qpos[2]]))
            for gap, point, away, body in self.near_support():
                place, _ = self.jacobian(body, point)
                ask(w.clear, away[None] @ place, np.array([CLEAR_M - gap]))
            ask(w.joints, np.eye(26)[6:], np.zeros(g1.ACTIONS))
            step = np.zeros(self.model.nv)
            q = d.qpos[g1.JOINT_POS]
            step[:26] = wishes.step(low - q, high - q)
            mujoco.mj_integratePos(self.model, d.qpos, step, 1.0)
            self.forward()

    def static(self, load_kg: float) -> Array:
        """Forces (26,) that hold the robot at rest, but for what its palms press [N, N m].

        The joints' are the last 20; those of the pelvis, the first 6, are nothing but rounding. Feet push as in
        `hotice.control.playback.statics`.
        """
        d, m = self.data, self.model
        d.qvel[:] = 0.0
        mujoco.mj_fwdPosition(m, d)
        mujoco.mj_fwdVelocity(m, d)
        torque = d.qfrc_bias[:26].copy()
        held, com, mass = self.held(), self.com(load_kg), self.mass + load_kg
        for site in self.hands:
            place, _ = self.jacobian(int(m.site_bodyid[site]), held)
            torque += 0.5 * load_kg * GRAVITY * place[2]
        left, right = (d.xpos[i][1] for i in self.feet)
        share = (com[1] - right) / (left - right)
        for body, part in zip(self.feet, (share, 1.0 - share), strict=True):
            place, _ = self.jacobian(body, np.array([com[0], d.xpos[body][1], 0.0]))
            torque -= part * mass * GRAVITY * place[2]
        return torque


def _turn(wanted: Array, now: Array) -> Array:
    """Rotation vector from `now` (9,) to `wanted` (3, 3), small, (3,) [rad]."""
    R = wanted @ now.reshape(3, 3).T
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
