"""A replay page: one HTML file that holds the viewer, three.js and the rollouts, and loads nothing from anywhere.

The page of a robot that lives is the same viewer, which hears its own server and nobody else.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError
from hotice.files import write_bytes
from hotice.model import Box, CarriedObject, Cylinder, Obstacle
from hotice.replay.rollout import RolloutRecord
from hotice.replay.solids import obstacle_geom, obstacle_triangles
from hotice.task.rules import GOAL_M

_PLACE = re.compile(r"/\*\{\{(\w+)\}\}\*/")
TITLE = "hotice replay"


@dataclass(frozen=True, kw_only=True)
class Steering:
    """What a live page has beside the viewer, to be steered by: parts of HTML, CSS and script, which reads `facts`."""

    title: str
    html: str
    css: str
    js: str
    facts: Mapping[str, Any]


def write_html(records: Sequence[RolloutRecord], path: str | Path, *, frames_per_s: float = 25.0) -> Path:
    """Writes the page; the viewer interpolates between frames.

    Args:
        records: one or more rollouts, in the order of the page's list.
        path: the .html file.
        frames_per_s: frames kept per second of a rollout (what bounds the size of the page).

    Raises:
        OutputError: `path` cannot be written.
        HoticeError: there is no record.
    """
    if not records:
        raise HoticeError("a replay page needs at least one rollout: none was given")
    return write_bytes(path, _page([_pack(r.every(1.0 / frames_per_s)) for r in records]).encode())


def live_page(record: RolloutRecord, events: str, steering: Steering | None = None) -> str:
    """The page of a robot that lives: it shows the solids of a record, and takes frames from its own server.

    Args:
        record: the first of its frames is the first shown, robot and object hidden until a frame comes.
        events: path of the server-sent events; each is JSON with time [s], mode, facts (name, text, whether it is
            marked), events, and geom_pos, geom_quat, arrow_pos, arrow_force, root_pos, object_pos as flat lists, which
            are left out where robot and object are not known. It may also have tone, a class of the page's badge, and
            movers, the places in the scene of obstacles that move with their poses, or none where they are not known.
        steering: of a simulation.
    """
    return _page([_pack(record)], events, steering)


def watched_page(records: Sequence[RolloutRecord], steering: Steering, *, frames_per_s: float = 25.0) -> str:
    """A replay page with a panel of its own, which may hear its own server; see `write_html` for the rest."""
    return _page([_pack(r.every(1.0 / frames_per_s)) for r in records], steering=steering)


def _page(records: list[dict[str, Any]], live: str | None = None, steering: Steering | None = None) -> str:
    page = {"goal_radius_m": GOAL_M, "records": records, "live": live, "steer": steering and steering.facts}
    folder = files("hotice.replay")
    parts = {
        "title": steering.title if steering else TITLE,
        "panel": steering.html if steering else "",
        "script": f"<script>\n{steering.js}</script>" if steering else "",
        "css": (folder / "viewer.css").read_text(encoding="utf-8") + (steering.css if steering else ""),
        "connect": "'none'" if live is None and steering is None else "'self'",
        "data": _script_safe(json.dumps(page, separators=(",", ":"), allow_nan=False)),
        "three": _three_js(),
        "viewer": (folder / "viewer.js").read_text(encoding="utf-8"),
    }
    template = (folder / "viewer.html").read_text(encoding="utf-8")
    return _PLACE.sub(lambda match: parts[match[1]], template)


def describe(carried: CarriedObject) -> str:
    """One line about a carried object."""
    if isinstance(carried, Box):
        size = " × ".join(f"{100 * v:.0f}" for v in carried.size_m) + " cm"
    elif isinstance(carried, Cylinder):
        size = f"⌀ {200 * carried.radius_m:.0f} × {100 * carried.length_m:.0f} cm"
    else:
        size = f"⌀ {200 * carried.radius_m:.0f} cm"
    return f"{carried.shape}, {size}, {carried.mass_kg:.2f} kg"


def _three_js() -> str:
    """The library with its licence, which every copy (also a written page) has to carry."""
    vendor = files("hotice.replay") / "vendor"
    licence, code = ((vendor / name).read_text(encoding="utf-8") for name in ("three.LICENSE", "three.bundle.min.js"))
    return f"/*! three.js\n{licence}*/\n{code}"


def _script_safe(text: str) -> str:
    """JSON that cannot close or open an HTML element: every < is escaped, inside strings by JSON's own rules."""
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _pack(record: RolloutRecord) -> dict[str, Any]:
    began_s = float(record.time_s[0])
    counts = {c: sum(o.category == c for o in record.scene.obstacles) for c in ("ground", "side", "overhead")}
    return {
        "policy": record.policy,
        "outcome": record.outcome,
        "distance_m": record.distance_m,
        "carried": describe(record.carried),
        "obstacle_text": ", ".join(f"{n} {c}" for c, n in counts.items() if n) or "none",
        "time": [round(float(t), 4) for t in record.time_s - record.time_s[0]],
        "events": [
            {"time": round(e.time_s - began_s, 4), "kind": e.kind, "text": e.text, "solids": list(e.solids)}
            for e in record.events
        ],
        "geoms": [
            {"name": name, "type": kind, "size": size.tolist(), "rgba": rgba.round(3).tolist(), "object": bool(carried)}
            for name, kind, size, rgba, carried in zip(
                record.geom_names,
                record.geom_types,
                record.geom_sizes,
                record.display_rgba,
                record.geom_is_object,
                strict=True,
            )
        ],
        "geom_pos": _quantised(record.geom_pos_W),
        "geom_quat": _quantised(_without_sign_flips(record.geom_quat_W)),
        "arrow_pos": _quantised(record.arrow_pos_W),
        "arrow_force": _quantised(_limited(record.arrow_force_W, 10.0)),
        "arrow_is_ogf": record.arrow_is_ogf.tolist(),
        "root_pos": _quantised(record.root_pos_W),
        "object_pos": _quantised(record.object_pos_W),
        "clearance": record.clearance_m.round(4).tolist(),
        **_pack_moving(record),
        "scene": {
            "name": record.scene.name,
            "bounds": record.scene.bounds_m,
            "start": record.scene.start,
            "goal": record.scene.goal,
            "obstacles": [_pack_obstacle(o) for o in record.scene.obstacles],
        },
    }


