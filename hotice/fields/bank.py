"""Fields of many scenes at once, sampled by scene index: what the batched simulator uses."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from hotice.errors import InvalidConfig, UnknownName
from hotice.fields import cache as cached
from hotice.fields import clearance, sample, torch_sample
from hotice.fields.clearance import Spheres
from hotice.fields.defaults import MARGIN_M, RESOLUTION_M
from hotice.fields.hod_pf import check_margin
from hotice.fields.potential import FieldParams
from hotice.fields.reachability import check_reachable, joins_start
from hotice.fields.volumes import SceneNodes, Volumes, solve_scene, stack
from hotice.machine import usable_cores
from hotice.model.scene import Scene
from hotice.progress import counted

FIELDS = ("sgf", "ogf")


class FieldSample(NamedTuple):
    """Force (N, K, 3), distance to the field's own (inflated) obstacles and geodesic distance to the goal (N, K) [m].

    The geodesic distance is finite also where no path leads.
    """

    force_W: Tensor
    signed_distance: Tensor
    geodesic: Tensor


class FieldBank:
    """SGF and OGF of S scenes, whose extents may differ. Build with `FieldBank.build`: of what stands still.

    `names`, `goal_W` (S, 3) [m], `start` (S, 3) x, y [m], yaw [rad]. On the CPU queries run compiled and without copies
    and carry no gradient; on other devices in torch. Scene ids are checked on the CPU only.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        volumes: Volumes,
        margin_m: float,
        params: FieldParams,
        device: torch.device | str = "cpu",
    ) -> None:
        self.scenes = tuple(scenes)
        self.names = [s.name for s in scenes]
        self.margin_m = margin_m
        self.params = params
        self.device = torch.device(device)
        self.volumes = volumes
        self.goal_W = torch.tensor(np.array([s.goal_W for s in scenes]), dtype=torch.float32, device=device)
        self.start = torch.tensor(np.array([s.start for s in scenes]), dtype=torch.float32, device=device)
        self._torch = None if self.device.type == "cpu" else torch_sample.TorchVolumes.of(volumes, device)

    @classmethod
    def build(
        cls,
        scenes: Sequence[Scene],
        resolution_m: float = RESOLUTION_M,
        margin_m: float = MARGIN_M,
        params: FieldParams | None = None,
        progress: bool = False,
        workers: int | None = None,
        cache: Path | None = None,
    ) -> FieldBank:
        """Solves every scene, without what moves in it.

        `workers` at a time (default: one for each usable core), with a progress bar when asked.

        With `cache`, a folder (see `hotice.fields.cache.default_folder`), solved scenes are kept there, those found
        there are not solved again, and the bank is mapped from there into memory.

        Raises `InvalidConfig` without scenes or for a resolution or margin outside the allowed range, `UnreachableGoal`
        for a scene without a way to its goal, `OutputError` for a cache that cannot be written.
        """
        scenes = list(scenes)
        if not scenes:
            raise InvalidConfig("no scenes: a field bank needs at least one")
        margin_m = check_margin(margin_m)
        margins_m = (0.0, margin_m)
        still = [scene.still() for scene in scenes]
        keys = [] if cache is None else [cached.scene_key(s, resolution_m, margins_m) for s in still]
        volumes = None if cache is None else cached.open_bank(cache, keys)
        if volumes is not None:
            return cls(scenes, volumes, margin_m, params or FieldParams())

        def solve(index: int) -> SceneNodes | None:
            if cache is not None and cached.load(cache, keys[index]) is not None:
                return None
            nodes = solve_scene(still[index], resolution_m, margins_m)
            if not all(joins_start(still[index], nodes.grid, reached) for reached in nodes.reached):
                check_reachable(still[index], resolution_m, margin_m)
            if cache is None:
                return nodes
            cached.save(cache, keys[index], nodes)
            return None

        pool = ThreadPoolExecutor(workers or usable_cores())
        try:
            work = pool.map(solve, range(len(scenes)))
            nodes = list(counted(work, "fields", len(scenes)) if progress else work)
        finally:
            pool.shutdown(cancel_futures=True)
        volumes = cached.make_bank(cache, keys) if cache is not None else stack([n for n in nodes if n is not None])
        return cls(scenes, volumes, margin_m, params or FieldParams())

    @property
    def num_scenes(self) -> int:
        """S."""
        return len(self.scenes)

    def to(self, device: torch.device | str) -> FieldBank:
        """The bank on another device (itself when it is there already)."""
        device = torch.device(device)
        if device == self.device:
            return self
        return FieldBank(self.scenes, self.volumes, self.margin_m, self.params, device)

    def index(self, name: str) -> int:
        """Id of a scene. Raises `UnknownName`."""
        if name not in self.names:
            raise UnknownName("scene", name, self.names)
        return self.names.index(name)

    def sample(self, field: str, scene_ids: Tensor, p_W: Tensor) -> FieldSample:
        """Field "sgf" or "ogf" at p_W (N, K, 3) float32 in W [m] of scenes (N,) int64. Raises `UnknownName`."""
        return self._sample(field, scene_ids, p_W)

    def _sample(self, field: str, scene_ids: Tensor, p_W: Tensor, *, repel: bool = True) -> FieldSample:
        if field not in FIELDS:
            raise UnknownName("field", field, FIELDS)
        which = FIELDS.index(field)
        margin_m = self.margin_m if which else 0.0
        scene_ids, p_W = self._check(scene_ids, p_W)
        if self._torch is not None:
            return FieldSample(
                *torch_sample.sample_field(self._torch, which, margin_m, self.params, scene_ids, p_W, repel=repel)
            )
        out = FieldSample(torch.empty_like(p_W), p_W.new_empty(p_W.shape[:2]), p_W.new_empty(p_W.shape[:2]))
        buffers = (t.numpy() for t in out)
        sample.sample_field(
            self.volumes, which, margin_m, self.params, scene_ids.numpy(), p_W.numpy(), *buffers, repel=repel
        )
        return out

    def attraction(self, field: str, scene_ids: Tensor, p_W: Tensor) -> FieldSample:
        """As `sample`, without the repulsive part of the force: -eta grad D_geo. Raises `UnknownName`."""
        return self._sample(field, scene_ids, p_W, repel=False)

    def signed_distance(self, scene_ids: Tensor, p_W: Tensor) -> Tensor:
        """Distance to the scene's own, uninflated obstacles, (N,), (N, K, 3) in W [m] -> (N, K) [m]."""
        scene_ids, p_W = self._check(scene_ids, p_W)
        if self._torch is not None:
            return torch_sample.sample_distance(self._torch, scene_ids, p_W)
        out = p_W.new_empty(p_W.shape[:2])
        sample.sample_distance(self.volumes, scene_ids.numpy(), p_W.numpy(), out.numpy())
        return out

    def lowest_clearance(
        self, scene_ids: Tensor, xpos: Tensor, xmat: Tensor, spheres: Spheres, variant: Tensor
    ) -> Tensor:
        """Smallest gap between spheres on frames and the scene's own obstacles, (N,) [m]; negative: one intrudes.

        Args:
            scene_ids (N,). xpos (N, B, 3) [m], xmat (N, B, 3, 3): frames in W, float32.
            spheres: on those frames. variant (N,): which of their variants each environment has.
        """
        scene_ids, xpos = self._check(scene_ids, xpos)
        if self._torch is not None:
            return clearance.lowest_clearance_torch(self._torch, scene_ids, xpos, xmat, spheres, variant)
        out = xpos.new_empty(len(xpos))
        clearance.lowest_clearance(
            self.volumes,
            scene_ids.numpy(),
            xpos.numpy(),
            xmat.detach().float().contiguous().numpy(),
            spheres,
            variant.numpy(),
            out.numpy(),
        )
        return out

    def _check(self, scene_ids: Tensor, p_W: Tensor) -> tuple[Tensor, Tensor]:
        if p_W.ndim != 3 or p_W.shape[2] != 3 or scene_ids.shape != p_W.shape[:1]:
            shapes = f"scene_ids {tuple(scene_ids.shape)}, p_W {tuple(p_W.shape)}"
            raise ValueError(f"{shapes}: (N,) and (N, K, 3) are needed")
        if self._torch is not None:
            return scene_ids, p_W
        scene_ids = scene_ids.detach().to(dtype=torch.int64).contiguous()
        low, high = (int(scene_ids.min()), int(scene_ids.max())) if len(scene_ids) else (0, 0)
        if low < 0 or high >= self.num_scenes:
            raise IndexError(f"scene ids {low} .. {high}: the bank holds 0 .. {self.num_scenes - 1}")
        return scene_ids, p_W.detach().to(dtype=torch.float32).contiguous()
