"""The transport task: N robots carry N objects through scenes, one control step at a time.

Layers, from the outside in: `TransportEnv` orders a step; rewards, observations and terminations are tables; `Snapshot`
is what they read; `Physics` is what moves.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from hotice import checks
from hotice.fields.bank import FieldBank
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.sim.batch_env import BatchEnv
from hotice.sim.carry_bank import CarryBank
from hotice.sim.events import Starter
from hotice.sim.moving import MovingObstacles
from hotice.sim.observations import PRIVILEGED, ObservationTable, policy_rows
from hotice.sim.physics.protocol import make_physics
from hotice.sim.physics.ram import check_memory
from hotice.sim.reader import Reader
from hotice.sim.rewards import REWARDS, RewardTable
from hotice.sim.sensing import Sensors
from hotice.sim.snapshot import Layout, Memory, Snapshot
from hotice.sim.terminations import TERMINATIONS
from hotice.task import history
from hotice.task.config import TaskConfig
from hotice.task.moving import MovingConfig
from hotice.task.presets import get_preset
from hotice.task.rules import arrived, outcome_code
from hotice.task.sensing import KNOWN_ROWS


class TransportEnv(BatchEnv):
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
        moving: what robots know of obstacles that move.

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
        moving: MovingConfig | None = None,
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
        self.moving = MovingObstacles.of(self.bank, moving or MovingConfig(), cfg.episode_s)
        self.reader = Reader(
            cfg, self.preset.object_field, self.bank, self.carry, self.layout, self.physics, self.memory, self.moving
        )
        if self.physics.met is not None:
            self.physics.follow = self._moving_poses
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
            self.reader.measured,
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

    def _moving_poses(self, k: int) -> tuple[Tensor, Tensor]:
        """Poses of what moves after physics step k of the control step under way."""
        assert self.moving is not None
        cfg, m = self.config, self.memory
        return self.moving.poses(m.scene, (m.step - 1) * cfg.control_dt_s + (k + 1) * cfg.physics_dt_s)

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

    def _way(self, s: Snapshot) -> tuple[Tensor, Tensor, Tensor]:
        return s.goal_distance, self._arrived(s), torch.minimum(s.clearance, s.object_clearance) < 0.0

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
