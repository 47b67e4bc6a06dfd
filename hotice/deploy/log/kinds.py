"""Kinds of entries in the logs of guard and runner, and what their headers say. All times are of one monotonic clock.

NumPy alone: the guard writes them, too. The parts of a percept and a reading are those of
`hotice.policy.percept.Percept` and `hotice.policy.guidance.FieldReading`, whose bytes these types read.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np

from hotice.deploy.messages.hg import LOW_CMD, LOW_STATE
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.deploy.sources.records import POSE, TAGS
from hotice.documents import parse_json
from hotice.errors import InputError

GUARD, RUNNER = "guard", "runner"
"""Names of the two logs in a folder."""

PERCEPT = np.dtype(
    [
        ("p_WP", "<f8", 3),
        ("yaw", "<f8", 1),
        ("gravity_P", "<f8", 3),
        ("w_WP_P", "<f8", 3),
        ("q", "<f8", 20),
        ("qd", "<f8", 20),
        ("p_WK", "<f8", (11, 3)),
        ("p_WO", "<f8", 3),
        ("R_WO", "<f8", (3, 3)),
        ("p_WOK", "<f8", (8, 3)),
    ]
)
READING = np.dtype(
    [
        ("force_W", "<f8", (19, 3)),
        ("distance", "<f8", 19),
        ("c_W", "<f8", 3),
        ("speed", "<f8", 1),
        ("heading_error", "<f8", 1),
        ("goal_distance", "<f8", 1),
        ("scan", "<f8", 40),
    ]
)
ESTIMATE = np.dtype(
    [
        ("percept", PERCEPT),
        ("pose_age_s", "<f8"),
        ("box_age_s", "<f8"),
        ("disputed", "u1"),
        ("pose_verdict", "S40"),
        ("box_verdict", "S40"),
    ]
)
"""`hotice.deploy.runner.estimator.Estimate`."""
ACTION = np.dtype([("q", "<f8", 20)])
"""Joint targets of the policy, in the order of `g1.ACTION_JOINTS` [rad]."""
LATENESS = np.dtype([("late_s", "<f8"), ("took_s", "<f8")])
"""How late a tick of the runner began, and how long it took [s]."""

GUARD_KINDS: dict[str, np.dtype | None] = {
    "state": LOW_STATE.dtype,
    "command": LOW_CMD.dtype,
    "event": None,
}
"""Raw states at the time when they came, raw commands at the tick that sent them, events as `encode_event` writes."""
RUNNER_KINDS: dict[str, np.dtype | None] = {
    "status": STATUS,
    "pose": POSE,
    "tags": TAGS,
    "estimate": ESTIMATE,
    "reading": READING,
    "observation": None,
    "action": ACTION,
    "targets": TARGETS,
    "lateness": LATENESS,
}
"""What a tick read and made of it, all at the time when the tick began; an observation is float32 as the network
reads it. Samples of sources are at the time when they came."""


class LoggedEvent(NamedTuple):
    """What the guard told: mode and cause by name, in lower case and with spaces (`pick up`, `box unseen`)."""

    mode: str
    cause: str
    text: str


def encode_event(mode: Any, cause: Any, text: str) -> bytes:
    """Entry of the kind "event": `Mode`, `Cause` and text as JSON."""
    return json.dumps({"mode": spoken(mode), "cause": spoken(cause), "text": text}).encode()


def decode_event(entry: bytes) -> LoggedEvent:
    """What `encode_event` wrote. Raises `InputError`."""
    said = parse_json("an event of the log", entry)
    if not isinstance(said, dict) or {type(said.get(key)) for key in LoggedEvent._fields} != {str}:
        raise InputError(
            f"an event of the log is {entry[:80]!r}: the texts {', '.join(LoggedEvent._fields)} are needed"
        )
    return LoggedEvent(**{key: said[key] for key in LoggedEvent._fields})


def spoken(member: Any) -> str:
    """Name of an enumeration's member as it is shown."""
    return member.name.lower().replace("_", " ")


def about_run(scene: Any, carried: Any, policy: Any) -> dict[str, Any]:
    """What the header of a runner's log says: `Scene`, `CarriedObject`, `PolicySession`."""
    return {"scene": scene.to_dict(), "carried": carried.to_dict(), "policy": policy.name, "task": policy.meta}
