"""Order of the joints: somebody moves one after another by hand, and states must say that it was that one."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.deploy.checkup.rows import Row
from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import Link
from hotice.deploy.messages.hg import JOINTS
from hotice.errors import UnknownName
from hotice.model import g1

Array = NDArray[np.float64]
MOVED_RAD = 0.25
"""So far a joint is to be moved; whoever moves one moves its neighbours a little as well."""
WATCHED_S = 0.5
"""From there on it is seen which joint moves furthest."""
CALM_RAD, CALM_S = 0.1, 1.0
"""The next joint is asked for once none has moved further than this for so long (encoders are noisy by 0.06)."""
READ_S = 0.01
PATIENCE = checks.Range(least=1, most=600, unit="s")


def check_joints(names: Sequence[str]) -> tuple[str, ...]:
    """The names, each a joint of the robot. Raises `UnknownName`."""
    for name in names:
        if name not in g1.ALL_JOINTS:
            raise UnknownName("joint", name, g1.ALL_JOINTS)
    return tuple(names)


def joint_rows(
    link: Link,
    clock: Clock,
    ask: Callable[[str], None],
    joints: Sequence[str] = g1.ALL_JOINTS,
    patience_s: float = 30.0,
) -> list[Row]:
    """A row for each joint: which one moved furthest when it was to be moved, and by how much.

    `ask` tells somebody to move a joint, by its name; each has `patience_s` [s]. Nothing is sent: the motors must be
    limp or braking. Raises `LinkError`, `UnknownName`, `InvalidConfig`.
    """
    checks.number("patience_s", patience_s, PATIENCE)
    rows = []
    for name in check_joints(joints):
        _await_calm(link, clock, patience_s)
        ask(name)
        rows.append(_row(name, _travels(link, clock, patience_s)))
    return rows


def _row(name: str, travel: Array) -> Row:
    """`travel` (29,): from where each joint was to where it was furthest from there [rad]."""
    furthest = int(np.abs(travel).argmax())
    moved = abs(travel[furthest]) >= MOVED_RAD
    said = f"{g1.ALL_JOINTS[furthest]} by {travel[furthest]:+.2f} rad" if moved else "none moved"
    passed = bool(moved and g1.ALL_JOINTS[furthest] == name)
    return Row(f"moved by hand: {name}", said, f"that one, by {MOVED_RAD:g} rad", passed)


def _travels(link: Link, clock: Clock, patience_s: float) -> Array:
    first, furthest = _angles(link), np.zeros(len(g1.ALL_JOINTS))
    end_s, found = clock.now() + patience_s, False
    while clock.now() < end_s:
        clock.sleep(READ_S)
        now = _angles(link)
        if now is None:
            continue
        first = now if first is None else first
        further = np.abs(now - first) > np.abs(furthest)
        furthest = np.where(further, now - first, furthest)
        if not found and np.abs(furthest).max() >= MOVED_RAD:
            found, end_s = True, clock.now() + WATCHED_S
    return furthest


def _await_calm(link: Link, clock: Clock, patience_s: float) -> None:
    past: deque[Array] = deque(maxlen=math.ceil(CALM_S / READ_S))
    end_s = clock.now() + patience_s
    while clock.now() < end_s:
        if (now := _angles(link)) is not None:
            past.append(now)
        if len(past) == past.maxlen and np.ptp(np.array(past), axis=0).max() <= CALM_RAD:
            return
        clock.sleep(READ_S)


def _angles(link: Link) -> Array | None:
    received = link.state()
    return None if received is None else received.record["motor_state"]["q"][JOINTS].astype(float)
