"""Trials of the walking baseline (`hotice.control.walk`): same objects, starts, geometry and rules as for policies.

The baseline is driven by torques and planned anew for each trial, so trials run one after another, not as a batch.
Results are rounded: in the last bits the sums of its QP solver depend on where their memory lies, 1e-14 N m of the
first torques.
"""

from __future__ import annotations

import copy
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import torch

from hotice.errors import CarryInfeasible, UnreachableGoal
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import PAPER_S
from hotice.evaluate.referees import REFEREES, Signals
from hotice.evaluate.start import start_trials
from hotice.evaluate.trial_log import BODY_POINTS, TrialLog
from hotice.evaluate.trials import Trials
from hotice.fields.hod_pf import HodPf, build_hod_pf
from hotice.model import builder, g1
from hotice.sim.physics.mujoco_batch import unlogged
from hotice.sim.snapshot import POINTS
from hotice.task.judge import Judge
from hotice.task.rules import arrived

if TYPE_CHECKING:
    from hotice.control.plant import TorquePlant
    from hotice.control.walk import WalkConfig
    from hotice.model.carry import CarryState
    from hotice.model.scene import Scene
    from hotice.sim.env import TransportEnv


@dataclass(frozen=True)
class Trial:
    """Outcome of a walk, its time, distances to the goal, faults and step time of the controller, planned clearance.

    Time [s]; root to goal then and at 5 s [m]; step time [ms]; clearance [m].
    """

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
    config: WalkConfig,
    scene: Scene,
    states: Sequence[CarryState],
    seed: int,
    conditions: Conditions,
    *,
    first: int = 0,
    judges: Sequence[str] = REFEREES,
    on_trials: Callable[[int], None] | None = None,
) -> Trials:
    """Trials `first` .. `first + len(states)` of a scene by a walk, see `start_trials`; as often judged as a policy's.

    Every other one starts with the right foot. `judges`: referees. `on_trials(1)` is called after each.
    """
    env = start_trials(scene, states, seed, conditions, first=first)
    env.reset()
    pf = _fields(scene, env.config.resolution_m, env.config.margin_m)
    trials = []
    for row in range(len(states)):
        trials.append(_score(config, env, row, pf, conditions.limit(env.config), judges, (first + row) % 2))
        if on_trials:
            on_trials(1)
    return Trials.joined(trials)


def _score(
    config: WalkConfig, env: TransportEnv, row: int, pf: HodPf, limit: int, judges: Sequence[str], first_foot: int
) -> Trials:
    """One trial, from a start of `env`, which stays as it is."""
    from hotice.control.plant import TorquePlant

    (scene,), state, look_s = env.bank.scenes, env.carry.states[row], env.config.control_dt_s
    model = copy.copy(env.carry.models[row])
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a diverged state must stay visible
    plant = TorquePlant(model)
    log = TrialLog(env.bank, 1, limit, look_s, judges)
    with unlogged():
        plant.reset(env.physics.qpos[row].numpy())
        try:
            run = Walk(plant, scene, pf, state, config, first_foot=first_foot, look_s=look_s)
        except (UnreachableGoal, CarryInfeasible):
            away = round(goal_distance(plant, scene), 6)
            lost = ("no_plan",)
            return Trials(
                outcome=lost,
                distance_m=(away,),
                time_s=(0.0,),
                distance_at_limit_m=(away,),
                standing=(False,),
                stayed=(False,),
                points=lost if "points" in judges else (),
                self_depth_m=(0.0,),
            )
        while log.running.any():
            run.look()
            if (arrived(run.distance_m) and not log.arrived_at.any()) or len(log.steps) + 1 >= limit:
                run.see_contacts()
            log.see(_signals(run, state, log))
    return log.trials().rounded(6)


def _signals(run: Walk, state: CarryState, log: TrialLog) -> Signals:
    """Observations since the look before, (1,) each."""
    data, failed = run.plant.data, run.failure()
    body = data.site_xpos[[run.plant.model.site(name).id for name in POINTS[:BODY_POINTS]]]
    load = data.body(builder.OBJECT_BODY)
    turned = np.eye(3) if state.carried.keypoints_world_aligned else load.xmat.reshape(3, 3)
    corners = load.xpos + state.carried.keypoints() @ turned.T
    if failed == "unstable":  # nowhere
        gaps = (np.full(1, np.inf),) * 2
    else:
        gaps = log.gaps(torch.from_numpy(body[None]), torch.from_numpy(corners[None]))
    return Signals(
        **{name: np.array([failed == name]) for name in ("fall", "drop", "unstable")},
        robot_hit=run.touched[:1].copy(),
        object_hit=run.touched[1:].copy(),
        robot_gap_m=gaps[0],
        object_gap_m=gaps[1],
        goal_m=np.array([run.distance_m]),
        self_depth_m=np.maximum(0.0, -data.sensor(builder.SELF_SENSOR).data),
        met=np.zeros(1, dtype=bool),
        way_m=log.way(data.qpos[None, :2]),
    )


@lru_cache(maxsize=1)
def _fields(scene: Scene, resolution_m: float, margin_m: float) -> HodPf:
    """Fields of one scene, kept for its next block."""
    return build_hod_pf(scene, resolution_m, margin_m)


