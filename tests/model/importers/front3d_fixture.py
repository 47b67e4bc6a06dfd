"""Writes the fixture `data/front3d`: a made-up house in the layout of 3D-FRONT, with one of each defect of the real
data.

    python tests/model/importers/front3d_fixture.py [FOLDER]

Seen in z-up H: a living room 0 <= x <= 5, 0 <= y <= 4, then a wall of 20 cm with a doorway at 1.5 <= y <= 2.5, then a
bedroom 5.2 <= x <= 9.2. In the file y is up: (x, y, z) of H is written (x, z, -y). No part of the data set is in it.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent / "data" / "front3d"
FLOOR, HEIGHT = 0.1, 2.6
"""Heights of floor and ceiling in the file."""
NAN = float("nan")
TABLE_SIZE = (1.2, 0.7, 0.6)
"""Model `table`, a closed box, x, y (up), z, standing on its origin."""
TABLE_POSE = {
    "pos": [3.0, 0.0, -2.6],
    "rot": [0.0, math.sin(math.pi / 6), 0.0, math.cos(math.pi / 6)],
    "scale": [1.5, 1.0, 0.5],
}
"""Turned by 60 degrees about the file's y axis."""

Corners = list[tuple[float, float, float]]


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> list[Corners]:
    """Six quads of a box, counter-clockwise from outside, y up."""
    p = list(itertools.product(x, y, z))
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    return [[p[i] for i in side] for side in sides]


def standing(x: float, height: float, z: float) -> list[Corners]:
    """A box on the origin."""
    return box((-x / 2, x / 2), (0.0, height), (-z / 2, z / 2))


def chair() -> list[Corners]:
    """Seat, back and legs, each without its bottom: open, as most models are."""
    parts = [box((-0.22, 0.22), (0.42, 0.46), (-0.22, 0.22)), box((-0.22, 0.22), (0.46, 0.9), (-0.22, -0.19))]
    for x, z in itertools.product((-0.20, 0.16), repeat=2):
        parts.append(box((x, x + 0.04), (0.0, 0.42), (z, z + 0.04)))
    return [quad for part in parts for k, quad in enumerate(part) if k != 2]


def shelf() -> list[Corners]:
    """A bookcase of sheets without thickness."""
    x, y, z = (-0.5, 0.5), (0.0, 1.8), (-0.15, 0.15)
    quads = [box(x, y, z)[k] for k in (0, 1, 4)]
    for height in (0.05, 0.6, 1.2, 1.8):
        quads.append([(x[0], height, z[0]), (x[0], height, z[1]), (x[1], height, z[1]), (x[1], height, z[0])])
    return quads


def shade() -> list[Corners]:
    """A lamp shade that widens downwards, closed, 1.2 to 1.5 m high."""
    quads = box((-0.2, 0.2), (1.2, 1.5), (-0.2, 0.2))
    return [[(0.5 * x, y, 0.5 * z) if y == 1.5 else (x, y, z) for x, y, z in quad] for quad in quads]


def obj(quads: list[Corners], skip: int = 0) -> str:
    """OBJ text; the first `skip` quads lose their second half."""
    lines = ["# made by front3d_fixture.py"]
    for number, quad in enumerate(quads):
        lines += [f"v {x:g} {y:g} {z:g}" for x, y, z in quad]
        lines.append("f " + " ".join(str(4 * number + k) for k in range(1, 4 if number < skip else 5)))
    return "\n".join(lines) + "\n"


