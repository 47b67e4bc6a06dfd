"""`hotice tag-camera`: reads a camera, sends the corners of tags, and says what became of its pictures."""

from __future__ import annotations

import math
from contextlib import closing

from rich.table import Table

from hotice.commands.signals import stopped_by_signals
from hotice.commands.tags_config import TagCameraConfig
from hotice.console import PlainConsole
from hotice.deploy.clock import Clock, MonotonicClock
from hotice.deploy.sources.udp import UdpSender
from hotice.deploy.tags.bundle import box_ids
from hotice.deploy.tags.cameras import FolderCamera, FrameSource
from hotice.deploy.tags.detector import TagDetector
from hotice.deploy.tags.markers import opencv
from hotice.deploy.tags.realsense import RealSenseCamera
from hotice.deploy.tags.watch import in_words, watch_tags

REALSENSE = "realsense"


def tag_camera(config: TagCameraConfig) -> None:
    """Lives until its time or its pictures are over, or Ctrl-C. Raises `HoticeError`."""
    console, clock, stopped = PlainConsole(), MonotonicClock(), []
    # the other cores are the guard's and the runner's
    opencv().setNumThreads(1)
    detector = TagDetector(box_ids(config.first_id))
    with (
        closing(UdpSender(config.port, host=config.host)) as sender,
        closing(_opened(config, clock)) as frames,
        stopped_by_signals(stopped),
    ):
        console.print(f"tags of {config.camera} to UDP {config.host}:{config.port}; Ctrl-C ends")
        end_s = math.inf if config.duration_s is None else clock.now() + config.duration_s
        watched = watch_tags(frames, detector, sender, clock, stopped=lambda: bool(stopped) or clock.now() >= end_s)
    table = Table("", "", title="camera", show_header=False)
    for row in in_words(watched):
        table.add_row(*row)
    console.print(table)


def _opened(config: TagCameraConfig, clock: Clock) -> FrameSource:
    if config.camera == REALSENSE:
        return RealSenseCamera(rate_hz=config.rate_hz)
    return FolderCamera(config.camera, clock, rate_hz=config.rate_hz)
