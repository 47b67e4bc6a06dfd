"""A run as an MCAP file, which Foxglove and other viewers of robots' logs read: JSON messages with JSON schemas."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.seeing.moments import named, quat_of_pelvis
from hotice.deploy.seeing.recorded import RecordedRun
from hotice.deploy.seeing.rollout import kinds_of
from hotice.errors import InvalidConfig, MissingExtra
from hotice.files import written_aside
from hotice.model import g1
from hotice.model.frames import mat_to_quat
from hotice.policy.guidance import FieldReading

NUMBER = {"type": ["number", "null"]}
"""None for what is not finite: an age of something never seen."""
TEXT, FLAG, WHOLE = {"type": "string"}, {"type": "boolean"}, {"type": "integer"}


def numbers(count: int) -> dict[str, Any]:
    """JSON schema of an array of numbers."""
    return {"type": "array", "items": NUMBER, "minItems": count, "maxItems": count}


CHANNELS: dict[str, dict[str, dict[str, Any]]] = {
    "estimate": {
        "p_WP": numbers(3),
        "quat_WP": numbers(4),
        "joint_pos": numbers(29),
        "p_WO": numbers(3),
        "quat_WO": numbers(4),
        "pose_age_s": NUMBER,
        "box_age_s": NUMBER,
        "disputed": FLAG,
        "state_age_s": NUMBER,
        "late_s": NUMBER,
        "mode": TEXT,
        "cause": TEXT,
    },
    "guidance": {
        "c_W": numbers(3),
        "speed_m_s": NUMBER,
        "goal_distance_m": NUMBER,
        "nearest_m": NUMBER,
    },
    "movers": {
        "poses": {"type": "array", "items": numbers(7)},
        "age_s": NUMBER,
    },
    "targets": {
        "number": WHOLE,
        "q": numbers(29),
        "tau": numbers(29),
        "warm": FLAG,
        "done": FLAG,
        "pose_age_s": NUMBER,
        "box_age_s": NUMBER,
    },
    "mode": {"mode": TEXT, "cause": TEXT, "text": TEXT},
    "fault": {"mode": TEXT, "cause": TEXT, "text": TEXT},
}
"""Properties of each channel's messages: units m, rad, s, N m; frames W world, P pelvis, O object; quaternions wxyz;
joints in the order of `g1.ALL_JOINTS`, which the channel's metadata names. Guidance is what the fields say where the
robot is; in modes other than carry the policy is made to stand."""


class Message(NamedTuple):
    """One message: its channel, the time on the log's clock [s] and what it says."""

    channel: str
    time_s: float
    said: dict[str, Any]


def write_mcap(run: RecordedRun, path: str | Path) -> Path:
    """Writes an .mcap file; times are nanoseconds of the log's clock.

    Raises:
        MissingExtra: mcap is not installed.
        InvalidConfig: `path` is no .mcap. OutputError: it cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise MissingExtra("an MCAP file", "mcap", "mcap") from None
    path = Path(path)
    if path.suffix != ".mcap":
        raise InvalidConfig(f"{path}: such a file ends in .mcap")
    with written_aside(path) as aside, open(aside, "wb") as file:
        writer = Writer(file)
        writer.start(library="hotice")
        writer.add_metadata("run", {"scene": run.scene.name, "policy": run.policy, "object": run.carried.shape})
        joints = {"joints": ",".join(g1.ALL_JOINTS)}
        channels = {}
        for name, properties in CHANNELS.items():
            schema = json.dumps({"type": "object", "properties": properties, "required": list(properties)})
            number = writer.register_schema(f"hotice.{name}", "jsonschema", schema.encode())
            channels[name] = writer.register_channel(f"/{name}", "json", number, metadata=joints)
        for i, (channel, time_s, said) in enumerate(sorted(messages(run), key=lambda message: message.time_s)):
            time_ns = round(1e9 * time_s)
            data = json.dumps(_plain(said), allow_nan=False).encode()
            writer.add_message(channels[channel], log_time=time_ns, publish_time=time_ns, data=data, sequence=i)
        writer.finish()
    return path


def messages(run: RecordedRun) -> Iterator[Message]:
    """All messages of a run, channel by channel."""
    for shown, reading in zip(run.moments, run.readings, strict=True):
        time_s = float(shown["time_s"])
        yield Message("estimate", time_s, _estimate(shown))
        yield Message("guidance", time_s, _guidance(reading))
        if count := int(shown["movers"]):
            yield Message("movers", time_s, {"poses": shown["movers_pose"][:count], "age_s": shown["movers_age_s"]})
    for time_s, targets in zip(run.targets.time_s, run.targets.records, strict=True):
        said = {name: targets[name] for name in ("number", "q", "tau", "pose_age_s", "box_age_s")}
        yield Message("targets", float(time_s), said | {name: bool(targets[name]) for name in ("warm", "done")})
    for (time_s, told), kind in zip(run.events, kinds_of(run.events), strict=True):
        if kind != "note":
            yield Message(kind, time_s, told._asdict())


def _estimate(shown: np.ndarray) -> dict[str, Any]:
    percept = shown["percept"]
    return {
        "p_WP": percept["p_WP"],
        "quat_WP": quat_of_pelvis(shown),
        "joint_pos": shown["joint_pos"],
        "p_WO": percept["p_WO"],
        "quat_WO": mat_to_quat(percept["R_WO"]),
        "pose_age_s": shown["pose_age_s"],
        "box_age_s": shown["box_age_s"],
        "disputed": bool(shown["disputed"]),
        "state_age_s": shown["state_age_s"],
        "late_s": shown["late_s"],
        "mode": named(Mode, int(shown["mode"])),
        "cause": named(Cause, int(shown["cause"])),
    }


def _guidance(reading: FieldReading) -> dict[str, Any]:
    return {
        "c_W": reading.c_W,
        "speed_m_s": reading.speed[0],
        "goal_distance_m": reading.goal_distance[0],
        "nearest_m": reading.distance.min(),
    }


def _plain(said: Any) -> Any:
    """JSON value: arrays as lists, None for what is not finite."""
    if isinstance(said, dict):
        return {name: _plain(value) for name, value in said.items()}
    if isinstance(said, np.ndarray | np.generic):
        said = said.tolist()
    if isinstance(said, list):
        return [_plain(value) for value in said]
    return None if isinstance(said, float) and not math.isfinite(said) else said
