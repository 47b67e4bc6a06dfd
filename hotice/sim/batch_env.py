"""A batch of robots, one control step at a time: what every task has in common.

A task gives the tables, the bank of what is carried, starts, snapshots and ends; here is the order of a step, and what
lasts from one to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from hotice.sim.events import push, turn_about_root
from hotice.sim.observations import ObservationTable
from hotice.sim.physics.protocol import Physics
from hotice.sim.rewards import TERMINATION_PENALTY, RewardTable
from hotice.sim.sensing import Sensors
from hotice.sim.snapshot import Layout, Memory
from hotice.task import history
from hotice.task.config import TaskConfig
from hotice.task.presets import Agent
from hotice.task.rules import OUTCOMES, diverged


@dataclass(frozen=True, kw_only=True)
class Step:
    """Result of a control step of N environments; those that ended have been started anew.

    policy (N, O), critic (N, C): observations, after the restart where one happened.
    final_policy (N, O), final_critic (N, C): before any restart.
    reward (N, A): one stream an agent; terms (N, R): what they sum, raw.
    terminated, truncated (N,): failure or success, and time out. outcome (N,): index into `OUTCOMES`, 0 while running.
    goal_distance (N,): root to goal [m] before any restart. reached (N,): within the goal radius. touched (N,): robot
    or object intrudes into an obstacle, by the sphere cover. scene, model (N,): ids of the episode that made this step.
    length (N,): control steps of that episode so far. seen: the instant after the step, before any restart. self_depth
    (N,): how deep parts of the robot were in each other during the step [m], 0 where the physics does not look
    (training).
    """

    policy: Tensor
    critic: Tensor
    final_policy: Tensor
    final_critic: Tensor
    reward: Tensor
    terms: Tensor
    terminated: Tensor
    truncated: Tensor
    outcome: Tensor
    goal_distance: Tensor
    reached: Tensor
    touched: Tensor
    scene: Tensor
    model: Tensor
    length: Tensor
    seen: Any
    self_depth: Tensor


class BatchEnv:
    """Common part of the tasks; `TransportEnv` says what the attributes are."""

    config: TaskConfig
    agents: tuple[Agent, ...]
    num_envs: int
    device: torch.device
    generator: torch.Generator
    carry: Any
    physics: Physics
    layout: Layout
    starter: Any
    bank: Any
    rewards: RewardTable
    policy_table: ObservationTable
    critic_table: ObservationTable
    everyone: Tensor
    memory: Memory
    held: Tensor
    read: Tensor
    frame: Tensor
    exact: bool
    truth: Tensor
    sensors: Sensors
    action_scale: Tensor
    unstable: int
    invalid_actions: int
    restarts: bool

    @property
    def num_actions(self) -> int:
        """20."""
        return 20

    def reset(self) -> tuple[Tensor, Tensor]:
        """Starts every episode; returns policy (N, O) and critic (N, C) observations."""
        self._start(self.everyone)
        s = self.snapshot()
        self.rewards.check(s)
        return self._observe(s, self.everyone), self._privileged(s, self.everyone)

    def state(self) -> dict[str, Tensor]:
        """Copies of everything that later steps depend on: physics, memory, random state, scene weights."""
        rows = {f"physics.{k}": v for k, v in self.physics.state().items()}
        rows |= {f"memory.{k}": v.clone() for k, v in vars(self.memory).items()}
        if not self.exact:
            rows |= {f"sensors.{k}": v for k, v in self.sensors.state().items()}
            rows |= {"held": self.held.clone(), "read": self.read.clone()}
        rows["generator"] = self.generator.get_state()
        rows["scene_weight"] = self.starter.scene_weight.clone()
        rows["unstable"] = torch.tensor(self.unstable)
        return rows

    def load_state(self, state: dict[str, Tensor]) -> tuple[Tensor, Tensor]:
        """Restores `state()` of an equal environment and returns its observations; it then goes on bit for bit."""
        for name in vars(self.memory):
            getattr(self.memory, name).copy_(state[f"memory.{name}"])
        self.physics.set_models(self.everyone, self.memory.model)
        self.physics.load_state({k.removeprefix("physics."): v for k, v in state.items() if k.startswith("physics.")})
        self.generator.set_state(state["generator"].cpu())
        self.starter.scene_weight.copy_(state["scene_weight"])
        self.unstable = int(state["unstable"])
        s = self.snapshot()
        if self.exact:
            self.read = self.policy_table(s)
            return self.read.clone(), self._privileged(s, self.everyone)
        self.sensors.load_state({k.removeprefix("sensors."): v for k, v in state.items() if k.startswith("sensors.")})
        self.held.copy_(state["held"])
        self.read.copy_(state["read"])
        return self.read.clone(), self._privileged(s, self.everyone)

    def step(self, action: Tensor) -> Step:
        """One control step (20 ms) with actions (N, 20).

        An action that is not finite ends its episode as `unstable`; until then its robot holds the object.
        """
        invalid = self._act(action)
        push(self.physics, self.config, self.generator)
        place = torch.nan_to_num(self.physics.qpos[:, :2])
        self._advance()
        unstable = self._contain(place, invalid)
        s = self.snapshot()
        outcome = self._outcome(s, unstable)
        truncated = outcome == OUTCOMES.index("timeout")
        success = outcome == OUTCOMES.index("success")
        terminated = (outcome > 0) & ~truncated
        reward, terms = self.rewards(s)
        reward = reward + TERMINATION_PENALTY * (terminated & ~success)[:, None]
        reward = torch.where(unstable[:, None], torch.full_like(reward, TERMINATION_PENALTY), reward)
        terms = torch.where(unstable[:, None], torch.zeros_like(terms), terms)
        policy, critic = self._observe(s, self.everyone), self._privileged(s, self.everyone)
        final_policy, final_critic = policy, critic
        deep = self.physics.self_depth
        self_depth = torch.zeros(self.num_envs, device=self.device) if deep is None else deep.clone()
        distance, reached, touched = self._way(s)
        scene, model, length = self.memory.scene.clone(), self.memory.model.clone(), self.memory.step.clone()
        done = torch.nonzero(outcome > 0).squeeze(1)
        if self.restarts and len(done):
            final_policy, final_critic = policy.clone(), critic.clone()
            self._start(done)
            fresh = self.snapshot(done)
            policy[done], critic[done] = self._observe(fresh, done), self._privileged(fresh, done)
        return Step(
            policy=policy,
            critic=critic,
            final_policy=final_policy,
            final_critic=final_critic,
            reward=reward,
            terms=terms,
            terminated=terminated,
            truncated=truncated,
            outcome=outcome,
            goal_distance=distance,
            reached=reached,
            touched=touched,
            scene=scene,
            model=model,
            length=length,
            seen=s,
            self_depth=self_depth,
        )

    def _act(self, action: Tensor) -> Tensor:
        """Turns actions into servo targets around the carry state, advances the clock and records what was read.

        Returns which environments' actions are not finite, (N,) bool; zero takes their place.
        """
        m = self.memory
        if self.config.history:
            m.past = torch.cat([self.read[:, self.frame], m.past[:, : -history.FRAME]], dim=1)
            m.true_past = torch.cat([self.truth[:, self.frame], m.true_past[:, : -history.FRAME]], dim=1)
        limit = self.config.action_limit
        m.last_action = m.action
        action = action.detach().to(self.device, torch.float32)
        invalid = ~torch.isfinite(action).all(dim=1)
        m.action = action.masked_fill(invalid[:, None], 0.0).clamp(-limit, limit)
        self.physics.ctrl[:] = self.targets(m.action).to(self.physics.ctrl.dtype)
        m.phase = (m.phase + 2 * torch.pi * self.config.gait_hz * self.config.control_dt_s) % (2 * torch.pi)
        m.step = m.step + 1
        return invalid

    def targets(self, action: Tensor) -> Tensor:
        """Servo targets (N, 20) [rad] of actions (N, 20): around those of the carry state."""
        return self.carry.target[self.memory.model] + self.action_scale * action

    def _advance(self) -> None:
        """Physics of one control step; until a delayed target arrives, the motors hold the one before."""
        sensors, ctrl = self.sensors, self.physics.ctrl
        if not sensors.longest_delay:
            self.physics.step(self.config.substeps)
            return
        target = ctrl.clone()
        ctrl[:] = self.held.to(ctrl.dtype)
        self.physics.step(self.config.substeps, target, sensors.action_delay)
        self.held = target.float()

    def _observe(self, s: Any, ids: Tensor) -> Tensor:
        """Rows that the actors of environments `ids` read of their snapshot."""
        if self.exact:
            self.read[ids] = self.policy_table(s)
            return self.read[ids]
        offset = self.carry.joint_offset[self.memory.model[ids]]
        measured = self.policy_table(self.sensors.measure(s, ids, offset, self.generator))
        self.read[ids] = self.sensors.delay(measured, ids)
        return self.read[ids]

    def _privileged(self, s: Any, ids: Tensor) -> Tensor:
        """Rows that critics, and teachers in their first columns, read of environments `ids`: the truth."""
        rows = self.critic_table(replace(s, past=self.memory.true_past[ids]))
        self.truth[ids] = rows[:, : self.policy_table.size]
        return rows

    def _contain(self, place: Tensor, invalid: Tensor) -> Tensor:
        """Diverged simulations and those with an `invalid` action (N,), (N,) bool.

        Until their restart they are held at their last `place` (N, 2) [m].
        """
        p = self.physics
        bad = diverged(p.qpos, p.qvel) | invalid
        if bad.any():
            self.invalid_actions += int(invalid.sum())
            ids = torch.nonzero(bad).squeeze(1)
            self.unstable += len(ids)
            upright = torch.nn.functional.pad(place[ids].double(), (0, 1))
            carried = self.carry.qpos[self.memory.model[ids]]
            p.qpos[ids] = turn_about_root(carried, upright, self.layout.object_q).to(p.qpos.dtype)
            p.qvel[ids] = 0.0
            p.forward(ids)
        return bad

    def _outcome(self, s: Any, unstable: Tensor) -> Tensor:
        """Index into `OUTCOMES` of each episode, 0 where it goes on."""
        raise NotImplementedError

    def _way(self, s: Any) -> tuple[Tensor, Tensor, Tensor]:
        """Distance to go (N,) [m], whether the end is reached (N,) and whether something is hit (N,)."""
        raise NotImplementedError

    def _start(self, ids: Tensor) -> None:
        """Starts episodes of environments `ids`."""
        raise NotImplementedError

    def snapshot(self, ids: Tensor | None = None) -> Any:
        """Reads environments `ids` (default all) from the simulator."""
        raise NotImplementedError