def _pack_moving(record: RolloutRecord) -> dict[str, Any]:
    """Which obstacles move, by their place in the scene, and where each is in each frame; nothing where none does."""
    moving = [i for i, obstacle in enumerate(record.scene.obstacles) if obstacle.motion is not None]
    if not moving:
        return {}
    frames = [[record.scene.obstacles[i].at(float(time_s)) for i in moving] for time_s in record.time_s]
    quat = np.array([[o.quaternion_wxyz for o in frame] for frame in frames])
    return {
        "moving": moving,
        "moving_pos": _quantised(np.array([[o.position_m for o in frame] for frame in frames])),
        "moving_quat": _quantised(_without_sign_flips(quat)),
    }


def _pack_obstacle(obstacle: Obstacle) -> dict[str, Any]:
    kind, size = obstacle_geom(obstacle)
    packed = {
        "type": kind,
        "size": size,
        "category": obstacle.category,
        "name": obstacle.name,
        "position": obstacle.position_m,
        "quaternion": obstacle.quaternion_wxyz,
    }
    if kind == "mesh":
        vertices, faces = obstacle_triangles(obstacle)
        packed["mesh"] = {"vertices": vertices.round(4).ravel().tolist(), "faces": faces.ravel().tolist()}
    return packed


def _quantised(values: NDArray[np.floating]) -> dict[str, Any]:
    """Numbers as 16-bit integers of a common scale: for 4 m of motion the error stays below 0.1 mm."""
    largest = float(np.abs(values).max(initial=0.0))
    scale = largest / 32767.0 if largest > 0 else 1.0
    integers = np.rint(values / scale).astype("<i2")
    return {"scale": scale, "data": base64.b64encode(integers.tobytes()).decode()}


def _limited(vectors: NDArray[np.floating], length: float) -> NDArray[np.floating]:
    """Shortens vectors to `length`, so that a single strong one does not coarsen the others."""
    norm = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors * np.minimum(1.0, length / np.maximum(norm, 1e-12))


def _without_sign_flips(quat: NDArray[np.floating]) -> NDArray[np.floating]:
    """(T, G, 4): q and -q are the same rotation; picks the one nearer to the previous frame's."""
    flips = np.sign(np.sum(quat[1:] * quat[:-1], axis=-1))
    flips[flips == 0] = 1.0
    return np.concatenate([quat[:1], quat[1:] * np.cumprod(flips, axis=0)[..., None]])
