"""Snapshots of the environments: what the simulator says, with fields, command, scan and gaps added."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from hotice.fields.bank import FieldBank
from hotice.fields.clearance import Spheres
from hotice.fields.command import heading_error, navigation_command
from hotice.fields.moving.world import MovingWorld
from hotice.sim import cover
from hotice.sim.carry_bank import CarryBank, pick
from hotice.sim.moving import MovingObstacles
from hotice.sim.physics.protocol import Physics
from hotice.sim.snapshot import FEET, LOOK_AHEAD_S, NUM_SGF, STEERED, Layout, Memory, Motion, Snapshot, read_motion
from hotice.task.config import TaskConfig
from hotice.task.scan import scan_points

TOUCH_HEIGHT_M = 0.012
CLEAR_M = 10.0


class Reader:
    """Reads `physics` and `memory`, which the environment moves on, into snapshots.

    Args:
        config: numbers of the task.
        object_field: which field hands and object read, "ogf" or "sgf".
        moving: what moves in them, if anything.
        bank: fields of the scenes. carry: what is carried. layout: where things are in the simulator's rows.
    """

    def __init__(
        self,
        config: TaskConfig,
        object_field: str,
        bank: FieldBank,
        carry: CarryBank,
        layout: Layout,
        physics: Physics,
        memory: Memory,
        moving: MovingObstacles | None = None,
    ) -> None:
        self.moving = moving
        self.config, self.object_field = config, object_field
        self.bank, self.carry, self.layout, self.physics, self.memory = bank, carry, layout, physics, memory
        self.device = bank.device
        self.robot_cover = cover.robot_spheres(self.carry.models[0], self.device)
        self.upper_cover = cover.upper_spheres(self.carry.models[0], self.device)
        self.object_cover = cover.object_spheres(self.carry.cover_centre, self.carry.cover_radius, self.layout.object)
        self.has_obstacles = any(s.obstacles for s in self.bank.scenes)

    def snapshot(self, ids: Tensor | None = None) -> Snapshot:
        """Reads environments `ids` (default all) from the simulator and adds fields and commands."""
        m, cfg = self.memory, self.config
        rows = slice(None) if ids is None else ids
        scene, model = m.scene[rows], m.model[rows]
        grasp = pick(self.carry.grasp, model)
        motion, xpos, xmat = read_motion(self.physics, self.layout, grasp, ids)
        guidance = self.guide(motion, rows)
        world = self.bank if self.moving is None else self.moving.world(scene, self.time_s(rows))
        robot_gap, object_gap = self._clearances(world, xpos, xmat, scene, model, self.robot_cover)
        ahead = xpos + LOOK_AHEAD_S * torch.nn.functional.pad(guidance["c_W"][:, :2], (0, 1))[:, None]
        gap_ahead = torch.minimum(*self._clearances(world, ahead, xmat, scene, model, self.upper_cover))
        if self.physics.hits is None:
            robot_hit, object_hit = robot_gap < -cfg.tolerance_m, object_gap < -cfg.tolerance_m
        else:
            robot_hit, object_hit = self.physics.hits[rows].clone().unbind(1)  # a copy: a restart clears them
        ends = motion.p_WK[:, NUM_SGF + 2 :, 2]
        touch = torch.minimum(ends[:, :2], ends[:, 2:]) < TOUCH_HEIGHT_M
        wave = torch.sin(torch.stack([m.phase[rows], m.phase[rows] + torch.pi], dim=1))
        return Snapshot(
            **vars(motion),
            **guidance,
            clearance=robot_gap,
            object_clearance=object_gap,
            clearance_ahead=gap_ahead,
            robot_hit=robot_hit,
            object_hit=object_hit,
            met=self._met(scene, rows),
            touch=touch,
            swing=cfg.swing_height_m * torch.clamp(wave, min=0.0),
            stance=wave < 0.2,
            action=m.action[rows],
            last_action=m.last_action[rows],
            past=m.past[rows],
            phase=m.phase[rows],
            time_left=1.0 - m.step[rows].float() / cfg.max_steps,
            grasp=grasp,
        )

    def time_s(self, rows: Tensor | slice) -> Tensor:
        """Time since the starts of the episodes of environments `rows`, (n,) [s]."""
        return self.memory.step[rows] * self.config.control_dt_s

    def guide(self, motion: Motion, rows: Tensor | slice, *, exact: bool = True) -> dict[str, Any]:
        """Fields, command and goal as seen from a motion of environments `rows`: the guidance part of a snapshot.

        `exact`: of obstacles that move as they are, otherwise as the robots know them.
        """
        scene, cfg, eta = self.memory.scene[rows], self.config, self.bank.params.attraction
        fields = self.bank if self.moving is None else self.moving.guiding(scene, self.time_s(rows), exact=exact)
        sgf = fields.sample("sgf", scene, motion.p_WK[:, :NUM_SGF])
        carried = torch.cat([motion.p_WK[:, NUM_SGF : NUM_SGF + 2], motion.p_WOK], dim=1)
        ogf = fields.sample(self.object_field, scene, carried)
        offset_W = self.bank.goal_W[scene, :2] - motion.p_WP[:, :2]
        c_W, speed = navigation_command(sgf.force_W[:, STEERED], offset_W, eta, cfg.speed_m_s, cfg.stop_gain_hz)
        cos, sin = torch.cos(motion.yaw), torch.sin(motion.yaw)
        goal_Y = torch.stack(
            [cos * offset_W[:, 0] + sin * offset_W[:, 1], cos * offset_W[:, 1] - sin * offset_W[:, 0]], 1
        )
        return {
            "sgf": sgf,
            "ogf": ogf,
            "eta": eta,
            "c_W": c_W,
            "speed": speed,
            "goal_Y": goal_Y,
            "heading_error": heading_error(c_W, speed, motion.yaw, cfg.speed_m_s),
            "goal_distance": offset_W.norm(dim=-1),
            "scan": self._scan(fields, motion, scene),
        }

    def measured(self, motion: Motion, rows: Tensor | slice) -> dict[str, Any]:
        """`guide` from a motion as it was measured."""
        return self.guide(motion, rows, exact=False)

    def _met(self, scene: Tensor, rows: Tensor | slice) -> Tensor:
        """Whether what was touched moves, (n,) bool."""
        if self.moving is None or self.physics.met is None:
            return torch.zeros(len(scene), dtype=torch.bool, device=self.device)
        return self.moving.met(scene, self.time_s(rows), self.physics.met[rows])

    def _scan(self, fields: FieldBank | MovingWorld, motion: Motion, scene: Tensor) -> Tensor:
        """Signed distances at the points of the local scan, (N, 40) [m], or (N, 0) without one."""
        if not self.config.scan:
            return motion.yaw.new_empty(len(motion.yaw), 0)
        return fields.signed_distance(scene, scan_points(motion.p_WK[:, FEET], motion.p_WP, motion.yaw))

    def _clearances(
        self,
        world: FieldBank | MovingWorld,
        xpos: Tensor,
        xmat: Tensor,
        scene: Tensor,
        model: Tensor,
        robot: Spheres,
    ) -> tuple[Tensor, Tensor]:
        """Smallest gap to obstacles of the cover spheres of `robot` and object, (N,) each, from all bodies' frames."""
        if not self.has_obstacles:
            far = torch.full((len(xpos),), CLEAR_M, device=self.device)
            return far, far.clone()
        return (
            world.lowest_clearance(scene, xpos, xmat, robot, torch.zeros_like(model)),
            world.lowest_clearance(scene, xpos, xmat, self.object_cover, model),
        )
