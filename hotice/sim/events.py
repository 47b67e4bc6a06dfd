"""Events that come to episodes from outside: starts and pushes."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from hotice.fields.bank import FieldBank
from hotice.model import g1
from hotice.sim.carry_bank import CarryBank
from hotice.sim.physics.protocol import Physics
from hotice.sim.snapshot import Layout
from hotice.sim.stages import NearStarts, SmallObjects
from hotice.sim.starts import all_places
from hotice.task.config import TaskConfig
from hotice.task.pushes import push_velocity


class Starter:
    """Draws scene, object, place and heading of new episodes and writes their state.

    `near` and `small`, None at first, restrict places and objects for a curriculum: see `hold_back`.
    """

    def __init__(
        self, config: TaskConfig, bank: FieldBank, carry: CarryBank, layout: Layout, device: torch.device
    ) -> None:
        self.config, self.bank, self.carry, self.layout = config, bank, carry, layout
        self.scene_weight = torch.ones(bank.num_scenes, device=device)
        places = all_places(bank) if config.anywhere > 0 else [np.zeros((1, 3))] * bank.num_scenes
        self.places, self.place_count = _table(places, device)
        self.near: NearStarts | None = None
        self.small: SmallObjects | None = None

    def hold_back(self, *, far: bool, large: bool) -> None:
        """From the next episode on, starts come from `near`, objects from `small`, whose limits may then be set."""
        if far:
            usual = (self.places, self.place_count)
            table = usual if self.config.anywhere > 0 else _table(all_places(self.bank), self.places.device)
            self.near = NearStarts(self.bank, *table)
        if large:
            self.small = SmallObjects(self.carry.grasp)

    def draw_scenes(self, count: int, generator: torch.Generator) -> Tensor:
        """Scene ids (count,) in proportion to `scene_weight`."""
        return torch.multinomial(self.scene_weight, count, replacement=True, generator=generator)

    def write(self, physics: Physics, ids: Tensor, scene: Tensor, model: Tensor, generator: torch.Generator) -> None:
        """Puts environments `ids` into carry state `model` at a start of `scene`, at rest."""
        n, device, cfg = len(ids), scene.device, self.config

        def uniform(size: int, half: float) -> Tensor:
            return (2.0 * torch.rand(n, size, generator=generator, device=device) - 1.0) * half

        place = self.bank.start[scene].clone()
        place[:, :2] += uniform(2, cfg.start_noise_m)
        place[:, 2:] += uniform(1, cfg.start_yaw_noise_rad)
        if cfg.anywhere > 0 or self.near is not None:
            other = self._anywhere(scene, generator)
            other[:, :2] += uniform(2, cfg.start_noise_m)
            other[:, 2:] += uniform(1, cfg.anywhere_yaw_noise_rad)
            use = torch.rand(n, 1, generator=generator, device=device) < cfg.anywhere
            if self.near is not None:
                use |= self.near.too_far(scene)[:, None]
            place = torch.where(use, other, place)
        qpos = self.carry.qpos[model].clone()
        qpos[:, self.layout.q[g1.LOWER]] += uniform(12, cfg.joint_noise_rad).double()
        qpos[:, 2] += 0.003 + 0.25 * cfg.joint_noise_rad
        qpos[:, self.layout.object_q + 2] += 0.003 + 0.25 * cfg.joint_noise_rad
        turned = turn_about_root(qpos, place.double(), self.layout.object_q)
        physics.set_models(ids, model)
        physics.qpos[ids] = turned.to(physics.qpos.dtype)
        physics.qvel[ids] = 0.0
        physics.ctrl[ids] = self.carry.target[model].to(physics.ctrl.dtype)
        physics.forward(ids)

    def _anywhere(self, scene: Tensor, generator: torch.Generator) -> Tensor:
        """Places (n, 3) with room to stand in scenes (n,)."""
        if self.near is not None:
            return self.near.draw(scene, generator)
        pick = (torch.rand(len(scene), generator=generator, device=scene.device) * self.place_count[scene]).long()
        return self.places[scene, pick].clone()


def _table(places: list[np.ndarray], device: torch.device) -> tuple[Tensor, Tensor]:
    """Places of all scenes in one tensor (S, P, 3), and how many of its rows hold, (S,)."""
    table = np.zeros((len(places), max(len(p) for p in places), 3))
    for row, p in zip(table, places, strict=True):
        row[: len(p)] = p
    count = torch.tensor([len(p) for p in places], device=device)
    return torch.tensor(table, dtype=torch.float32, device=device), count


def turn_about_root(qpos: Tensor, place: Tensor, object_q: int) -> Tensor:
    """Moves states (n, nq) that head along +x to places (n, 3): x, y, yaw of the pelvis."""
    out = qpos.clone()
    cos, sin = torch.cos(place[:, 2]), torch.sin(place[:, 2])
    half = 0.5 * place[:, 2]
    w, z = torch.cos(half), torch.sin(half)
    offset = qpos[:, object_q : object_q + 2] - qpos[:, :2]
    out[:, :2] = place[:, :2]
    out[:, object_q] = place[:, 0] + cos * offset[:, 0] - sin * offset[:, 1]
    out[:, object_q + 1] = place[:, 1] + sin * offset[:, 0] + cos * offset[:, 1]
    for start in (3, object_q + 3):
        a, b, c, d = qpos[:, start : start + 4].unbind(1)
        out[:, start : start + 4] = torch.stack([w * a - z * d, w * b - z * c, w * c + z * b, w * d + z * a], dim=1)
    return out


def push(physics: Physics, config: TaskConfig, generator: torch.Generator) -> None:
    """Random horizontal kick of the root, every `push_interval_s` on average: 0.1 to 1 times `push_m_s`."""
    if config.push_m_s == 0.0:
        return
    hit, angle, share = (torch.rand(physics.num_envs, generator=generator, device=physics.device) for _ in range(3))
    change = push_velocity(hit, angle, share, config.push_m_s, config.control_dt_s / config.push_interval_s)
    physics.qvel[:, :2] += change.to(physics.qvel.dtype)
