"""Source of a scene: the map file, and the transform by which a pose in that map becomes one in the scene.

A robot that localizes itself in the map (a pose in the map's own frame and unit) needs it to know where it is in the
scene.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hotice import checks
from hotice.checks import Range, shown
from hotice.errors import InvalidScene
from hotice.model.frames import Array, mat_to_quat, quat_mul, quat_rotate

KEYS = ("file", "sha256", "unit_m", "position_m", "quaternion_wxyz")
FARTHEST_M = 1e9
UNIT = Range(above=0, most=FARTHEST_M, note="metres per unit of the map")
POSITION = Range(least=-FARTHEST_M, most=FARTHEST_M)
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, kw_only=True)
class MapSource:
    """A map's file M and its place in the scene: p_W = R_WM (unit_m p_M) + position_m. Raises `InvalidScene`."""

    file: str
    """Name of the map's file, without its folder."""
    sha256: str
    """Digest of the file's bytes, 64 lower-case hexadecimal digits: tells which map the transform is for."""
    unit_m: float
    """Metres per unit of the file."""
    position_m: tuple[float, float, float]
    """The map's origin in W [m]."""
    quaternion_wxyz: tuple[float, float, float, float]
    """R_WM: from the map's axes, as the file has them, to W's."""

    def __post_init__(self) -> None:
        if not isinstance(self.file, str) or not 0 < len(self.file) <= 255 or "/" in self.file or "\0" in self.file:
            raise InvalidScene(f"source file is {shown(self.file)}: the name of a file, without a folder, is needed")
        if not isinstance(self.sha256, str) or not _SHA256.fullmatch(self.sha256):
            raise InvalidScene(f"source sha256 is {shown(self.sha256)}: 64 lower-case hexadecimal digits are needed")
        object.__setattr__(self, "unit_m", checks.number("source unit_m", self.unit_m, UNIT, InvalidScene))
        position = checks.vector("source position_m", self.position_m, 3, POSITION, InvalidScene)
        object.__setattr__(self, "position_m", position)
        quat = checks.unit_quaternion("source quaternion_wxyz", self.quaternion_wxyz, InvalidScene)
        object.__setattr__(self, "quaternion_wxyz", quat)

    @classmethod
    def of(cls, *, file: str, sha256: str, unit_m: float, R_WM: ArrayLike, position_m: ArrayLike) -> MapSource:
        """From a rotation matrix (3, 3) and a translation (3,) [m]."""
        quat, position = np.asarray(mat_to_quat(np.asarray(R_WM, dtype=float))), np.asarray(position_m, dtype=float)
        return cls(
            file=file,
            sha256=sha256,
            unit_m=unit_m,
            position_m=tuple(position.tolist()),
            quaternion_wxyz=tuple(quat.tolist()),
        )

    def to_scene(self, p_M: ArrayLike) -> Array:
        """Points (..., 3) in the map's frame and unit -> (..., 3) in W [m]."""
        return quat_rotate(np.array(self.quaternion_wxyz), self.unit_m * np.asarray(p_M, dtype=float)) + self.position_m

    def pose_to_scene(self, p_MB: ArrayLike, quat_MB: ArrayLike) -> tuple[Array, Array]:
        """Pose of a body B in the map (position in its unit; quaternion wxyz) -> position [m] and quaternion in W."""
        return self.to_scene(p_MB), quat_mul(np.array(self.quaternion_wxyz), np.asarray(quat_MB, dtype=float))

    def moved(self, position_m: ArrayLike, quaternion_wxyz: ArrayLike) -> MapSource:
        """The source of a scene whose frame V is another one, given the pose X_VW of this scene's frame W in it."""
        quat = np.asarray(quaternion_wxyz, dtype=float)
        position = quat_rotate(quat, np.array(self.position_m)) + np.asarray(position_m, dtype=float)
        turned = quat_mul(quat, np.array(self.quaternion_wxyz))
        return replace(
            self, position_m=tuple(position.tolist()), quaternion_wxyz=tuple((turned / np.linalg.norm(turned)).tolist())
        )

    def to_dict(self) -> dict[str, Any]:
        """The `source` entry of a scene file."""
        return {k: list(v) if isinstance(v := getattr(self, k), tuple) else v for k in KEYS}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> MapSource:
        """Inverse of `to_dict`. Raises `InvalidScene`."""
        checks.mapping("source", data, KEYS, error=InvalidScene)
        return cls(**{key: data[key] for key in KEYS})
