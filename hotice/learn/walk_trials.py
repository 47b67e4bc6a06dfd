"""Trials of the walking baseline (`hotice.control.walk`), scored as policies are: same objects, starts, geometry and rules.

The baseline is driven by torques and planned anew for each trial, so trials run one after another, not as a batch. Results are
rounded: in the last bits the sums of its QP solver depend on where their memory lies, 1e-14 N m of the first torques.
"""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from hotice.errors import CarryInfeasible, UnreachableGoal
from hotice.fields.hod_pf import HodPf, build_hod_pf
from hotice.learn.report import PAPER_S
from hotice.learn.trials import Trials
from hotice.model import builder, g1
from hotice.sim.mujoco_batch import unlogged
from hotice.sim.terminations import APART_M, FALLEN_M, LOW_M, UPRIGHT

if TYPE_CHECKING:
    from hotice.control.plant import TorquePlant
    from hotice.control.walk import WalkConfig
    from hotice.model.carry import CarryState
    from hotice.model.scene import Scene
    from hotice.sim.env import TransportEnv

GOAL_M = 0.1
FASTEST = 1e3
"""Of any velocity: what is faster has diverged."""


@dataclass(frozen=True)
class Trial:
    """Outcome, its time [s], root to goal then and at 5 s [m], faults and step time of the controller, planned clearance [m]."""

    outcome: str
    time_s: float
    distance_m: float
    distance_5s_m: float
    faults: int
    step_ms: float
    clearance_m: float

    def at(self, horizon_s: float) -> tuple[str, float, float]:
        """Outcome, distance and time had the trial ended at `horizon_s`."""
        if self.time_s <= horizon_s:
            return self.outcome, self.distance_m, self.time_s
        return "timeout", self.distance_5s_m, horizon_s


