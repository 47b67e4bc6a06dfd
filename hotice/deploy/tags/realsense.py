"""A RealSense camera's colour pictures, grey, with factory intrinsics. Never tried: no camera was at hand.

Written from librealsense's published interface; pyrealsense2 comes with the extra `realsense`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from hotice.deploy.camera import Camera
from hotice.deploy.tags.cameras import COEFFICIENTS, BrokenFrame, Frame
from hotice.deploy.tags.markers import opencv
from hotice.errors import MissingExtra, NotAvailable

WAIT_MS = 500
OLDEST_S = 1.0
"""A stamp that lies further back than this, or ahead of now, is another clock's."""


def _realsense() -> Any:
    """The package, imported when a camera is first opened. Raises `MissingExtra`."""
    try:
        import pyrealsense2  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise MissingExtra("the RealSense camera", "pyrealsense2", "realsense") from None
    return pyrealsense2


class RealSenseCamera:
    """The first camera that is plugged in; see `FrameSource`. Times are on the machine's monotonic clock."""

    def __init__(self, *, width: int = 640, height: int = 480, rate_hz: int = 30) -> None:
        """Raises `MissingExtra`; `NotAvailable` without a camera, or for a lens whose distortion is of another kind."""
        rs, self._cv2 = _realsense(), opencv()
        self._wall_clocks = (rs.timestamp_domain.global_time, rs.timestamp_domain.system_time)
        self._pipeline, config = rs.pipeline(), rs.config()
        config.enable_stream(rs.stream.color, width, height, rs.format.bgr8, rate_hz)
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise NotAvailable(
                f"no RealSense camera with {width} × {height} at {rate_hz}/s: {error}; is it plugged in, and no other "
                "program has it?"
            ) from None
        lens = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
        self.camera = Camera(fx=lens.fx, fy=lens.fy, cx=lens.ppx, cy=lens.ppy, width=lens.width, height=lens.height)
        self.coefficients: Sequence[float] = tuple(float(value) for value in lens.coeffs)
        if any(self.coefficients) and (
            lens.model != rs.distortion.inverse_brown_conrady or len(self.coefficients) != COEFFICIENTS
        ):
            self.close()
            raise NotAvailable(f"a lens of model {lens.model}: inverse Brown-Conrady, or no distortion, is known")

    def frame(self) -> Frame:
        try:
            color = self._pipeline.wait_for_frames(WAIT_MS).get_color_frame()
        except RuntimeError as error:
            raise BrokenFrame(f"no picture within {WAIT_MS} ms: {error}") from None
        now_s, wall_s = time.monotonic(), time.time()
        if not color:
            raise BrokenFrame("frames without a colour picture")
        picture = self._cv2.cvtColor(np.asanyarray(color.get_data()), self._cv2.COLOR_BGR2GRAY)
        # milliseconds of the machine's date, which librealsense keeps to the camera's clock
        age_s = wall_s - 1e-3 * color.get_timestamp()
        known = color.get_frame_timestamp_domain() in self._wall_clocks and 0.0 <= age_s < OLDEST_S
        return Frame(picture, now_s - age_s if known else now_s)

    def close(self) -> None:
        self._pipeline.stop()
