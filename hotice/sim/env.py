"""The transport task: N robots carry N objects through scenes, one control step at a time.

Layers, from the outside in: `TransportEnv` orders a step; rewards, observations and terminations are tables; `Snapshot`
is what they read; `Physics` is what moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from hotice import checks
from hotice.fields.bank import FieldBank
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.sim.carry_bank import CarryBank
from hotice.sim.events import Starter, push, turn_about_root
from hotice.sim.observations import PRIVILEGED, ObservationTable, policy_rows
from hotice.sim.physics.protocol import make_physics
from hotice.sim.physics.ram import check_memory
from hotice.sim.reader import Reader
from hotice.sim.rewards import REWARDS, TERMINATION_PENALTY, RewardTable
from hotice.sim.sensing import Sensors
from hotice.sim.snapshot import Layout, Memory, Snapshot
from hotice.sim.terminations import TERMINATIONS
from hotice.task import history
from hotice.task.config import TaskConfig
from hotice.task.presets import get_preset
from hotice.task.rules import OUTCOMES, arrived, diverged, outcome_code
from hotice.task.sensing import KNOWN_ROWS


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
    seen: Snapshot
    self_depth: Tensor


class TransportEnv:
    """Batched transport task.

    Args:
        num_envs: N.
        scenes: scenes to carry through, or a `FieldBank` built from them.
        objects: carried objects, one an environment in turn; default: drawn from `config.objects`.
        preset: row of Table I: dual_hodpf, dual_sgf, single_hodpf, single_sgf.
        device: of the tensors: "cpu", or "cuda" with physics "warp".
        physics: backend, "mujoco" or "warp".
        seed: of every random draw.
        config: numbers of the task.
        threads: of the physics (0: all usable cores).

    Raises:
        HoticeError: unknown preset or backend, no scenes, objects that cannot be held.
    """

    def __init__(
        self,
        num_envs: int,
        scenes: Sequence[Scene] | FieldBank,
        objects: Sequence[CarriedObject] | CarriedObject | CarryBank | None = None,
        preset: str = "dual_hodpf",
        device: torch.device | str = "cpu",
        physics: str = "mujoco",
        seed: int = 0,
        *,
        config: TaskConfig | None = None,
        threads: int = 0,
    ) -> None:
        checks.whole("num_envs", num_envs, checks.COUNT)
        if physics == "mujoco":
            check_memory(num_envs)
        self.config = config or TaskConfig()
        self.preset = get_preset(preset)
        self.agents = self.preset.agents
        self.num_envs = num_envs
        self.device = torch.device(device)
        self.generator = torch.Generator(self.device).manual_seed(seed)
        cfg = self.config
        if isinstance(scenes, FieldBank):
            self.bank = scenes.to(self.device)
        else:
            self.bank = FieldBank.build(scenes, cfg.resolution_m, cfg.margin_m).to(self.device)
        if isinstance(objects, CarryBank):
            self.carry = objects
        elif objects is None:
            self.carry = CarryBank.sample(
                cfg.objects,
                min(cfg.carry_states, num_envs),
                seed,
                cfg.physics_dt_s,
                self.device,
                one_layout=physics == "warp",
                dynamics=cfg.dynamics,
            )
        else:
            given = list(objects) if isinstance(objects, Sequence) else [objects]
            self.carry = CarryBank.of_objects(
                given, cfg.physics_dt_s, self.device, one_layout=physics == "warp", dynamics=cfg.dynamics, seed=seed
            )
        self.physics = make_physics(physics, self.carry.models, num_envs, self.device, threads)
        self.layout = Layout(self.carry.models[0], self.device)
        self.starter = Starter(cfg, self.bank, self.carry, self.layout, self.device)
        self.rewards = RewardTable(REWARDS, self.agents, cfg.control_dt_s)
        rows = policy_rows(cfg.scan, cfg.history)
        self.policy_table = ObservationTable(rows)
        self.critic_table = ObservationTable(rows + PRIVILEGED)
        self.everyone = torch.arange(num_envs, device=self.device)
        self.memory = Memory.zeros(num_envs, self.device, cfg.history)
        self.reader = Reader(
            cfg, self.preset.object_field, self.bank, self.carry, self.layout, self.physics, self.memory
        )
        self.held = torch.zeros(num_envs, 20, device=self.device)
        self.read = torch.zeros(num_envs, self.policy_table.size, device=self.device)
        self.frame = torch.nonzero(self.policy_table.columns([n for n, _ in history.ROWS]))[:, 0].to(self.device)
        self.exact = cfg.sensing.exact and not bool(self.carry.joint_offset.any())
        """Whether actors read the truth."""
        self.truth = torch.zeros(num_envs, self.policy_table.size, device=self.device)
        self.sensors = Sensors(
            cfg.sensing,
            num_envs,
            cfg.control_dt_s,
            cfg.substeps,
            self.device,
            self.reader.guide,
            self.policy_table.columns(KNOWN_ROWS).to(self.device),
            self.layout.chains,
        )
        self.action_scale = torch.tensor(cfg.action_scale, dtype=torch.float32, device=self.device)
        self.unstable = 0
        """Episodes that ended as `unstable`; `state` keeps the number."""
        self.invalid_actions = 0
        """Those of them that ended since this environment was made because an action was not finite."""
        self.restarts = True
        """Whether what has ended is started anew; evaluation starts nothing anew: a trial's draws then depend on no
        other."""
        self.memory.model[:] = torch.arange(num_envs, device=self.device) % len(self.carry.states)

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
            goal_distance=s.goal_distance,
            reached=self._arrived(s),
            touched=torch.minimum(s.clearance, s.object_clearance) < 0.0,
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
        target = self.carry.target[m.model] + self.action_scale * m.action
        self.physics.ctrl[:] = target.to(self.physics.ctrl.dtype)
        m.phase = (m.phase + 2 * torch.pi * self.config.gait_hz * self.config.control_dt_s) % (2 * torch.pi)
        m.step = m.step + 1
        return invalid

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

    def _observe(self, s: Snapshot, ids: Tensor) -> Tensor:
        """Rows that the actors of environments `ids` read of their snapshot."""
        if self.exact:
            self.read[ids] = self.policy_table(s)
            return self.read[ids]
        offset = self.carry.joint_offset[self.memory.model[ids]]
        measured = self.policy_table(self.sensors.measure(s, ids, offset, self.generator))
        self.read[ids] = self.sensors.delay(measured, ids)
        return self.read[ids]

    def _privileged(self, s: Snapshot, ids: Tensor) -> Tensor:
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

    def _outcome(self, s: Snapshot, unstable: Tensor) -> Tensor:
        """Index into `OUTCOMES` of each episode, 0 where it goes on."""
        timeout = self.memory.step >= self.config.max_steps
        if self.config.goal_stay_s:
            timeout |= self._stayed(s)
        seen = {"timeout": timeout, "unstable": unstable}
        if self.config.end_at_goal:
            seen["success"] = self._arrived(s)
        for row in TERMINATIONS:
            if self.config.collisions or not row.collision:
                seen[row.name] = row.condition(s)
        return outcome_code(torch.zeros(self.num_envs, dtype=torch.int64, device=self.device), **seen)

    def _arrived(self, s: Snapshot) -> Tensor:
        """Whether each root is at the goal, (N,) bool."""
        return arrived(s.goal_distance, self.config.goal_radius_m)

    def _stayed(self, s: Snapshot) -> Tensor:
        """Mask (N,) of robots that have stood at the goal long enough: drawn, so that nothing is remembered."""
        chance = self.config.control_dt_s / self.config.goal_stay_s
        leaves = torch.rand(self.num_envs, generator=self.generator, device=self.device) < chance
        return leaves & self._arrived(s)

    def _start(self, ids: Tensor) -> None:
        m, n = self.memory, len(ids)
        m.scene[ids] = self.starter.draw_scenes(n, self.generator)
        if self.starter.small is not None:
            m.model[ids] = self.starter.small.draw(n, self.generator)
        self.starter.write(self.physics, ids, m.scene[ids], m.model[ids], self.generator)
        m.action = m.action.clone()
        m.last_action = m.last_action.clone()
        m.action[ids] = 0.0
        m.last_action[ids] = 0.0
        m.past[ids] = 0.0
        m.true_past[ids] = 0.0
        self.held[ids] = self.carry.target[m.model[ids]]
        if not self.exact:
            self.sensors.restart(ids, self.generator)
        side = torch.rand(n, generator=self.generator, device=self.device) < 0.5
        m.phase[ids] = torch.where(side, 0.0, torch.pi)
        m.step[ids] = 0

    def snapshot(self, ids: Tensor | None = None) -> Snapshot:
        """Reads environments `ids` (default all) from the simulator and adds fields and commands."""
        return self.reader.snapshot(ids)
