"""Rollouts for looking at: what a policy did, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from hotice.errors import InvalidConfig
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.referees import exact
from hotice.evaluate.start import start_trials
from hotice.evaluate.trial_log import TrialLog
from hotice.evaluate.trials import CAUSES
from hotice.learn.policy import Policy, check_layout
from hotice.model.carry import CarryState
from hotice.model.scene import Scene
from hotice.replay import RolloutRecord
from hotice.sim.env import TransportEnv
from hotice.sim.snapshot import NUM_SGF, Snapshot


@dataclass
class _Frames:
    """Arrays kept of every control step."""

    qpos: list[np.ndarray]
    points: list[np.ndarray]
    forces: list[np.ndarray]

    def add(self, qpos: torch.Tensor, s: Snapshot) -> None:
        self.qpos.append(qpos.double().cpu().numpy().copy())
        points = torch.cat([s.p_WK[:, : NUM_SGF + 2], s.p_WOK], dim=1)
        self.points.append(points.cpu().numpy())
        self.forces.append(torch.cat([s.sgf.force_W, s.ogf.force_W], dim=1).cpu().numpy())


def record_rollouts(
    policy: Policy,
    scene: Scene,
    states: Sequence[CarryState],
    conditions: Conditions | None = None,
    *,
    seed: int = 0,
    after_s: float = 0.0,
    threads: int = 0,
) -> list[RolloutRecord]:
    """One rollout per carry state, the same as a trial of `evaluate`, recorded to `after_s` past its end, at most 5 s.

    `conditions`: physics and perturbation, by default of the protocol `robot` without perturbation. What follows a fall
    or a drop is not shown, nor a diverged simulation. Raises `InvalidConfig` without states, `CheckpointError` for a
    policy of another observation.
    """
    if not states:
        raise InvalidConfig("no carry states: at least one object is needed")
    conditions, meta = conditions or Conditions(perturbed=False), policy.meta
    env = start_trials(scene, states, seed, conditions, trained=meta["task"], preset=meta["preset"], threads=threads)
    check_layout(policy, env.policy_table.layout())
    log = TrialLog(env.bank, len(states), conditions.limit(env.config), env.config.control_dt_s, moving=env.moving)
    obs, _ = env.reset()
    frames = _Frames([], [], [])
    frames.add(env.physics.qpos, env.snapshot())
    while len(log.steps) < log.limit and log.running.any():
        step = env.step(policy.act(obs))
        obs = step.policy
        frames.add(env.physics.qpos, step.seen)
        log.see_step(step)
    verdict, over = exact(log.signals, log.limit), log.signals.over
    lost = log.signals.unstable[over.argmax(axis=0), np.arange(len(states))]
    lasting = np.where(over.any(axis=0), over.argmax(axis=0) + 1 - lost, len(over))
    end = np.maximum(1, np.minimum(verdict.step + round(after_s / env.config.control_dt_s), lasting))
    return [
        _record(env, scene, states[i], frames, i, int(end[i]), verdict.outcome[i], policy.name)
        for i in range(len(states))
    ]


def _record(
    env: TransportEnv, scene: Scene, state: CarryState, frames: _Frames, i: int, end: int, outcome: str, name: str
) -> RolloutRecord:
    qpos = np.stack([q[i] for q in frames.qpos[: end + 1]])
    return RolloutRecord.from_states(
        env.carry.models[i],
        qpos,
        scene=scene,
        carried=state.carried,
        outcome=outcome,
        time_s=env.config.control_dt_s * np.arange(len(qpos)),
        policy=name,
        arrow_pos_W=np.stack([p[i] for p in frames.points[: len(qpos)]]),
        arrow_force_W=np.stack([f[i] for f in frames.forces[: len(qpos)]]),
        arrow_is_ogf=np.arange(NUM_SGF + 10) >= NUM_SGF,
    )


def failures_first(records: Sequence[RolloutRecord]) -> list[RolloutRecord]:
    """Sorted by outcome, in the order of `CAUSES`, successes last; the order within an outcome stays."""
    order = {cause: rank for rank, cause in enumerate(CAUSES)}
    return sorted(records, key=lambda record: order.get(record.outcome, len(CAUSES)))
