"""Trials as `hotice evaluate` draws them, with its own verdicts, for whoever runs the same trials by other means.

Same are, of each trial of a scene under a seed: the object and its carry state, the robot (masses, inertia, motors,
encoders, joint friction and armature, frictions), place and heading of the start, the delays of sensors and motors, and
each push with its time. Sensor noise is not: it is drawn as it is needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import torch

from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.scorer import Scorer, let_rest
from hotice.evaluate.seeds import TrialSeeds
from hotice.evaluate.start import start_trials
from hotice.evaluate.trial_log import TrialLog
from hotice.learn.policy import load_policy
from hotice.model.carry import CarryState
from hotice.model.frames import yaw_from_quat
from hotice.model.joint_friction import set_friction_reference
from hotice.model.scene import Scene
from hotice.sim.env import TransportEnv
from hotice.task.pushes import push_velocity


@dataclass(frozen=True, kw_only=True)
class EvaluatedTrial:
    """One trial of an evaluation, and how it went there."""

    scene: Scene
    """With the start of this trial."""
    carry: CarryState
    robot: mujoco.MjModel
    """With 20 joints; see `become`."""
    late: bool
    """Whether measurements come one control step late."""
    command_delay_s: float
    pushes_W: np.ndarray
    """Change of the root's velocity at the beginning of each control step, (T, 2) [m/s]."""
    outcome: str
    stayed: bool


def evaluated_trials(policy: str, scenes: tuple[str, ...], rollouts: int, seed: int) -> Iterator[EvaluatedTrial]:
    """Runs and yields the trials of `hotice evaluate --policy … --scenes … --rollouts … --seed …`, scene by scene."""
    config = EvaluateConfig(policy=policy, scenes=scenes, rollouts=rollouts, seed=seed, referees=("exact",))
    scorer, carrier = Scorer.of(config), load_policy(policy, threads=1)
    for scene in scorer.scenes:
        which = TrialSeeds.of(seed, scene).objects(rollouts, len(scorer.states))
        states = [scorer.states[k] for k in which]
        yield from _block(carrier, scene, states, config)


def _block(policy, scene: Scene, states: list[CarryState], config: EvaluateConfig) -> Iterator[EvaluatedTrial]:
    meta = policy.meta
    env = start_trials(scene, states, config.seed, config.conditions, trained=meta["task"], preset=meta["preset"])
    task, pushes = env.config, []
    log = TrialLog(env.bank, len(states), config.conditions.limit(task), task.control_dt_s, config.judges)
    obs, _ = env.reset()
    start, delays = env.physics.qpos[:, :7].numpy().copy(), env.sensors.action_delay.tolist()
    late = env.sensors.late.tolist()
    while log.running.any():
        action = policy.act(obs)
        pushes.append(next_pushes(env))
        step = env.step(action)
        obs = step.policy
        if log.see_step(step):
            let_rest(env, torch.from_numpy(log.running))
    result = log.trials()
    for i, carry in enumerate(states):
        place = (*start[i, :2].tolist(), float(yaw_from_quat(start[i, 3:7])))
        yield EvaluatedTrial(
            scene=replace(scene, start=place),
            carry=carry,
            robot=env.carry.models[i],
            late=late[i],
            command_delay_s=delays[i] * task.physics_dt_s,
            pushes_W=np.array([each[i] for each in pushes]),
            outcome=result.outcome[i],
            stayed=result.stayed[i],
        )


def next_pushes(env: TransportEnv) -> np.ndarray:
    """Pushes of the next step of an environment, (N, 2) [m/s], which draws nothing else before them."""
    generator = torch.Generator().manual_seed(0)
    generator.set_state(env.generator.get_state())
    hit, angle, share = (torch.rand(env.num_envs, generator=generator) for _ in range(3))
    chance = env.config.control_dt_s / env.config.push_interval_s
    return push_velocity(hit, angle, share, env.config.push_m_s, chance).numpy()


def become(model: mujoco.MjModel, robot: mujoco.MjModel) -> mujoco.MjModel:
    """The model of 29 joints of a robot of 20, by the names of bodies, joints, motors and geoms; changes `model`.

    Waist and wrists, which are welded there, stay as they are.
    """

    def both(kind: str, count: int) -> tuple[list[int], list[int]]:
        names = [(i, getattr(robot, kind)(i).name) for i in range(count)]
        known = [(i, mujoco.mj_name2id(model, _KIND[kind], name)) for i, name in names if name]
        return [i for i, j in known if j >= 0], [j for _, j in known if j >= 0]

    theirs, ours = both("body", robot.nbody)
    for field in ("body_mass", "body_inertia", "body_ipos"):
        getattr(model, field)[ours] = getattr(robot, field)[theirs]
    theirs, ours = both("actuator", robot.nu)
    for field in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
        getattr(model, field)[ours] = getattr(robot, field)[theirs]
    theirs, ours = (robot.actuator_trnid[theirs, 0], model.actuator_trnid[ours, 0])
    for field in ("dof_frictionloss", "dof_armature"):
        getattr(model, field)[model.jnt_dofadr[ours]] = getattr(robot, field)[robot.jnt_dofadr[theirs]]
    theirs, ours = both("geom", robot.ngeom)
    model.geom_friction[ours] = robot.geom_friction[theirs]
    mujoco.mj_setConst(model, mujoco.MjData(model))
    set_friction_reference(model)
    return model


_KIND = {"body": mujoco.mjtObj.mjOBJ_BODY, "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR, "geom": mujoco.mjtObj.mjOBJ_GEOM}