def models() -> dict[str, str]:
    """Path below the models' folder -> content."""
    lamp = shade() + box((-0.01, 0.01), (1.6, 2.6), (-0.01, 0.01))
    return {
        "table/raw_model.obj": obj(standing(*TABLE_SIZE)),
        "chair/raw_model.obj": obj(chair()),
        "shelf/raw_model.obj": obj(shelf()),
        "sofa/raw_model.obj": obj(standing(1.8, 0.8, 0.9), skip=1),
        "lamp/raw_model.obj": obj(lamp),
        "books/raw_model.obj": obj(standing(0.3, 0.1, 0.25)),
        "rug/raw_model.obj": obj([[(-0.8, 0.005, -0.6), (-0.8, 0.005, 0.6), (0.8, 0.005, 0.6), (0.8, 0.005, -0.6)]]),
        "stool/normalized_model.obj": obj(box((-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5))),
        "shadow/raw_model.obj": obj(standing(90.0, 0.01, 70.0)),
        "garbage/raw_model.obj": "v 1 2\nf 1 2 3\n",
        "nan/raw_model.obj": obj(standing(0.4, 0.4, 0.4)) + "v nan 0 0\nv 0 1 0\nv 0 0 1\nf 25 26 27\n",
    }


def mesh(uid: str, kind: str, polygons: list[Corners], quads: bool = False) -> dict[str, Any]:
    """A `mesh` entry with vertices per corner; polygons as one flat list of quads, or fanned into triangles."""
    p = [v for polygon in polygons for v in polygon]
    faces, normals, first = [], [], 0
    for polygon in polygons:
        a, b, c = polygon[:3]
        u, v = ([s - t for s, t in zip(q, a, strict=True)] for q in (b, c))
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        length = math.hypot(*n) or 1.0
        normals += [s / length for s in n] * len(polygon)
        corner = range(first, first + len(polygon))
        faces += corner if quads else [i for k in range(1, len(polygon) - 1) for i in (first, first + k, first + k + 1)]
        first += len(polygon)
    return {"uid": uid, "jid": "", "type": kind, "xyz": [s for v in p for s in v], "normal": normals, "faces": faces}


def flat(x: tuple[float, float], y: tuple[float, float], height: float) -> Corners:
    """A horizontal quad facing up, from extents in H."""
    return [(x[0], height, -y[0]), (x[1], height, -y[0]), (x[1], height, -y[1]), (x[0], height, -y[1])]


def upright(a: tuple[float, float], b: tuple[float, float], z: tuple[float, float] = (FLOOR, HEIGHT)) -> Corners:
    """A vertical quad between two points of H."""
    return [(a[0], z[0], -a[1]), (b[0], z[0], -b[1]), (b[0], z[1], -b[1]), (a[0], z[1], -a[1])]


def with_doorway(x: float) -> list[Corners]:
    """A wall across H at x with a doorway 1 m wide and 2.1 m high."""
    return [upright((x, 0), (x, 1.5)), upright((x, 2.5), (x, 4)), upright((x, 1.5), (x, 2.5), (2.1, HEIGHT))]


def meshes() -> list[dict[str, Any]]:
    """Walls, floors and ceiling of both rooms, and bad entries."""
    out_of_range = mesh("m_range", "WallInner", [upright((0, 0), (1, 0))])
    out_of_range["faces"][0] = 99
    not_finite = mesh(
        "m_nan",
        "Baseboard",
        [upright((0, 0), (1, 0), (FLOOR, FLOOR + 0.05)), upright((1, 0), (2, 0), (FLOOR, FLOOR + 0.05))],
    )
    not_finite["xyz"][1] = NAN
    return [
        mesh("m_floor_1", "Floor", [flat((x, x + 1.25), (0, 4), FLOOR) for x in (0.0, 1.25, 2.5, 3.75)], quads=True),
        mesh("m_floor_2", "Floor", [flat((5.2, 9.2), (0, 4), FLOOR)]),
        mesh("m_ceiling", "CustomizedCeiling", [flat((0, 5), (0, 4), HEIGHT)]),
        mesh("m_wall_south", "WallInner", [upright((0, 0), (5, 0)), upright((0, 4), (0, 0))]),
        mesh("m_wall_north", "WallInner", [upright((5, 4), (0, 4))]),
        mesh("m_door_1", "WallInner", with_doorway(5.0)),
        mesh("m_door_2", "WallInner", with_doorway(5.2)),
        mesh(
            "m_wall_bed",
            "WallOuter",
            [upright((5.2, 0), (9.2, 0)), upright((9.2, 0), (9.2, 4)), upright((9.2, 4), (5.2, 4))],
        ),
        out_of_range,
        not_finite,
        {"uid": "m_empty", "type": "Cabinet", "xyz": [], "faces": []},
    ]


