"""Sight of obstacles that move: where who sees them now and then, and late, takes them to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hotice.model.frames import quat_from_yaw, quat_mul
from hotice.model.scene import Obstacle

_HAIR = 1e-3
"""The time of a control step is a multiple of neither period, and must not fall short by rounding."""


def newest_s(time_s: float, rate_hz: float) -> float:
    """When something was last done that is done `rate_hz` times a second, from 0 on [s]; below 0 for times before."""
    return math.floor(time_s * rate_hz + _HAIR) / rate_hz


def seen_moving(moving: Sequence[Obstacle], time_s: float, rate_hz: float, delay_s: float) -> tuple[Obstacle, ...]:
    """Obstacles as they are known at `time_s` [s] to who sees them `rate_hz` times a second, `delay_s` [s] late.

    Their velocity is what their last two places say, and they are taken to go on like that. Before the start of an
    episode they were where they are at its start. The twin of `hotice.fields.moving.course.Courses.seen`.
    """
    last = newest_s(time_s - delay_s, rate_hz)
    ahead = (time_s - max(last, 0.0)) * rate_hz
    return tuple(_gone_on(o.at(max(last - 1.0 / rate_hz, 0.0)), o.at(max(last, 0.0)), ahead) for o in moving)


def _gone_on(before: Obstacle, now: Obstacle, parts: float) -> Obstacle:
    """The obstacle after `parts` more of the step that brought it here, turning about the vertical through itself."""
    place = np.array(now.position_m) + parts * np.subtract(now.position_m, before.position_m)
    w, x, y, z = before.quaternion_wxyz
    step = quat_mul(now.quaternion_wxyz, (w, -x, -y, -z))
    turn = parts * math.remainder(2.0 * math.atan2(step[3], step[0]), 2.0 * math.pi)
    quat = quat_mul(quat_from_yaw(turn), now.quaternion_wxyz)
    return replace(now, position_m=tuple(place.tolist()), quaternion_wxyz=tuple(np.asarray(quat).tolist()))