def score_walks(
    config: WalkConfig, env: TransportEnv, *, first: int = 0, on_trials: Callable[[int], None] | None = None
) -> Trials:
    """A walk from the start of each trial of `env`, which has been reset and stays as it is.

    Of the environment come scene, objects, starts, physics step, friction cones, time limit and how often a trial is looked
    at. Trials are numbered from `first`; every other one starts with the right foot. `on_trials(1)` is called after each.
    """
    from hotice.control.plant import TorquePlant

    (scene,), task = env.bank.scenes, env.config
    pf = _fields(scene, task.resolution_m, task.margin_m)
    trials = []
    for row, which in enumerate(env.memory.model.tolist()):
        model = copy.copy(env.carry.models[which])
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
        plant = TorquePlant(model)
        with unlogged():
            plant.reset(env.physics.qpos[row].numpy())
            trial = run_trial(
                plant, scene, pf, env.carry.states[which], config, task.max_steps * task.control_dt_s,
                first_foot=(first + row) % 2, look_s=task.control_dt_s,
            )  # fmt: skip
        trials.append(trial)
        if on_trials:
            on_trials(1)
    return Trials(
        outcome=tuple(t.outcome for t in trials), distance_m=tuple(round(t.distance_m, 6) for t in trials),
        time_s=tuple(round(t.time_s, 6) for t in trials),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _fields(scene: Scene, resolution_m: float, margin_m: float) -> HodPf:
    """Fields of one scene, kept for its next block."""
    return build_hod_pf(scene, resolution_m, margin_m)


def run_trial(
    plant: TorquePlant, scene: Scene, pf: HodPf, state: CarryState, config: WalkConfig, horizon_s: float, *,
    first_foot: int = 0, stay_s: float = 0.0, look_s: float = 0.0, log: list | None = None,
) -> Trial:  # fmt: skip
    """One trial; it ends at success (after `stay_s` more without failure), failure or the horizon.

    Args:
        plant: robot, object and obstacles at the start. pf: fields of the scene. state: the grasp.
        first_foot: which foot steps first, 0 left, 1 right.
        look_s: how often the trial is looked at [s], at most once a control step; contacts count in every physics step.
        log: collects time, qpos and memory of the controller after each control step.

    The outcome is `no_plan`, at once, where no footholds lead to the goal or the arms cannot keep the load level.
    """
    from hotice.control.walk import WalkController, plan_walk

    goal = np.array(scene.goal[:2])
    measurement = plant.measure()
    distance = distance_5s = float(np.linalg.norm(measurement.p_WP[:2] - goal))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            plan = plan_walk(pf, state, ankles(plant), config, first_foot=first_foot)
    except (UnreachableGoal, CarryInfeasible):
        return Trial("no_plan", 0.0, distance, distance, 0, 0.0, 0.0)
    controller = WalkController(plan, state, config)
    memory = controller.start(measurement)
    hands = [plant.model.site(f"{s}_hand").id for s in g1.SIDES]
    dt = plant.model.opt.timestep
    substeps = round(1.0 / controller.rate_hz / dt)
    every = max(1, round(look_s / (substeps * dt)))
    spent, count, faults, reached_s, outcome = 0.0, 0, 0, np.inf, "timeout"
    hits, touched = has_hits(plant), None
    while plant.data.time < horizon_s - 1e-9:
        measurement = plant.measure()
        begin = time.perf_counter()
        command, memory = controller.step(memory, measurement)
        spent, count, faults = spent + time.perf_counter() - begin, count + 1, command.faults
        for _ in range(substeps):
            plant.step(command.torque)
            touched = touched or (hits() if hits else None)
        if log is not None:
            log.append((plant.data.time, plant.data.qpos.copy(), memory))
        if count % every:
            continue
        root = plant.data.qpos[:3]
        if not np.isfinite(reached_s):
            distance = float(np.linalg.norm(root[:2] - goal))
        if plant.data.time <= PAPER_S + 1e-9:
            distance_5s = float(np.linalg.norm(root[:2] - goal))
        if hits and not touched and (distance < GOAL_M or plant.data.time >= horizon_s - 1e-9):
            mujoco.mj_forward(plant.model, plant.data)  # sensors are a step late: the trial ends with its last state
            touched = hits()
        failed = failure(plant, hands) or touched
        if failed:
            return Trial(
                failed, plant.data.time, distance, distance_5s, faults, 1e3 * spent / count, plan.profile.clearance_m
            )
        if not np.isfinite(reached_s) and distance < GOAL_M:
            reached_s, outcome = plant.data.time, "success"
        if plant.data.time >= reached_s + stay_s:
            break
    end = reached_s if np.isfinite(reached_s) else plant.data.time
    return Trial(outcome, end, distance, distance_5s, faults, 1e3 * spent / count, plan.profile.clearance_m)


def ankles(plant: TorquePlant) -> tuple[float, float, float]:
    """Middle between the ankles, x, y [m], and heading of the pelvis [rad]."""
    feet = [plant.data.body(f"{s}_ankle_roll_link").xpos[:2] for s in g1.SIDES]
    R = plant.data.body("pelvis").xmat.reshape(3, 3)
    x, y = np.mean(feet, axis=0)
    return float(x), float(y), float(np.arctan2(R[1, 0], R[0, 0]))


def failure(plant: TorquePlant, hands: list[int]) -> str | None:
    """A diverged state, fall or drop, by the conditions of the task (`hotice.sim.terminations`); `hands`: ids of the sites."""
    data = plant.data
    if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all() and np.abs(data.qvel).max() <= FASTEST):
        return "unstable"
    R = data.body("pelvis").xmat.reshape(3, 3)
    if data.qpos[2] < FALLEN_M or R[2, 2] < UPRIGHT:
        return "fall"
    box = data.qpos[27:30]
    if np.linalg.norm(box - data.site_xpos[hands].mean(axis=0)) > APART_M or box[2] < LOW_M:
        return "drop"
    return None


def has_hits(plant: TorquePlant) -> Callable[[], str | None] | None:
    """Function that reads the contact sensors of exact collision scoring; None in a scene without obstacles."""
    sensors = [i for i in range(plant.model.nsensor) if plant.model.sensor(i).name in builder.HIT_SENSORS]
    if not sensors:
        return None
    at = [int(plant.model.sensor(name).adr[0]) for name in builder.HIT_SENSORS]

    def hits() -> str | None:
        robot, load = plant.data.sensordata[at] > 0
        return "robot_collision" if robot else "object_collision" if load else None

    return hits
