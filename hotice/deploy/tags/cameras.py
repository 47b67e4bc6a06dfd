"""Cameras that the tags are read from: a protocol, and pictures in a folder; the RealSense is in a module of its own.

Corners are sent as `HEAD_CAMERA` would see them, without distortion: who reads them needs no camera's calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.deploy.camera import HEAD_CAMERA, Camera
from hotice.deploy.clock import Clock
from hotice.deploy.tags.markers import opencv
from hotice.errors import HoticeError, InputError
from hotice.files import is_folder, read_bytes

Array = NDArray[np.float64]
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
LARGEST_BYTES = 64_000_000
COEFFICIENTS = 5


class BrokenFrame(HoticeError):
    """A picture that did not come or cannot be used; the next one may."""


class Frame(NamedTuple):
    """A grey picture (height, width), and when it was exposed [s] on the reader's own clock."""

    picture: NDArray[np.uint8]
    taken_s: float


class FrameSource(Protocol):
    """A camera that gives one picture after the other."""

    @property
    def camera(self) -> Camera:
        """Its intrinsics."""
        ...

    @property
    def coefficients(self) -> Sequence[float]:
        """Of its distortion, see `as_head_camera`; none is a camera without."""
        ...

    def frame(self) -> Frame | None:
        """The next picture, waited for; None: there are no more. Raises `BrokenFrame`."""
        ...

    def close(self) -> None: ...


def as_head_camera(pixels: Array, camera: Camera, coefficients: Sequence[float] = ()) -> Array:
    """Pixels (..., 2) of a camera -> where `HEAD_CAMERA` sees the same rays, (..., 2).

    coefficients: (k1, k2, p1, p2, k3) of an inverse Brown-Conrady lens, whose polynomial leads from pixels to rays
    (librealsense, `rs2_deproject_pixel_to_point`).
    """
    x = (pixels[..., 0] - camera.cx) / camera.fx
    y = (pixels[..., 1] - camera.cy) / camera.fy
    if any(coefficients):
        k1, k2, p1, p2, k3 = coefficients
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
        )
    return HEAD_CAMERA.pixels(np.stack([x, y, np.ones_like(x)], axis=-1))


class FolderCamera:
    """Pictures of a folder in the order of their names, at a rate; see `FrameSource`."""

    coefficients: Sequence[float] = ()

    def __init__(
        self, folder: str | Path, clock: Clock, *, rate_hz: float = 30.0, camera: Camera = HEAD_CAMERA
    ) -> None:
        """Raises `InputError` for a folder without pictures, `InvalidConfig`, `MissingExtra`."""
        checks.number("rate_hz", rate_hz, checks.POSITIVE)
        if not is_folder(folder):
            raise InputError(f"{folder}: no folder; pictures are read from one")
        self._files = sorted(file for file in Path(folder).iterdir() if file.suffix.lower() in SUFFIXES)
        if not self._files:
            raise InputError(f"{folder}: no picture in it; names end in {', '.join(SUFFIXES)}")
        self._cv2, self._clock, self._period_s, self._taken = opencv(), clock, 1.0 / rate_hz, 0
        self._started_s: float | None = None
        self.camera = camera

    def frame(self) -> Frame | None:
        if self._taken == len(self._files):
            return None
        if self._started_s is None:
            self._started_s = self._clock.now()
        file, taken_s = self._files[self._taken], self._started_s + self._taken * self._period_s
        self._taken += 1
        self._clock.sleep(max(0.0, taken_s - self._clock.now()))
        return Frame(self._read(file), taken_s)

    def close(self) -> None:
        self._files = []
        self._taken = 0

    def _read(self, file: Path) -> NDArray[np.uint8]:
        try:
            data = np.frombuffer(read_bytes(file, LARGEST_BYTES), np.uint8)
            picture = self._cv2.imdecode(data, self._cv2.IMREAD_GRAYSCALE) if data.size else None
        except (InputError, self._cv2.error) as error:
            raise BrokenFrame(f"{file}: {error}") from None
        wished = (self.camera.height, self.camera.width)
        if picture is None or picture.shape != wished:
            came = "cannot be read" if picture is None else f"is {picture.shape[1]} × {picture.shape[0]}"
            raise BrokenFrame(f"{file}: {came}; a picture of {wished[1]} × {wished[0]} is needed")
        return picture
