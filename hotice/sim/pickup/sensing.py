"""Sensing of a robot that picks up: as in transport, but for the object's pose.

That is filtered in the frame of the feet, where an object on its support rests while the pelvis moves, and it is lost
now and then: the last estimate counts until it is found again.
"""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.sim.sensing import Sensors
from hotice.task.pickup import LOST_EVERY_S, LOST_S


class PickSensors(Sensors):
    """`lost` (N,): control steps for which the object is still not seen."""

    lost: Tensor

    def state(self) -> dict[str, Tensor]:
        return super().state() | {"lost": self.lost.clone()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        self.lost.copy_(state["lost"])
        super().load_state({k: v for k, v in state.items() if k != "lost"})

    def restart(self, ids: Tensor, generator: torch.Generator) -> None:
        super().restart(ids, generator)
        self.lost[ids] = 0

    def measure(self, s, ids: Tensor, joint_offset: Tensor, generator: torch.Generator):
        if self.config.object_pos_m:
            draw, length = (torch.rand(len(ids), generator=generator, device=ids.device) for _ in range(2))
            steps = 1 + (length * LOST_S / self.dt_s).long()
            begins = (draw < self.dt_s / LOST_EVERY_S) & (self.lost[ids] == 0)
            self.lost[ids] = torch.where(begins, steps, (self.lost[ids] - 1).clamp(min=0))
        return super().measure(s, ids, joint_offset, generator)

    def _filtered(self, s, ids: Tensor, p_PO: Tensor, R_WO: Tensor) -> tuple[Tensor, Tensor]:
        newest = torch.cat([(s.p_WP + p_PO)[:, None], R_WO[:, :, :2].transpose(1, 2)], dim=1)
        age = self.age[ids]
        gain = torch.clamp(1.0 / age, min=self.gain)
        # The first measurement is always one: there is no estimate before it.
        gain = torch.where((self.lost[ids] > 0) & (age > 1), torch.zeros_like(gain), gain)[:, None, None]
        estimate = torch.lerp(self.object[ids], newest, gain)
        self.object[ids] = estimate
        p, x, y = estimate.unbind(1)
        x = x / x.norm(dim=1, keepdim=True)
        z = torch.linalg.cross(x, y)
        z = z / z.norm(dim=1, keepdim=True)
        return p - s.p_WP, torch.stack([x, torch.linalg.cross(z, x), z], dim=2)
