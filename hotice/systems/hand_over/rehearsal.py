"""Trying a policy in simulation from the very state in which it would take over, before it does."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.policy.action import next_action
from hotice.policy.guidance import read_fields
from hotice.policy.measuring import DRAWS, ESTIMATE, measure
from hotice.policy.observation import Carrying, observe, remember
from hotice.policy.percept import Percept, PerceptModel
from hotice.systems.hand_over.stage import VERDICTS, RehearsalStage
from hotice.systems.joint_pd import pd_torque
from hotice.systems.setup.rehearsal_config import RehearsalConfig
from hotice.systems.setup.setup import StationSetup
from hotice.systems.signals import NQ
from hotice.systems.state_adaptor import robot_state_of_mujoco
from hotice.task import history
from hotice.task.sensing import TRACK_TILT

Array = NDArray[np.float64]


class Sensing:
    """Noise of the station's sensors with random numbers of its own, and its encoders; delays are left out."""

    def __init__(self, setup: StationSetup, number: int) -> None:
        self._config, self._dt_s = setup.config.sensing, setup.task.control_dt_s
        self._aligned = setup.carry.carried.keypoints_world_aligned
        self._rng = np.random.default_rng([setup.config.seed, number])
        self._estimate, self._count = np.zeros(ESTIMATE), 0
        self._offset = setup.servo().offset

    def __call__(self, true: Percept, keypoints: Callable[[Array], Array]) -> Percept:
        """The next measurement; `keypoints`: see `measure`."""
        cfg, dt_s, k = self._config, self._dt_s, self._count
        if cfg.exact and not self._offset.any():
            return true
        hold, gain = cfg.hold_steps(dt_s), cfg.object_gain(dt_s)
        percept, self._estimate = measure(
            true,
            self._estimate,
            self._rng.uniform(-1.0, 1.0, DRAWS),
            cfg,
            self._aligned,
            self._offset,
            keypoints=keypoints,
            refresh=k % hold == 0,
            gain=max(gain, 1.0 / (k + 1)),
            tilt_gain=max(TRACK_TILT, 1.0 / (k + 1)),
            hold_s=hold * dt_s,
            dt_s=dt_s if k else 0.0,
        )
        self._count += 1
        return percept


class Rehearsal:
    """Trial of the policy in a model of robot, object, table and scene, with noise like that of the sensors.

    Called with a robot state (84,); returns an index into `VERDICTS`, the first failure among the tries.
    """

    def __init__(self, setup: StationSetup, config: RehearsalConfig | None = None) -> None:
        self.config = config or RehearsalConfig()
        self._setup, self._task, self._pf = setup, setup.task, setup.pf
        self._stage = RehearsalStage(setup)
        self._substeps = round(setup.task.control_dt_s / setup.physics_dt_s)
        self._percept_of = PerceptModel(setup.carry.carried)
        self._servo = setup.servo()

    def __call__(self, state: Array) -> int:
        for number, push in enumerate(self.config.push_m_s):
            verdict = self._try(state, push, Sensing(self._setup, number))
            if verdict:
                return verdict
        return 0

    def _try(self, state: Array, push_m_s: float, sensing: Sensing) -> int:
        carry, task, model = self._setup.carry, self._task, self._stage.model
        data = mujoco.MjData(model)
        q, qd, servo = data.qpos[g1.JOINT_POS], data.qvel[g1.JOINT_VEL], self._servo
        data.qpos[:], data.qvel[:] = self._stage.start(state, push_m_s)
        carrying, action, phase = Carrying.of(carry), np.zeros(g1.ACTIONS), 0.0
        past = np.zeros(task.history * history.FRAME)
        for _ in range(round(self.config.horizon_s / task.control_dt_s)):
            now = robot_state_of_mujoco(np.concatenate([data.qpos, data.qvel]), carry.wrist_pos)
            percept = sensing(self._percept_of(now[:NQ], now[NQ:]), self._percept_of.keypoints_at(now[:NQ]))
            reading = read_fields(self._pf, percept, task)
            observation = observe(percept, reading, carrying, action, phase, task.scan, past)
            past = remember(past, observation)
            raw = self._setup.policy.run(observation[None])[0].astype(float)
            if not np.isfinite(raw).all():
                return VERDICTS.index("diverged")
            action = next_action(raw, task.action_limit)
            phase = (phase + 2.0 * math.pi * task.gait_hz * task.control_dt_s) % (2.0 * math.pi)
            target = carry.joint_target + task.action_scale * action - servo.offset
            for _ in range(self._substeps):
                data.ctrl[:] = pd_torque(target, q, qd, servo.kp, servo.kd, servo.limit)
                mujoco.mj_step(model, data)
            verdict = self._stage.verdict(data)
            if verdict:
                return verdict
        return 0
