"""Rollouts for looking at: what a policy did, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from hotice.errors import InvalidConfig
from hotice.fields.bank import FieldBank
from hotice.learn.evaluate import evaluation_task
from hotice.learn.policy import Policy, check_layout
from hotice.learn.trials import CAUSES
from hotice.model.carry import CarryState
from hotice.model.scene import Scene
from hotice.replay import RolloutRecord
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.snapshot import NUM_SGF, Snapshot
from hotice.sim.terminations import OUTCOMES


@dataclass
class _Frames:
    """What is kept of every control step."""

    qpos: list[np.ndarray]
    points: list[np.ndarray]
    forces: list[np.ndarray]

    def add(self, qpos: torch.Tensor, s: Snapshot) -> None:
        self.qpos.append(qpos.double().cpu().numpy().copy())
        points = torch.cat([s.p_WK[:, : NUM_SGF + 2], s.p_WOK], dim=1)
        self.points.append(points.cpu().numpy())
        self.forces.append(torch.cat([s.sgf.force_W, s.ogf.force_W], dim=1).cpu().numpy())


def record_rollouts(
    policy: Policy, scene: Scene, states: Sequence[CarryState], *, seed: int = 0, after_s: float = 0.0, threads: int = 0,
    perturbed: bool = False,
) -> list[RolloutRecord]:  # fmt: skip
    """One rollout for each carry state, ended by the rules of `evaluate` and recorded until `after_s` past its end, at most 5 s.

    A fall, a drop or a diverged simulation ends the record a frame before.

    Raises `InvalidConfig` without states, `CheckpointError` for a policy of another observation.
    """
    if not states:
        raise InvalidConfig("no carry states: at least one object is needed")
    task = evaluation_task(policy.meta["task"], perturbed=perturbed)
    steps = task.max_steps
    longer_s = task.episode_s + task.control_dt_s  # so that the trial's last step is seen, not the next episode's start
    config = replace(task, end_at_goal=False, collisions=False, episode_s=longer_s)
    bank = FieldBank.build([scene], config.resolution_m, config.margin_m)
    carry = CarryBank.of(
        states, config.physics_dt_s, torch.device("cpu"), scene=scene, dynamics=config.dynamics, seed=seed
    )
    env = TransportEnv(len(states), bank, carry, policy.meta["preset"], seed=seed, config=config, threads=threads)
    check_layout(policy, env.policy_table.layout())
    obs, _ = env.reset()
    first, frames = env.physics.qpos.clone(), _Frames([], [], [])
    frames.add(first, env.snapshot())
    end = torch.full((len(states),), -1)
    outcome = ["timeout"] * len(states)
    restarted = torch.full((len(states),), steps + 1)
    for t in range(1, steps + 1):
        step = env.step(policy.act(obs))
        obs = step.policy
        s = env.snapshot()
        frames.add(env.physics.qpos, s)
        ended = (step.outcome > 0) | s.robot_hit | s.object_hit | step.reached
        for i in torch.nonzero((end < 0) & ended).squeeze(1).tolist():
            end[i] = t
            if step.outcome[i] > 0:
                outcome[i] = OUTCOMES[int(step.outcome[i])]
            elif s.robot_hit[i] or s.object_hit[i]:
                outcome[i] = "robot_collision" if s.robot_hit[i] else "object_collision"
            else:
                outcome[i] = "success"
        for i in torch.nonzero((step.outcome > 0) & (restarted > steps)).squeeze(1).tolist():
            restarted[i] = t  # from this frame on the next episode would be shown
    return [
        _record(env, scene, states[i], frames, i, int(end[i]), int(restarted[i]), outcome[i], policy.name, after_s)
        for i in range(len(states))
    ]  # fmt: skip


def _record(
    env: TransportEnv, scene: Scene, state: CarryState, frames: _Frames, i: int, end: int, restarted: int,
    outcome: str, name: str, after_s: float,
) -> RolloutRecord:  # fmt: skip
    dt = env.config.control_dt_s
    last = min(len(frames.qpos), restarted)
    if end >= 0:
        last = min(last, end + 1 + round(after_s / dt))
    qpos = np.stack([q[i] for q in frames.qpos[: max(last, 2)]])
    return RolloutRecord.from_states(
        env.carry.models[i], qpos, scene=scene, carried=state.carried, time_s=dt * np.arange(len(qpos)), outcome=outcome,
        policy=name, arrow_pos_W=np.stack([p[i] for p in frames.points[: len(qpos)]]),
        arrow_force_W=np.stack([f[i] for f in frames.forces[: len(qpos)]]),
        arrow_is_ogf=np.arange(NUM_SGF + 10) >= NUM_SGF,
    )  # fmt: skip


def failures_first(records: Sequence[RolloutRecord]) -> list[RolloutRecord]:
    """Sorted by outcome, in the order of `CAUSES`, successes last; the order within an outcome stays."""
    order = {cause: rank for rank, cause in enumerate(CAUSES)}
    return sorted(records, key=lambda record: order.get(record.outcome, len(CAUSES)))
