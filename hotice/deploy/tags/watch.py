"""The loop of the process that reads tags: picture, corners, datagram; and what became of it.

It knows neither robot nor box: the pose is solved by who has the waist and the IMU (`TagBox`). Whatever happens to
it, others see nothing but that tags grow old.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.sources.protocol import Sender
from hotice.deploy.sources.records import TagSample
from hotice.deploy.tags.cameras import BrokenFrame, FrameSource, as_head_camera
from hotice.deploy.tags.detector import TagDetector

MOST_BROKEN = 60
"""So many broken pictures in a row end the loop: the camera is gone, and has to be opened anew."""
REMEMBERED = 36_000
"""Pictures whose times are kept: 20 minutes at 30 a second."""


@dataclass(kw_only=True)
class Watched:
    """What became of a camera's pictures."""

    pictures: int = 0
    """Looked at."""
    with_tags: int = 0
    """Of these, with a tag of the bundle."""
    tags: int = 0
    foreign: int = 0
    doubled: int = 0
    """Tags whose id was there more than once."""
    broken: int = 0
    """Pictures that did not come or could not be read."""
    last_break: str = ""
    """Why the last of them could not."""
    unsent: int = 0
    """Samples that the network did not take."""
    began_s: float = 0.0
    ended_s: float = 0.0
    looked_s: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    """Time to find the tags of each of the last pictures."""
    age_s: deque[float] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    """From exposure until its sample was sent, of each of the last pictures."""

    @property
    def rate_hz(self) -> float:
        """Pictures a second; 0 before there are two."""
        lasted_s = self.ended_s - self.began_s
        return (self.pictures - 1) / lasted_s if self.pictures > 1 and lasted_s > 0.0 else 0.0


def watch_tags(
    frames: FrameSource,
    detector: TagDetector,
    sender: Sender,
    clock: Clock,
    *,
    stopped: Callable[[], bool] = lambda: False,
) -> Watched:
    """Sends a sample for every picture until there are no more, or `stopped` says so.

    Raises `BrokenFrame` when `MOST_BROKEN` pictures in a row are broken.
    """
    watched, in_a_row = Watched(), 0
    while not stopped():
        try:
            frame = frames.frame()
        except BrokenFrame as error:
            watched.broken, watched.last_break, in_a_row = watched.broken + 1, str(error), in_a_row + 1
            if in_a_row == MOST_BROKEN:
                raise BrokenFrame(f"{in_a_row} pictures in a row are broken, the last: {error}") from None
            continue
        if frame is None:
            break
        in_a_row, before_s = 0, clock.now()
        found = detector.detect(frame.picture)
        corners_px = as_head_camera(found.corners_px, frames.camera, frames.coefficients)
        looked_s = clock.now() - before_s
        sample = TagSample(number=watched.pictures, measured_s=frame.taken_s, ids=found.ids, corners_px=corners_px)
        try:
            sender.send(sample.encode())
        except LinkError:
            watched.unsent += 1
        now_s = clock.now()
        if not watched.pictures:
            watched.began_s = now_s
        watched.pictures, watched.ended_s = watched.pictures + 1, now_s
        watched.with_tags += len(found.ids) > 0
        watched.tags += len(found.ids)
        watched.foreign, watched.doubled = watched.foreign + found.foreign, watched.doubled + found.doubled
        watched.looked_s.append(looked_s)
        watched.age_s.append(now_s - frame.taken_s)
    return watched


def in_words(watched: Watched) -> list[tuple[str, str]]:
    """Lines of a table."""
    pictures = f"{watched.pictures}, {watched.rate_hz:.1f} a second; {watched.broken} broken"
    if watched.broken:
        pictures += f", the last: {watched.last_break}"
    seen = watched.with_tags / watched.pictures if watched.pictures else 0.0
    return [
        ("pictures", pictures),
        ("with tags", f"{100.0 * seen:.1f} %, {watched.tags} tags"),
        ("left out", f"{watched.foreign} foreign tags, {watched.doubled} whose id was there twice"),
        ("finding them", _spread_ms(watched.looked_s)),
        ("age when sent", _spread_ms(watched.age_s)),
        ("not sent", f"{watched.unsent}"),
    ]


def _spread_ms(times_s: Collection[float]) -> str:
    if not times_s:
        return "–"
    middle, most, worst = 1e3 * np.percentile(list(times_s), [50.0, 95.0, 100.0])
    return f"median {middle:.1f} ms, p95 {most:.1f} ms, worst {worst:.1f} ms"
