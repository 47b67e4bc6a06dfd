"""Records of the slot: what the runner asks of the motors, and what the guard tells the runner."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hotice.deploy.messages.hg import LOW_STATE

JOINTS = 29

TARGETS = np.dtype(
    [
        ("number", "<u8"),
        ("stamp_s", "<f8"),
        ("state_sequence", "<u8"),
        ("q", "<f8", (JOINTS,)),
        ("tau", "<f8", (JOINTS,)),
        ("warm", "u1"),
        ("done", "u1"),
        ("pose_disputed", "u1"),
        ("movers_old", "u1"),
        ("reserved", "u1", (4,)),
        ("box_age_s", "<f8"),
        ("pose_age_s", "<f8"),
    ]
)
"""Runner to guard. `number` counts targets from 1; `stamp_s` is the monotonic clock when they were begun [s];
`state_sequence` says from which state; `q` [rad] and `tau` [N m] in the order of `g1.ALL_JOINTS`; `warm`: everything is
compiled; `done`: goal reached or task of the mode finished; `pose_disputed`: localization says another place than
tracking and stays with it; ages of what was last seen of box and of the world [s]: `pose_age_s` is of localization or,
`movers_old`, of what moves, which was seen longer ago. The runner's 20 joints come with waist and
wrists, which it holds where the carry state has them: one order of joints on the whole way to the motors."""

STATUS = np.dtype(
    [
        ("stamp_s", "<f8"),
        ("mode", "<u4"),
        ("cause", "<u4"),
        ("entered_s", "<f8"),
        ("sequence", "<u8"),
        ("received_s", "<f8"),
        ("state", LOW_STATE.dtype),
    ]
)
"""Guard to runner. `mode` and `cause` by number (`hotice.deploy.guard.modes`, `…faults`), the mode since `entered_s`;
`state`: the newest LowState, its `sequence` (0 before the first) and when it came; all times on the monotonic clock."""


class Channel(NamedTuple):
    """One way of the slot: what it holds and where."""

    dtype: np.dtype
    offset: int

    @property
    def size(self) -> int:
        """Bytes of its counter and of two records with their checksums."""
        return COUNTER + 2 * (CHECKSUM + self.dtype.itemsize)


HEADER = 64
"""Bytes before the first channel: the layout's mark."""
COUNTER, CHECKSUM = 8, 8
"""Bytes of a channel's counter and of a record's checksum, which stand before the records and before each."""
_ALIGN = 64


def _channels() -> tuple[Channel, Channel, int]:
    channels, end = [], HEADER
    for dtype in (TARGETS, STATUS):
        channels.append(Channel(dtype, end))
        end += channels[-1].size
        end += -end % _ALIGN
    return channels[0], channels[1], end


TARGETS_AT, STATUS_AT, SIZE = _channels()
MARK = f"hotice-slot/2 {TARGETS.itemsize} {STATUS.itemsize}".encode()
"""First bytes of a slot's file: programs of another layout do not share one."""
