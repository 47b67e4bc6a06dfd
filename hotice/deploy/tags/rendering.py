"""Pictures of a box with its printed sheets, as the head camera takes them: for tests and measurements, no physics.

Each sheet is the page that is printed, seen through a homography and super-sampled; then blur and noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.camera import Camera
from hotice.deploy.frames import Pose
from hotice.deploy.tags.bundle import SHEET_M, TagFace, box_bundle
from hotice.deploy.tags.markers import opencv
from hotice.deploy.tags.sheet import INCH_MM, MIDDLE_MM, PAGE_MM, draw_sheet
from hotice.model.objects import Box

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
PIXELS_MM = 8
"""Pixels of a printed sheet for a millimetre: a cell of a tag is 50 of them."""
SUPER = 4
"""Rays for a pixel, each way."""
CARDBOARD, FLOOR = 150, 110
INK, PAPER = 25, 235
NEAREST_M = 0.02
"""What is nearer to the camera's plane is not drawn."""


@dataclass(frozen=True, kw_only=True)
class Optics:
    """What lies between a scene and its picture."""

    blur_px: float = 0.6
    """Standard deviation of a Gaussian."""
    noise: float = 4.0
    """Standard deviation of a pixel's grey value, of 255."""
    motion_px: float = 0.0
    """Length of a horizontal smear."""


NO_OPTICS = Optics(blur_px=0.0, noise=0.0)


def printed(sheet: Picture) -> Picture:
    """A sheet as it comes from the printer."""
    return sheet


def mirrored(sheet: Picture) -> Picture:
    """A sheet that was printed from its back."""
    return np.ascontiguousarray(sheet[:, ::-1])


def turned(sheet: Picture) -> Picture:
    """A sheet that was glued upside down."""
    return np.ascontiguousarray(sheet[::-1, ::-1])


class BoxPictures:
    """Takes pictures of one box."""

    def __init__(self, box: Box, camera: Camera, *, printing: Callable[[Picture], Picture] = printed) -> None:
        """`printing` changes the sheets. Raises `InvalidConfig` or `MissingExtra`."""
        self._box, self._camera, self._faces = box, camera, box_bundle(box).faces
        self._sheets = [_inked(printing(sheet_picture(face))) for face in self._faces]

    def take(
        self, X_CO: Pose, rng: np.random.Generator, *, optics: Optics | None = None, onto: Picture | None = None
    ) -> Picture:
        """Grey picture (height, width) of the box before a plain ground, or before what is in the picture `onto`.

        Only faces with a sheet are drawn, and a sheet only if all of it is ahead of the camera. What `onto` shows is
        blurred once more: take it with `NO_OPTICS`.
        """
        width, height = self._camera.width, self._camera.height
        ground = np.full((height, width), FLOOR, np.uint8) if onto is None else onto
        fine = np.repeat(np.repeat(ground, SUPER, axis=0), SUPER, axis=1)
        for face, sheet in zip(self._faces, self._sheets, strict=True):
            if (X_CO.R @ face.normal_O) @ X_CO.points(face.middle_O) < 0.0:
                self._paint(fine, face, sheet, X_CO)
        return _exposed(fine, optics or Optics(), rng)

    def _paint(self, fine: Picture, face: TagFace, sheet: Picture, X_CO: Pose) -> None:
        cv2, half = opencv(), self._box.half_extents_m
        middle, right, up = (axis * half for axis in (face.normal_O, face.right_O, face.up_O))
        corners = X_CO.points([middle - right - up, middle + right - up, middle + right + up, middle - right + up])
        if not len(seen := _ahead(corners)):
            return
        outline = SUPER * (self._camera.pixels(seen) + 0.5) - 0.5
        cv2.fillConvexPoly(fine, np.round(16.0 * outline).astype(np.int32), CARDBOARD, lineType=cv2.LINE_8, shift=4)
        diagonals = 0.5 * SHEET_M * np.array([[x * face.right_O + y * face.up_O for x in (-1, 1)] for y in (-1, 1)])
        if (X_CO.points(face.middle_O + diagonals)[..., 2] < NEAREST_M).any():
            return
        H = self._homography(face, len(sheet), X_CO)
        size = (fine.shape[1], fine.shape[0])
        cv2.warpPerspective(sheet, H, size, dst=fine, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT)

    def _homography(self, face: TagFace, pixels: int, X_CO: Pose) -> Array:
        """From pixels of a sheet (column, row, 1) to those of the fine picture, whole numbers at pixels' middles."""
        step, c = SHEET_M / pixels, self._camera
        corner = face.middle_O + 0.5 * SHEET_M * (face.up_O - face.right_O) + 0.5 * step * (face.right_O - face.up_O)
        on_O = np.stack([step * face.right_O, -step * face.up_O, corner], axis=1)
        on_C = X_CO.R @ on_O + np.outer(X_CO.p, [0.0, 0.0, 1.0])
        K = np.array([[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]])
        finer = np.array([[SUPER, 0.0, 0.5 * SUPER - 0.5], [0.0, SUPER, 0.5 * SUPER - 0.5], [0.0, 0.0, 1.0]])
        return finer @ K @ on_C


def sheet_picture(face: TagFace) -> Picture:
    """A face's sheet, cut out of its page, (1120, 1120): 8 pixels a millimetre. Raises `MissingExtra`."""
    page = page_picture(face)
    half = round(0.5e3 * SHEET_M * PIXELS_MM)
    column, row = round(MIDDLE_MM[0] * PIXELS_MM), round((PAGE_MM[1] - MIDDLE_MM[1]) * PIXELS_MM)
    return page[row - half : row + half, column - half : column + half]


def page_picture(face: TagFace) -> Picture:
    """A face's page as it is printed, grey, (2376, 1680): 8 pixels a millimetre. Raises `MissingExtra`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = draw_sheet(face, "")
    figure.set_dpi(PIXELS_MM * INCH_MM)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., 1].copy()


def _ahead(corners_C: Array) -> Array:
    """The part of a polygon (N, 3) that is ahead of the camera, (M, 3) [m]."""
    kept = []
    for a, b in zip(corners_C, np.roll(corners_C, -1, axis=0), strict=True):
        if a[2] >= NEAREST_M:
            kept.append(a)
        if (a[2] >= NEAREST_M) != (b[2] >= NEAREST_M):
            kept.append(a + (NEAREST_M - a[2]) / (b[2] - a[2]) * (b - a))
    return np.array(kept).reshape(-1, 3)


def _inked(sheet: Picture) -> Picture:
    return np.round(INK + (PAPER - INK) / 255.0 * sheet).astype(np.uint8)


def _exposed(fine: Picture, optics: Optics, rng: np.random.Generator) -> Picture:
    """Light of each pixel, smeared, blurred, with noise."""
    cv2 = opencv()
    size = (fine.shape[1] // SUPER, fine.shape[0] // SUPER)
    light = cv2.resize(fine, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    if optics.motion_px > 0.0:
        length = int(np.ceil(optics.motion_px)) | 1
        weights = np.clip(0.5 * optics.motion_px + 0.5 - np.abs(np.arange(length) - length // 2), 0.0, 1.0)
        light = cv2.filter2D(light, -1, (weights / weights.sum())[None])
    if optics.blur_px > 0.0:
        light = cv2.GaussianBlur(light, (0, 0), optics.blur_px)
    noisy = light + optics.noise * rng.standard_normal(light.shape, np.float32)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)
