"""Fields of moments: geodesic distances of scenes as they are at regular times, for what is guided by the newest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import torch
from torch import Tensor

from hotice.fields.bank import FieldBank
from hotice.fields.volumes import SceneNodes, solve_scene, stack
from hotice.machine import usable_cores
from hotice.model.scene import MomentaryScene, Scene


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Fields of S scenes at times k / rate_hz, k = 0, 1, …, one scene after another in `bank`.

    first (S,): row of a scene's first moment; count (S,): its moments. Ways may be closed at some of them: the geodesic
    distance is then that by way of the nearest place from which one leads to the goal.
    """

    bank: FieldBank
    first: Tensor
    count: Tensor
    rate_hz: float

    @classmethod
    def of(cls, fields: FieldBank, rate_hz: float, until_s: float, workers: int | None = None) -> Moments:
        """Moments of the scenes of `fields`, with its grids and numbers, up to `until_s`; of what stands still, one.

        Takes some 0.1 s of a core, and 3 MB, a moment of the default scene. Raises `InvalidScene` as `build_hod_pf`.
        """
        volumes, margins_m = fields.volumes, (0.0, fields.margin_m)
        rows = [_moments(scene, rate_hz, until_s) for scene in fields.scenes]
        scenes = [moment for row in rows for moment in row]

        def solve(scene: MomentaryScene) -> SceneNodes:
            return solve_scene(scene, volumes.resolution_m, margins_m)

        with ThreadPoolExecutor(workers or usable_cores()) as pool:
            nodes = list(pool.map(solve, scenes))
        count = torch.tensor([len(row) for row in rows], device=fields.device)
        bank = FieldBank(scenes, stack(nodes), fields.margin_m, fields.params, fields.device)
        return cls(bank=bank, first=count.cumsum(0) - count, count=count, rate_hz=rate_hz)

    def index(self, scene: Tensor, time_s: Tensor) -> Tensor:
        """Row (N,) of `bank` that shows scenes (N,) at times (N,) [s], or the moment before."""
        # a hair more, as in `Courses.seen`
        k = torch.floor(time_s.clamp(min=0.0) * self.rate_hz + 1e-3).to(torch.int64)
        return self.first[scene] + torch.minimum(k, self.count[scene] - 1)


def _moments(scene: Scene, rate_hz: float, until_s: float) -> Sequence[MomentaryScene]:
    """A scene at all its moments; no more once nothing moves any more."""
    ends = [math.inf if o.motion.repeat == "loop" else o.motion.knots_s[-1] for o in scene.moving if o.motion]
    last = math.ceil(min(until_s, max(ends, default=0.0)) * rate_hz)
    return [scene.at(k / rate_hz) for k in range(last + 1)]
