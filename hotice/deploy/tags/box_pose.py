"""Pose of a box from the corners of its tags: all of them at once, judged by what is known of the robot.

SQPNP finds the least squares on the rotation, Levenberg-Marquardt polishes it. A plane seen from nearly in front has
a second pose, its mirror about the line of sight, with corners almost as near: it is polished too, and where noise may
have made the difference, the one with the box's upper side up counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.checks import Range
from hotice.deploy.camera import HEAD_CAMERA, Camera
from hotice.deploy.frames import Pose
from hotice.deploy.tags.bundle import TagBundle
from hotice.deploy.tags.markers import opencv

Array = NDArray[np.float64]
Verdict = Literal["ok", "none seen", "too few corners", "error too large", "against the prior", "too far"]
"""What a picture says of the box; a pose comes with "ok" alone."""


@dataclass(frozen=True, kw_only=True)
class BoxPoseConfig:
    """Limits of a box's pose. Raises `InvalidConfig`."""

    least_tags: int = 1
    """Tags of the bundle, of four corners each."""
    most_error_px: float = 2.0
    """Root mean square of the distances of corners from where the pose has them."""
    most_lean_rad: float = math.radians(60.0)
    """Of the box's up axis from up."""
    most_turn_rad: float = math.radians(90.0)
    """Of the box's ahead axis from the robot's: a sheet glued upside down turns it by half a turn."""
    noise_px: float = 0.5
    """Standard deviation of a corner's coordinate, by which the two poses of a plane are told apart."""
    most_doubt: float = 25.0
    """Of two poses the further one is doubted beyond this difference of squared errors, in units of the noise's."""
    farthest_m: float = 1.5
    """From camera to box: beyond, a corner's noise is too much."""

    def __post_init__(self) -> None:
        checks.whole("least_tags", self.least_tags, Range(least=1, most=8))
        checks.numbers(
            self,
            checks.POSITIVE,
            "most_error_px",
            "most_lean_rad",
            "most_turn_rad",
            "noise_px",
            "most_doubt",
            "farthest_m",
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxSighting:
    """What one picture says of the box."""

    verdict: Verdict
    tags: int
    """Tags of the bundle in the picture."""
    X_PO: Pose | None = None
    """The box in the pelvis; None unless the verdict is "ok"."""
    error_px: float = math.nan
    """Root mean square of the corners' distances, of the pose that was judged."""


class _Candidate(NamedTuple):
    X_CO: Pose
    error_px: float


class BoxPoser:
    """Solves for a box's pose in the pelvis."""

    def __init__(self, bundle: TagBundle, *, camera: Camera = HEAD_CAMERA, config: BoxPoseConfig | None = None) -> None:
        """Raises `MissingExtra` without OpenCV."""
        self._cv2 = opencv()
        self._bundle, self._config = bundle, config or BoxPoseConfig()
        self._row = {tag: row for row, tag in enumerate(bundle.ids)}
        self._K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])

    def solve(self, ids: ArrayLike, corners_px: ArrayLike, X_PC: Pose, up_P: ArrayLike) -> BoxSighting:
        """The box from tags (T,) and their corners (T, 4, 2).

        X_PC: the camera in the pelvis when the picture was taken (`camera_in_pelvis` of the measured waist).
        up_P: up in the pelvis, (3,), from the IMU. Ids that the bundle does not have are left out.
        """
        rows, known = self._known(ids)
        tags, config = len(rows), self._config
        if not tags:
            return BoxSighting(verdict="none seen", tags=0)
        if tags < config.least_tags:
            return BoxSighting(verdict="too few corners", tags=tags)
        p_O = self._bundle.corners_O[rows].reshape(-1, 3)
        pixels = np.asarray(corners_px, dtype=float)[known].reshape(-1, 2)
        found = self._candidates(p_O, pixels, self._bundle.normals_O[rows])
        least_px = min((each.error_px for each in found), default=math.inf)
        if not least_px <= config.most_error_px:
            return BoxSighting(verdict="error too large", tags=tags, error_px=least_px)
        doubtful_px = math.sqrt(least_px**2 + config.most_doubt * config.noise_px**2 / len(p_O))
        near = [each for each in found if each.error_px <= min(config.most_error_px, doubtful_px)]
        possible = [each for each in near if self._possible(X_PC.R @ each.X_CO.R, np.asarray(up_P, dtype=float))]
        if not possible:
            return BoxSighting(verdict="against the prior", tags=tags, error_px=least_px)
        best = min(possible, key=lambda each: each.error_px)
        if float(np.linalg.norm(best.X_CO.p)) > config.farthest_m:
            return BoxSighting(verdict="too far", tags=tags, error_px=best.error_px)
        return BoxSighting(verdict="ok", tags=tags, X_PO=X_PC @ best.X_CO, error_px=best.error_px)

    def _possible(self, R_PO: Array, up_P: Array) -> bool:
        """Whether the box is upright enough, and not turned round."""
        up, ahead = float(R_PO[:, 2] @ up_P) / float(np.linalg.norm(up_P)), float(R_PO[0, 0])
        return up >= math.cos(self._config.most_lean_rad) and ahead >= math.cos(self._config.most_turn_rad)

    def _known(self, ids: ArrayLike) -> tuple[list[int], list[int]]:
        """Rows of the bundle, and places among the ids, of the tags that belong to it."""
        pairs = [(self._row[tag], k) for k, tag in enumerate(np.asarray(ids).tolist()) if tag in self._row]
        return [row for row, _ in pairs], [k for _, k in pairs]

    def _candidates(self, p_O: Array, pixels: Array, normals_O: Array) -> list[_Candidate]:
        """The pose, and the mirrored one of a single plane."""
        cv2 = self._cv2
        try:
            solved, rvec, tvec = cv2.solvePnP(p_O, pixels, self._K, None, flags=cv2.SOLVEPNP_SQPNP)
        except cv2.error:
            # corners that coincide or lie on a line
            return []
        if not solved:
            return []
        first = self._polished(p_O, pixels, rvec, tvec)
        if (normals_O != normals_O[0]).any():
            return [first]
        middle = p_O.mean(axis=0)
        return [first, self._polished(p_O, pixels, *_mirror(first.X_CO, normals_O[0], middle, cv2))]

    def _polished(self, p_O: Array, pixels: Array, rvec: Array, tvec: Array) -> _Candidate:
        cv2 = self._cv2
        rvec, tvec = cv2.solvePnPRefineLM(p_O, pixels, self._K, None, rvec, tvec)
        X_CO = Pose(cv2.Rodrigues(rvec)[0], np.ravel(tvec))
        p_C = X_CO.points(p_O)
        if not (p_C[:, 2] > 0.0).all():
            return _Candidate(X_CO, math.inf)
        off = (p_C @ self._K.T)[:, :2] / p_C[:, 2:] - pixels
        return _Candidate(X_CO, float(np.sqrt(np.mean(np.sum(off**2, axis=1)))))


def _mirror(X_CO: Pose, normal_O: Array, middle_O: Array, cv2) -> tuple[Array, Array]:
    """The pose whose plane leans the other way, seen along the line from the camera to its middle."""
    normal, middle = X_CO.R @ normal_O, X_CO.points(middle_O)
    sight = middle / np.linalg.norm(middle)
    other = 2.0 * (normal @ sight) * sight - normal
    axis = np.cross(normal, other)
    sine, cosine = float(np.linalg.norm(axis)), float(normal @ other)
    # seen from exactly in front there is one pose only
    turn = np.zeros(3) if sine < 1e-9 else axis / sine * math.atan2(sine, cosine)
    R = cv2.Rodrigues(turn)[0] @ X_CO.R
    return cv2.Rodrigues(R)[0], (middle - R @ middle_O)[:, None]
