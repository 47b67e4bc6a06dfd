"""What a robot sees move: an occupancy of the last second, cleared where rays pass, and the boxes that stand for it.

A scene that is known beforehand says what stands still; points of a lidar or a depth camera say what else is there now.
A voxel is occupied from a point in it until a later ray passes through it (Amanatides and Woo 1987), or until nobody
has seen it for a while. So what walked on is gone as soon as the sensor sees through where it was.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from hotice import checks
from hotice.checks import Range
from hotice.compiled import compiled
from hotice.model.importers.box_obstacles import box_obstacles
from hotice.model.importers.voxels import cover_by_boxes
from hotice.model.moving.still import only_still
from hotice.model.scene import Obstacle, Scene

Array = NDArray[np.float64]
_TOUCHING = ndimage.generate_binary_structure(3, 3)


@dataclass(frozen=True, kw_only=True)
class OccupancyConfig:
    """How points become obstacles. Raises `InvalidConfig`."""

    voxel_m: float = 0.06
    """Edge of a voxel [m]."""
    keep_s: float = 1.0
    """How long a voxel that no ray reaches any more stays occupied [s]."""
    known_m: float = 0.08
    """Points so near to a known obstacle are of it [m]: noise and drift of localization, and half a voxel."""
    floor_m: float = 0.08
    """Points below this height are of the floor [m]."""
    min_voxels: int = 3
    """Fewer occupied voxels that touch each other are noise."""

    def __post_init__(self) -> None:
        checks.number("voxel_m", self.voxel_m, Range(least=0.02, most=0.5, unit="m"))
        checks.number("keep_s", self.keep_s, Range(least=0.05, most=60, unit="s"))
        checks.number("known_m", self.known_m, Range(least=0, most=1, unit="m"))
        checks.number("floor_m", self.floor_m, Range(least=0, most=1, unit="m"))
        checks.whole("min_voxels", self.min_voxels, Range(least=1, most=1000))


class Occupancy:
    """Voxels over a scene's bounds, and when each was last hit and last seen through.

    The scene is what is known: its obstacles never become occupied, nor free. One that has gone stays known.
    """

    def __init__(self, scene: Scene, config: OccupancyConfig | None = None) -> None:
        """Raises `InvalidScene` for one in which something moves: that is to be seen, not known."""
        self.config = config or OccupancyConfig()
        self._low, self._high = (np.array(corner) for corner in only_still(scene, "an occupancy").bounds_m)
        size_m = self.config.voxel_m
        self._shape = tuple(int(n) for n in np.ceil((self._high - self._low) / size_m - 1e-9))
        index = np.stack(np.meshgrid(*map(np.arange, self._shape), indexing="ij"), axis=-1)
        centre = self._low + size_m * (index + 0.5)
        self._known = (scene.signed_distance(centre) < self.config.known_m) | (centre[..., 2] < self.config.floor_m)
        self._hit_s = np.full(self._shape, -np.inf)
        self._passed_s = np.full(self._shape, -np.inf)
        self.time_s = -np.inf
        """When it was last looked at [s]."""

    def look(self, eye_W: ArrayLike, points_W: ArrayLike, time_s: float, unhit_W: ArrayLike = ()) -> None:
        """Takes one scan: rays from `eye_W` (3,) to points (n, 3), all in W [m].

        Args:
            time_s: when it was made, not before the last one.
            unhit_W: (m, 3), places up to which rays have met nothing: they clear, and occupy nothing.

        Points that are not finite are left out, those outside the bounds clear what is on their way. Points of the
        robot and of what it carries are to be left out beforehand.

        Raises:
            ValueError: an eye that is not finite, arrays of other shapes, a time before the last one.
        """
        eye = np.asarray(eye_W, dtype=np.float64)
        points, unhit = (
            np.asarray(a, dtype=np.float64) if np.size(a) else np.empty((0, 3)) for a in (points_W, unhit_W)
        )
        if eye.shape != (3,) or not np.isfinite(eye).all():
            raise ValueError(f"eye_W is {eye.tolist()}: three finite coordinates are needed")
        for name, each in (("points_W", points), ("unhit_W", unhit)):
            if each.ndim != 2 or each.shape[1] != 3:
                raise ValueError(f"{name} has shape {each.shape}: (n, 3) is needed")
        if not np.isfinite(time_s) or time_s < self.time_s:
            raise ValueError(f"time_s is {time_s}: a finite time from {self.time_s:g} s on is needed")
        self.time_s = float(time_s)
        points, unhit = (each[np.isfinite(each).all(axis=1)] for each in (points, unhit))
        grid = (np.array(self._shape), self._low, self.config.voxel_m)
        for ends in (points, unhit):
            _pass(self._passed_s, *grid, eye, np.ascontiguousarray(ends), self.time_s)
        index = np.floor((points - self._low) / self.config.voxel_m).astype(np.int64)
        here = index[((index >= 0) & (index < self._shape)).all(axis=1)]
        # a scan's own points win over its rays, which graze what they hit
        self._hit_s[tuple(here.T)] = self._passed_s[tuple(here.T)] = self.time_s

    def occupied(self, time_s: float | None = None) -> NDArray[np.bool_]:
        """Voxels that something unknown occupies (nx, ny, nz), at `time_s`, by default that of the last scan."""
        now_s = self.time_s if time_s is None else time_s
        solid = (self._hit_s >= self._passed_s) & (self._hit_s >= now_s - self.config.keep_s) & ~self._known
        solid &= np.isfinite(self._hit_s)
        group, groups = cast(tuple[NDArray[np.int32], int], ndimage.label(solid, _TOUCHING))
        large = np.bincount(group.ravel(), minlength=groups + 1) >= self.config.min_voxels
        large[0] = False
        return large[group]

    def obstacles(self, time_s: float | None = None) -> tuple[Obstacle, ...]:
        """Boxes `seen_1`, `seen_2`, … whose union is what is occupied: for `LiveField.show` beside those known."""
        solid = self.occupied(time_s)
        return tuple(box_obstacles(solid, cover_by_boxes(solid), self._low, self._high, self.config.voxel_m, "seen_{}"))


@compiled(nogil=True, error_model="numpy")
def _pass(passed_s, shape, low, size_m, eye, ends, time_s):
    """Marks the voxels on the ways from `eye` to `ends` (n, 3), but the last one of each, as seen through."""
    for n in range(len(ends)):
        way = (ends[n] - eye) / size_m
        at = (eye - low) / size_m
        # part of the way within the grid
        start, stop = 0.0, 1.0
        for axis in range(3):
            if way[axis] == 0.0:
                if not 0.0 <= at[axis] < shape[axis]:
                    stop = -1.0
                continue
            f, g = -at[axis] / way[axis], (shape[axis] - at[axis]) / way[axis]
            start, stop = max(start, min(f, g)), min(stop, max(f, g))
        if start >= stop:
            continue
        voxel, step, border, last = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3), np.empty(3, np.int64)
        for axis in range(3):
            place = at[axis] + start * way[axis]
            voxel[axis] = min(max(int(np.floor(place)), 0), shape[axis] - 1)
            last[axis] = int(np.floor(at[axis] + way[axis]))
            step[axis] = 1 if way[axis] > 0.0 else -1
            ahead = voxel[axis] + (1 if way[axis] > 0.0 else 0)
            border[axis] = (ahead - at[axis]) / way[axis] if way[axis] != 0.0 else np.inf
        while True:
            if voxel[0] == last[0] and voxel[1] == last[1] and voxel[2] == last[2]:
                break
            passed_s[voxel[0], voxel[1], voxel[2]] = time_s
            axis = np.argmin(border)
            if border[axis] >= stop:
                break
            voxel[axis] += step[axis]
            if not 0 <= voxel[axis] < shape[axis]:
                break
            border[axis] += abs(1.0 / way[axis])