class Walk:
    """Walk under way, judged every `look_s`. Raises `UnreachableGoal` or `CarryInfeasible`.

    A look takes place at most once per control step.

    touched: whether robot and object have touched an obstacle in any physics step since the look before, (2,) bool.
    distance_m: root to goal, the last that was a number. faults, step_ms: of the controller. clearance_m: planned.
    """

    def __init__(
        self,
        plant: TorquePlant,
        scene: Scene,
        pf: HodPf,
        state: CarryState,
        config: WalkConfig,
        *,
        first_foot: int = 0,
        look_s: float = 0.0,
        log: list | None = None,
    ) -> None:
        from hotice.control.walk import WalkController, plan_walk

        measurement = plant.measure()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            plan = plan_walk(pf, state, ankles(plant), config, first_foot=first_foot)
        self.plant, self.scene, self.log, self.clearance_m = plant, scene, log, plan.profile.clearance_m
        self.controller = WalkController(plan, state, config)
        self.memory = self.controller.start(measurement)
        self.judge = Judge(plant.model)
        dt = plant.model.opt.timestep
        self.substeps = round(1.0 / self.controller.rate_hz / dt)
        self.every = max(1, round(look_s / (self.substeps * dt)))
        self.hits = has_hits(plant)
        self.touched = np.zeros(2, dtype=bool)
        self.distance_m = goal_distance(plant, scene)
        self.spent_s, self.count, self.faults = 0.0, 0, 0

    @property
    def time_s(self) -> float:
        """Since the start."""
        return self.plant.data.time

    @property
    def step_ms(self) -> float:
        """Mean time of a control step."""
        return 1e3 * self.spent_s / max(1, self.count)

    def look(self) -> None:
        """Goes on to the next look."""
        self.touched[:] = False
        for _ in range(self.every):
            measurement = self.plant.measure()
            begin = time.perf_counter()
            command, self.memory = self.controller.step(self.memory, measurement)
            self.spent_s, self.count = self.spent_s + time.perf_counter() - begin, self.count + 1
            self.faults = command.faults
            for _ in range(self.substeps):
                self.plant.step(command.torque)
                if self.hits:
                    self.touched |= self.hits()
            if self.log is not None:
                self.log.append((self.plant.data.time, self.plant.data.qpos.copy(), self.memory))
        distance_m = goal_distance(self.plant, self.scene)
        if np.isfinite(distance_m):
            self.distance_m = distance_m

    def see_contacts(self) -> None:
        """Also those of the state now: sensors are a step late, and a trial ends with its last state."""
        if self.hits:
            mujoco.mj_forward(self.plant.model, self.plant.data)
            self.touched |= self.hits()

    def failure(self) -> str:
        """A diverged state, fall or drop; empty for none."""
        return self.judge.failure(self.plant.data)


def run_trial(
    plant: TorquePlant,
    scene: Scene,
    pf: HodPf,
    state: CarryState,
    config: WalkConfig,
    horizon_s: float,
    *,
    first_foot: int = 0,
    stay_s: float = 0.0,
    look_s: float = 0.0,
    log: list | None = None,
) -> Trial:
    """One trial; it ends at success (after `stay_s` more without failure), failure or the horizon.

    Args:
        plant: robot, object and obstacles at the start. pf: fields of the scene. state: the grasp.
        first_foot: which foot steps first, 0 left, 1 right.
        look_s: how often the trial is looked at [s], at most once a control step; contacts count in every physics step.
        log: collects time, qpos and memory of the controller after each control step.

    The outcome is `no_plan`, at once, where no footholds lead to the goal or the arms cannot keep the load level.
    """
    distance = distance_5s = goal_distance(plant, scene)
    try:
        run = Walk(plant, scene, pf, state, config, first_foot=first_foot, look_s=look_s, log=log)
    except (UnreachableGoal, CarryInfeasible):
        return Trial("no_plan", 0.0, distance, distance, 0, 0.0, 0.0)
    reached_s, outcome = np.inf, "timeout"
    while run.time_s < horizon_s - 1e-9:
        run.look()
        if not np.isfinite(reached_s):
            distance = run.distance_m
        if run.time_s <= PAPER_S + 1e-9:
            distance_5s = run.distance_m
        if arrived(distance) or run.time_s >= horizon_s - 1e-9:
            run.see_contacts()
        robot, load = run.touched
        failed = run.failure() or ("robot_collision" if robot else "object_collision" if load else None)
        if failed:
            return Trial(failed, run.time_s, distance, distance_5s, run.faults, run.step_ms, run.clearance_m)
        if not np.isfinite(reached_s) and arrived(distance):
            reached_s, outcome = run.time_s, "success"
        if run.time_s >= reached_s + stay_s:
            break
    end = reached_s if np.isfinite(reached_s) else run.time_s
    return Trial(outcome, end, distance, distance_5s, run.faults, run.step_ms, run.clearance_m)


def goal_distance(plant: TorquePlant, scene: Scene) -> float:
    """Root to goal, horizontally [m]."""
    return float(np.linalg.norm(plant.data.qpos[:2] - np.array(scene.goal[:2])))


def ankles(plant: TorquePlant) -> tuple[float, float, float]:
    """Middle between the ankles, x, y [m], and heading of the pelvis [rad]."""
    feet = [plant.data.body(f"{s}_ankle_roll_link").xpos[:2] for s in g1.SIDES]
    R = plant.data.body("pelvis").xmat.reshape(3, 3)
    x, y = np.mean(feet, axis=0)
    return float(x), float(y), float(np.arctan2(R[1, 0], R[0, 0]))


def has_hits(plant: TorquePlant) -> Callable[[], np.ndarray] | None:
    """Function that reads the contact sensors of robot and object, (2,) bool; None in a scene without obstacles."""
    sensors = [i for i in range(plant.model.nsensor) if plant.model.sensor(i).name in builder.HIT_SENSORS]
    if not sensors:
        return None
    at = [int(plant.model.sensor(name).adr[0]) for name in builder.HIT_SENSORS]
    return lambda: plant.data.sensordata[at] > 0
