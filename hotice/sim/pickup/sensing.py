"""Sensing of a robot that picks up: as in transport, but for the object's pose.

That is filtered in the frame of the feet, where an object on its support rests while the pelvis moves, and it is lost
now and then: the last estimate counts until it is found again.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from hotice.model.picks.book import TRACK_PLACE, TRACK_RATE
from hotice.sim.pickup.snapshot import PickSnapshot
from hotice.sim.sensing import Sensors
from hotice.sim.snapshot import FEET
from hotice.task.pickup import LOST_EVERY_S, LOST_S


class PickSensors(Sensors):
    """`lost` (N,): control steps for which the object is still not seen. `felt` (N, 4): offset and rate of the pelvis.

    The latter come from encoders and tilt by the filter of `hotice.model.picks.book`, which a playback has too.
    """

    lost: Tensor
    felt: Tensor

    def begin(self) -> None:
        """Makes room for what the pick-up has beside the common sensing."""
        self.lost = torch.zeros_like(self.age)
        self.felt = torch.zeros(len(self.age), 4, device=self.age.device)

    def state(self) -> dict[str, Tensor]:
        return super().state() | {"lost": self.lost.clone(), "felt": self.felt.clone()}

    def load_state(self, state: dict[str, Tensor]) -> None:
        self.lost.copy_(state["lost"])
        self.felt.copy_(state["felt"])
        super().load_state({k: v for k, v in state.items() if k not in ("lost", "felt")})

    def restart(self, ids: Tensor, generator: torch.Generator) -> None:
        super().restart(ids, generator)
        self.lost[ids] = 0

    def measure(self, s: Any, ids: Tensor, joint_offset: Tensor, generator: torch.Generator) -> Any:
        if self.config.object_pos_m:
            draw, length = (torch.rand(len(ids), generator=generator, device=ids.device) for _ in range(2))
            steps = 1 + (length * LOST_S / self.dt_s).long()
            begins = (draw < self.dt_s / LOST_EVERY_S) & (self.lost[ids] == 0)
            self.lost[ids] = torch.where(begins, steps, (self.lost[ids] - 1).clamp(min=0))
        measured: Any = super().measure(s, ids, joint_offset, generator)
        return replace(measured, felt=self._feel(s, measured, ids))

    def _feel(self, s: PickSnapshot, measured: PickSnapshot, ids: Tensor) -> Tensor:
        """Offset and rate (n, 4) of the pelvis over the feet after the newest measurement."""
        offset = s.felt[:, :2] + _over_feet(measured) - _over_feet(s)
        before, rate = self.felt[ids].split(2, dim=1)
        foreseen = before + self.dt_s * rate
        first = (self.age[ids] == 1)[:, None]
        off = offset - foreseen
        place = torch.where(first, offset, foreseen + TRACK_PLACE * off)
        rate = torch.where(first, torch.zeros_like(rate), rate + TRACK_RATE / self.dt_s * off)
        self.felt[ids] = torch.cat([place, rate], dim=1)
        return self.felt[ids]

    def _filtered(self, s: Any, ids: Tensor, p_PO: Tensor, R_WO: Tensor) -> tuple[Tensor, Tensor]:
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


def _over_feet(s: PickSnapshot) -> Tensor:
    """Horizontal way from the middle of the feet to the pelvis, in Y, (N, 2) [m]."""
    return s.to_yaw_frame(s.p_WP - s.p_WK[:, FEET].mean(dim=1))[:, :2]
