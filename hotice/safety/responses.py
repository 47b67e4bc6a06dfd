"""The answer to each fault, by how long it has lasted."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from hotice.safety.faults import Answer, Fault
from hotice.safety.limits import FALLING_S

PASS, STOP, REPEAT, HOLD, DAMP = Answer
_BOX = ((0.0, PASS), (0.5, STOP))
_STATE = ((0.0, REPEAT), (0.05, DAMP))
_OLD = ((0.0, PASS), (0.05, DAMP))
_CONTROLLER = ((0.0, REPEAT), (0.06, DAMP))
_FALL = ((0.0, DAMP),)
# two measurements say so, not one
_FALLING = ((0.0, PASS), (FALLING_S, DAMP))
RESPONSES: Mapping[Fault, tuple[tuple[float, Answer], ...]] = MappingProxyType(
    {
        Fault.BOX_LATE: _BOX,
        Fault.BOX_INVALID: _BOX,
        Fault.BOX_JUMP: _BOX,
        Fault.POSE_LATE: ((0.0, PASS), (1.0, STOP)),
        Fault.POSE_INVALID: ((0.0, PASS), (0.3, STOP)),
        Fault.POSE_JUMP: ((0.0, PASS), (0.1, STOP)),
        Fault.GUIDANCE_INVALID: ((0.0, STOP),),
        Fault.JOINT_LIMIT: ((0.0, PASS), (0.1, DAMP)),
        Fault.COMMAND_LATE: _CONTROLLER,
        Fault.OBSERVATION_INVALID: _CONTROLLER,
        Fault.ACTION_INVALID: _CONTROLLER,
        Fault.CONTROLLER_ERROR: _CONTROLLER,
        Fault.COMMAND_STEP: _CONTROLLER,
        Fault.COMMAND_RANGE: _CONTROLLER,
        Fault.COMMAND_NOT_FINITE: _CONTROLLER,
        Fault.STATE_LATE: _OLD,
        Fault.STATE_FROZEN: _OLD,
        Fault.STATE_MISSING: _OLD,
        Fault.STATE_IMPOSSIBLE: _STATE,
        Fault.QUATERNION: _STATE,
        Fault.STATE_NOT_FINITE: _STATE,
        Fault.FALLING: _FALLING,
        Fault.JOINT_SPEED: _FALL,
        Fault.GYRO: _FALL,
        Fault.PELVIS_LOW: _FALL,
        Fault.TILT: _FALL,
    }
)
"""Answers and the times since the cause [s] from which each holds. Where a cause has an age (late, frozen), the time is
that age. A robot that stands still is not damped because its controller fails: see `STILL_HOLDS`; one that walks is,
since in a stiff posture its joints leap and it topples like a board (docs/station.md)."""
STILL_HOLDS = frozenset(fault for fault, response in RESPONSES.items() if response is _CONTROLLER)
"""Faults under which a robot that stands still goes on holding its posture instead of damping, until it topples."""


def response_table() -> np.ndarray:
    """(faults, answers) time since the cause [s] from which each answer holds, inf: never."""
    table = np.full((len(Fault), len(Answer)), np.inf)
    for fault, response in RESPONSES.items():
        for from_s, answer in response:
            table[fault, answer] = from_s
    return table


def still_table() -> np.ndarray:
    """(faults,) bool: whether each is in `STILL_HOLDS`."""
    return np.array([fault in STILL_HOLDS for fault in Fault])
