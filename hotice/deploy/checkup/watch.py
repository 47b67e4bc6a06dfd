"""Some seconds of a robot, as they came: states, localization, tags, and how late this machine's own timer was."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.deploy.clock import Clock
from hotice.deploy.guard.keys import Gamepad
from hotice.deploy.guard.loop import Lateness, run_loop
from hotice.deploy.link.protocol import Link
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import PoseSample, TagSample

RATE_HZ = 500.0
LONGEST = checks.Range(least=1, most=600, unit="s")


@dataclass(frozen=True, kw_only=True, eq=False)
class Observed:
    """What came in `seconds`, from `began_s` [s] on the clock of whoever watches."""

    began_s: float
    seconds: float
    states: tuple[np.ndarray, ...]
    """LowState records ()."""
    state_s: NDArray[np.float64]
    """When each came, (n,) [s]."""
    refused: int
    """States that did not open, or were impossible."""
    foreign_commands: int
    """Commands of somebody else."""
    gamepad: bool
    """Whether the newest state had one."""
    charge: float | None
    """Of the battery [percent]; None: it said none."""
    poses: tuple[PoseSample, ...]
    pose_s: NDArray[np.float64]
    tags: tuple[TagSample, ...]
    tag_s: NDArray[np.float64]
    lateness: Lateness
    """Of this machine's timer at the guard's rate."""


def watch_robot(
    link: Link,
    poses: Source[PoseSample],
    tags: Source[TagSample],
    clock: Clock,
    seconds: float,
    charge: Callable[[], float | None] = lambda: None,
) -> Observed:
    """Watches for some seconds; sends nothing. Raises `InvalidConfig`, and `LinkError` for what is closed."""
    checks.number("seconds", seconds, LONGEST)
    before, began_s = link.counts(), clock.now()
    end_s = began_s + seconds
    states: dict[int, tuple[float, np.ndarray]] = {}
    places: dict[int, tuple[float, PoseSample]] = {}
    pictures: dict[int, tuple[float, TagSample]] = {}
    gamepad = Gamepad()

    def tick() -> None:
        received = link.state()
        if received is not None and received.sequence not in states:
            states[received.sequence] = (received.received_s, received.record)
            gamepad.read(received.record["wireless_remote"], clock.now())
        if (pose := poses.newest()) is not None:
            places.setdefault(pose.number, (pose.received_s, pose.sample))
        if (picture := tags.newest()) is not None:
            pictures.setdefault(picture.number, (picture.received_s, picture.sample))
        charge()

    lateness = run_loop(tick, clock, RATE_HZ, lambda: clock.now() < end_s)
    after = link.counts()
    return Observed(
        began_s=began_s,
        seconds=seconds,
        states=tuple(record for _, record in states.values()),
        state_s=np.array([s for s, _ in states.values()]),
        refused=sum(after.refused.values()) - sum(before.refused.values()),
        foreign_commands=after.foreign_commands - before.foreign_commands,
        gamepad=gamepad.there,
        charge=charge(),
        poses=tuple(sample for _, sample in places.values()),
        pose_s=np.array([s for s, _ in places.values()]),
        tags=tuple(sample for _, sample in pictures.values()),
        tag_s=np.array([s for s, _ in pictures.values()]),
        lateness=lateness,
    )
