"""The pick-up task: N robots pick N objects up from supports, one control step at a time."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from hotice import checks
from hotice.errors import InvalidConfig
from hotice.model import g1
from hotice.model.picks.book import (
    DT_S,
    FELT_M,
    LEAN_HZ,
    LEAN_M_S,
    OFF_M,
    OFF_M_S,
    STIFFER,
    PickBook,
    balance_gains,
)
from hotice.model.scene import Scene
from hotice.sim.batch_env import BatchEnv
from hotice.sim.observations import ObservationTable
from hotice.sim.physics.protocol import make_physics
from hotice.sim.physics.ram import check_memory
from hotice.sim.pickup.bank import PickBank
from hotice.sim.pickup.sensing import PickSensors
from hotice.sim.pickup.snapshot import PickMemory, PickReader, PickSnapshot
from hotice.sim.pickup.tables import FELT_SCALE, KNOWN, PRIVILEGED, REWARDS, TERMINATIONS, policy_rows
from hotice.sim.rewards import RewardTable
from hotice.sim.snapshot import Layout, Memory
from hotice.task import history, rules
from hotice.task.config import TaskConfig
from hotice.task.pickup import pickup_task, shortest_s
from hotice.task.presets import get_preset
from hotice.task.rules import outcome_code

MARGIN_M = 0.003
WAIT_STEPS = 300


@dataclass(frozen=True, kw_only=True)
class NoFields:
    """Stands where transport has the fields of its scenes: one scene, without any."""

    scenes: tuple[Scene, ...] = (Scene("pickup"),)
    num_scenes: int = 1

    @property
    def names(self) -> list[str]:
        """Of the scenes."""
        return [scene.name for scene in self.scenes]


class PickStarter:
    """Starts of picks; the curricula of transport hold nothing back here."""

    near = small = None

    def __init__(self, bank: PickBank, layout: Layout, config: TaskConfig) -> None:
        self.bank, self.layout, self.config = bank, layout, config
        self.scene_weight = torch.ones(1, device=bank.top.device)

    def hold_back(self, *, far: bool, large: bool) -> None:
        """Raises `InvalidConfig` where something is to be held back."""
        if far or large:
            raise InvalidConfig("curriculum_distance_m and curriculum_objects are of transport: leave them out here")

    def write(self, env: PickUpEnv, ids: Tensor, model: Tensor, generator: torch.Generator) -> None:
        """Puts environments `ids` before picks `model`, at rest, with noise of the joints."""
        n, device, noise, p = len(ids), model.device, self.config.joint_noise_rad, env.physics
        qpos = self.bank.qpos[model].clone()
        off = (2.0 * torch.rand(n, g1.ACTIONS, generator=generator, device=device) - 1.0) * noise
        qpos[:, self.layout.q] += off.double()
        qpos[:, 2] += MARGIN_M + 0.25 * noise
        p.set_models(ids, model)
        p.qpos[ids] = qpos.to(p.qpos.dtype)
        p.qvel[ids] = 0.0
        p.ctrl[ids] = self.bank.course_target[model, 0].to(p.ctrl.dtype)
        p.forward(ids)


class PickUpEnv(BatchEnv):
    """Batched pick-up task, dual or single agent; what a step returns is as in `TransportEnv`.

    Success: the object lifted, in the carry state, held for `hotice.task.rules.HELD_S`. `Step.reached` says so,
    `Step.goal_distance` is the object's way to its place in the carry state [m], `Step.touched`: the robot touches the
    support.

    Args:
        num_envs: N. book: what is picked where, a row drawn for each episode. preset: row of Table I, of which only
            the agents matter. device, seed, threads: as in `TransportEnv`; physics is MuJoCo's on the CPU.
        config: numbers of the task; `hotice.task.pickup` has the pick-up's own.

    Raises:
        InvalidConfig: an episode too short for a success, another control period than the book's.
    """

    memory: PickMemory
    sensors: PickSensors

    def __init__(
        self,
        num_envs: int,
        book: PickBook,
        preset: str = "dual_hodpf",
        device: torch.device | str = "cpu",
        physics: str = "mujoco",
        seed: int = 0,
        *,
        config: TaskConfig | None = None,
        threads: int = 0,
    ) -> None:
        checks.whole("num_envs", num_envs, checks.COUNT)
        check_memory(num_envs)
        if physics != "mujoco":
            raise InvalidConfig(f"physics is {physics!r}: supports of different heights need 'mujoco'")
        self.config = cfg = config or pickup_task(TaskConfig())
        if abs(cfg.control_dt_s - DT_S) > 1e-9:
            raise InvalidConfig(f"control period is {cfg.control_dt_s:g} s: books of picks are made for {DT_S:g} s")
        if cfg.episode_s < shortest_s(book.steps, DT_S):
            raise InvalidConfig(
                f"episode_s is {cfg.episode_s:g}: at least {shortest_s(book.steps, DT_S):g} s are needed to succeed"
            )
        self.preset = get_preset(preset)
        self.agents, self.num_envs, self.device = self.preset.agents, num_envs, torch.device(device)
        self.generator = torch.Generator(self.device).manual_seed(seed)
        self.carry = PickBank.of(
            book, cfg.physics_dt_s, cfg.control_dt_s, self.device, dynamics=cfg.dynamics, seed=seed
        )
        self.bank = NoFields()
        self.physics = make_physics(physics, self.carry.models, num_envs, self.device, threads)
        self.layout = Layout(self.carry.models[0], self.device)
        self.starter = PickStarter(self.carry, self.layout, cfg)
        self.rewards = RewardTable(REWARDS, self.agents, cfg.control_dt_s)
        rows = policy_rows(cfg.history)
        self.policy_table, self.critic_table = ObservationTable(rows), ObservationTable(rows + PRIVILEGED)
        self.everyone = torch.arange(num_envs, device=self.device)
        more = {"held": torch.zeros_like(self.everyone), "leaning": torch.zeros(num_envs, 2, device=self.device)}
        self.memory = PickMemory(**vars(Memory.zeros(num_envs, self.device, cfg.history)), **more)
        self.reader = PickReader(cfg, self.carry, self.layout, self.physics, self.memory)
        self.held = torch.zeros(num_envs, g1.ACTIONS, device=self.device)
        self.read = torch.zeros(num_envs, self.policy_table.size, device=self.device)
        self.frame = torch.nonzero(self.policy_table.columns([n for n, _ in history.ROWS]))[:, 0].to(self.device)
        self.exact = cfg.sensing.exact and not bool(self.carry.joint_offset.any())
        self.truth = torch.zeros(num_envs, self.policy_table.size, device=self.device)
        self.sensors = PickSensors(
            cfg.sensing,
            num_envs,
            cfg.control_dt_s,
            cfg.substeps,
            self.device,
            lambda motion, ids: {},
            self.policy_table.columns(KNOWN).to(self.device),
            self.layout.chains,
        )
        self.sensors.begin()
        self.action_scale = torch.tensor(cfg.action_scale, dtype=torch.float32, device=self.device)
        self.unstable = self.invalid_actions = 0
        self.restarts = True
        self.in_turn = False
        """Whether each robot has a pick of its own, in the order of the book (evaluation); else any is drawn."""
        self._kp = torch.tensor(g1.gains()[0], dtype=torch.float32, device=self.device)
        self._stiff, self._damp = (torch.tensor(g, dtype=torch.float32, device=self.device) for g in balance_gains())
        self._felt = torch.nonzero(self.policy_table.columns(["felt"]))[:, 0].to(self.device)

    def label(self, s: PickSnapshot | None = None) -> Tensor:
        """The action of the teacher in the present state, (N, 20).

        The book's course and the torques that hold it, through the servo law with the gains and the zeros that the
        robot truly has; legs stiffer than their servos; the balance of the pelvis, with a slow part against a centre of
        mass that is elsewhere than described. It sees the true state, and no force. What `targets` adds to every action
        is taken off again.
        """
        s = s or self.snapshot()
        m, bank = self.memory, self.carry
        # what the next step does
        k = m.step.clamp(0, len(bank.phase) - 1)
        course = bank.true_q[m.model, k]
        torque = (bank.true_target[m.model, k] - course) * self._kp
        target = course + torque / bank.kp[m.model] + bank.joint_offset[m.model]
        target[:, g1.LOWER] += STIFFER * (course - s.q)[:, g1.LOWER]
        offset, rate = s.offset.clamp(-OFF_M, OFF_M), s.rate.clamp(-OFF_M_S, OFF_M_S)
        target = target + (offset + LEAN_HZ * m.leaning) @ self._stiff + rate @ self._damp
        limit = self.config.action_limit
        return ((target - self.targets(torch.zeros_like(target))) / self.action_scale).clamp(-limit, limit)

    def balanced(self, felt: Tensor) -> Tensor:
        """What the law adds to the targets, (N, 20) [rad], for the row `felt` that actors read, (N, 4).

        `hotice.model.picks.book.hold_up`: towards where the carry state has the pelvis over the feet.
        """
        offset = (felt[:, :2] / FELT_SCALE).clamp(-FELT_M, FELT_M)
        return offset @ self._stiff + felt[:, 2:].clamp(-OFF_M_S, OFF_M_S) @ self._damp

    def targets(self, action: Tensor) -> Tensor:
        return super().targets(action) + self.balanced(self.read[:, self._felt])

    def spread(self) -> None:
        """Lets the robots begin at different times, so that later steps hold all phases of a pick-up."""
        wait = torch.randint(0, WAIT_STEPS, (self.num_envs,), generator=self.generator, device=self.device)
        self.memory.step.copy_(-wait)

    def _outcome(self, s: PickSnapshot, unstable: Tensor) -> Tensor:
        m = self.memory
        m.leaning[:] = (m.leaning + self.config.control_dt_s * s.offset).clamp(-LEAN_M_S, LEAN_M_S)
        good = rules.in_carry(s.away, s.turned, s.above)
        m.held[:] = torch.where(good, m.held + 1, torch.zeros_like(m.held))
        seen = {"timeout": m.step >= self.config.max_steps, "unstable": unstable, "success": self._picked()}
        for row in TERMINATIONS:
            if self.config.collisions or not row.collision:
                seen[row.name] = row.condition(s)
        return outcome_code(torch.zeros(self.num_envs, dtype=torch.int64, device=self.device), **seen)

    def _picked(self) -> Tensor:
        """Whether each pick-up is done, (N,) bool."""
        return rules.picked(self.memory.held * self.config.control_dt_s)

    def _way(self, s: PickSnapshot) -> tuple[Tensor, Tensor, Tensor]:
        return s.away, self._picked(), s.robot_hit

    def _start(self, ids: Tensor) -> None:
        m, n = self.memory, len(ids)
        if self.in_turn:
            m.model[ids] = ids % len(self.carry.models)
        else:
            m.model[ids] = torch.randint(0, len(self.carry.models), (n,), generator=self.generator, device=self.device)
        self.starter.write(self, ids, m.model[ids], self.generator)
        self.held[ids] = self.carry.course_target[m.model[ids], 0]
        m.action, m.last_action = m.action.clone(), m.last_action.clone()
        # what holds the start is the action before the first: the robot is told it already
        model = m.model[ids]
        off = self.carry.course_pelvis[model, 0] - self.carry.course_pelvis[model, -1]
        own = self.carry.target[model] + self.balanced(torch.cat([FELT_SCALE * off, torch.zeros_like(off)], dim=1))
        first = (self.held[ids] - own) / self.action_scale
        m.action[ids] = m.last_action[ids] = first.clamp(-self.config.action_limit, self.config.action_limit)
        m.past[ids] = m.true_past[ids] = 0.0
        m.held[ids] = 0
        m.leaning[ids] = 0.0
        m.step[ids] = 0
        if not self.exact:
            self.sensors.restart(ids, self.generator)

    def snapshot(self, ids: Tensor | None = None) -> PickSnapshot:
        """Reads environments `ids` (default all) from the simulator."""
        return self.reader.snapshot(ids)