def furniture() -> list[dict[str, Any]]:
    """One entry per model, and bad ones."""
    titles = {"table": "coffee table", "lamp": "lighting/pendant", "stool": "barstool"}
    good = ["table", "chair", "shelf", "sofa", "lamp", "books", "rug", "stool", "shadow", "garbage", "nan"]
    entries: list[dict[str, Any]] = [
        {"uid": f"f_{jid}", "jid": jid, "title": titles.get(jid, jid), "valid": True} for jid in good
    ]
    next(e for e in entries if e["jid"] == "stool")["size"] = [0.4, 0.5, 0.4]
    del next(e for e in entries if e["jid"] == "chair")["valid"]
    return [
        *entries,
        {"uid": "f_table", "jid": "chair", "valid": True},
        {"uid": "f_invalid", "jid": "table", "valid": False},
        {"uid": "f_missing", "jid": "no-such-model", "valid": True},
        {"uid": "f_unsafe", "jid": "../front3d/models/table", "valid": True},
        {"jid": "table"},
    ]


def child(ref: Any, x: float = 0.0, y: float = 0.0, turn: float = 0.0, **other: Any) -> dict[str, Any]:
    """A placement at x, y of H on the floor, turned by quarters. Meshes (m_...) are in place already."""
    angle, height = turn * math.pi / 4, 0.0 if str(ref).startswith("m_") else FLOOR
    pose = {"pos": [x, height, -y], "rot": [0.0, math.sin(angle), 0.0, math.cos(angle)], "scale": [1.0, 1.0, 1.0]}
    return {"ref": ref, "instanceid": "", **pose, **other}


def house() -> dict[str, Any]:
    """The parsed file."""
    table = child("f_table") | TABLE_POSE
    table["pos"] = [TABLE_POSE["pos"][0], TABLE_POSE["pos"][1] + FLOOR, TABLE_POSE["pos"][2]]
    living = [
        *(
            child(f"m_{m}")
            for m in ("floor_1", "ceiling", "wall_south", "wall_north", "door_1", "range", "nan", "empty")
        ),
        table,
        child("f_chair", 1.2, 2.2, 1),
        child("f_chair", 4.4, 0.5, 2),
        child("f_sofa", 1.5, 3.4, 2),
        child("f_lamp", 2.2, 1.2),
        child("f_rug", 2.5, 0.9),
        child("f_books", 3.9, 1.6),
        child("f_gone"),
        child(None),
        child("f_missing"),
        child("f_unsafe"),
        child("f_invalid"),
        child("f_shadow"),
        child("f_garbage"),
        child("f_nan", 0.4, 0.4),
        child("f_chair", scale=[1000.0, 1.0, 1.0]),
        child("f_chair", pos=[NAN, 0.0, 0.0]),
        child("f_chair", rot=[0.0, 0.0, 0.0]),
        child("f_chair", pos=[1e7, 0, 0]),
    ]
    bedroom = [
        *(child(f"m_{m}") for m in ("floor_2", "door_2")),
        child("f_shelf", 8.0, 3.8),
        child("f_stool", 7.2, 1.6),
        child("f_books", 6.4, 2.2),
        child("f_chair", 6.2, 3.4),
    ]
    rooms = [{"type": "LivingRoom", "children": living}, {"type": "Bedroom", "children": bedroom}, "no room"]
    return {"uid": "house-1", "furniture": furniture(), "mesh": meshes(), "scene": {"room": rooms}}


def files() -> dict[str, str]:
    """Path below the fixture's folder -> content."""
    return {"house.json": json.dumps(house()) + "\n"} | {f"models/{path}": text for path, text in models().items()}


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    for path, text in files().items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
