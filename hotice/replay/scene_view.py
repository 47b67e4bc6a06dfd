"""Scenes in meshcat: obstacles by category, start and goal, the robot where it starts, and arrows of its field.

The result is one page that loads nothing from anywhere; `hotice scene show` serves it or writes it to a file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError
from hotice.model import Box, Scene
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate, quat_to_mat
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.replay.meshcat_page import page_viewer
from hotice.replay.palette import CATEGORY_COLORS, GOAL_COLOR, OBJECT_COLOR, OGF_COLOR, SGF_COLOR
from hotice.replay.picture import ARROW_M, FIELD_SCALE
from hotice.replay.rollout import RolloutRecord
from hotice.replay.solids import course_of, obstacle_triangles, placed, triangles

Array = NDArray[np.float64]
CARRIED = Box((0.3, 0.3, 0.3), 1.5)
ROBOT_COLOR, FLOOR_COLOR = "#8da2b8", "#e8ecf0"
ARROW_SPACING_M = 0.16
GAP_M = 1.0


def scene_page(scenes: Sequence[Scene], *, robot: bool = True, arrows: bool = False) -> str:
    """HTML of a meshcat viewer with all scenes, side by side where there are several.

    Args:
        scenes: at least one.
        robot: shows its collision geometry at the start, holding a box of 30 cm.
        arrows: shows both fields at pelvis height, as long as in replays.

    What moves stands where it is at first, its way drawn as arrows of a fifth of a second each.

    Raises:
        HoticeError: there is no scene, or meshcat is not installed.
    """
    if not scenes:
        raise HoticeError("no scene to show")
    viewer = page_viewer()
    columns = math.ceil(math.sqrt(len(scenes)))
    pitch = np.max([np.ptp(s.bounds_m, axis=0) for s in scenes], axis=0) + GAP_M
    for n, scene in enumerate(scenes):
        row, column = divmod(n, columns)
        offset = -np.array([*np.mean(scene.bounds_m, axis=0)[:2], 0.0]) + [column * pitch[0], -row * pitch[1], 0.0]
        at = viewer[f"{n + 1} {viewer_names([scene.name])[0]}"]
        at.set_transform(_translation(offset))
        _add_scene(at, scene)
        if robot:
            _add_robot(at, scene)
        if arrows:
            _add_arrows(at, scene)
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    return viewer.static_html()


def viewer_names(names: Sequence[str]) -> list[str]:
    """Names without slashes, at which meshcat splits paths, each different from the others."""
    plain, taken = [name.replace("/", " ") or "unnamed" for name in names], []
    for name in plain:
        number, unique = 1, name
        while unique in taken or number > 1 and unique in plain:
            number += 1
            unique = f"{name} ({number})"
        taken.append(unique)
    return taken


def page_server(page: str, port: int) -> ThreadingHTTPServer:
    """A server of one page to browsers on this machine; port 0 takes any free one.

    Raises `HoticeError` when the port is taken.
    """
    content = page.encode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: object) -> None:
            pass

    try:
        return ThreadingHTTPServer(("127.0.0.1", port), Handler)
    except OSError as error:
        raise HoticeError(f"port {port} cannot be used: {error.strerror or error}; choose another, or 0") from None


def start_solids(scene: Scene) -> RolloutRecord:
    """The robot's and the carried box's solids at the start of a scene, as a record of one frame."""
    from hotice.model.builder import build_model
    from hotice.model.carry import solve_carry

    state = solve_carry(CARRIED)
    turn = quat_from_yaw(scene.start[2])
    origin = np.array([*scene.start[:2], 0.0])
    qpos = [
        *(origin + quat_rotate(turn, state.root_pos_W)),
        *quat_mul(turn, state.quat_WP),
        *state.joint_pos,
        *(origin + quat_rotate(turn, state.object_pos_W)),
        *quat_mul(turn, state.quat_WO),
    ]
    model = build_model(CARRIED, wrist_pos=state.wrist_pos)
    return RolloutRecord.from_states(
        model, qpos, scene=scene, carried=CARRIED, time_s=[0.0], outcome="running", policy="none"
    )


def _add_scene(at: Any, scene: Scene) -> None:
    low, high = np.array(scene.bounds_m)
    floor = triangles("box", (*(0.5 * (high - low)[:2]), 0.005))
    _add_solid(at["floor"], floor[0] + [*(0.5 * (low + high)[:2]), -0.006], floor[1], FLOOR_COLOR)
    names = viewer_names([obstacle.name for obstacle in scene.obstacles])
    for name, obstacle in zip(names, scene.obstacles, strict=True):
        vertices, faces = obstacle_triangles(obstacle)
        points = placed(vertices, np.array(obstacle.position_m), np.array(obstacle.quaternion_wxyz))
        _add_solid(at["obstacles"][obstacle.category][name], points, faces, CATEGORY_COLORS[obstacle.category], 0.85)
        if obstacle.motion is not None:
            course = course_of(obstacle)
            _add_segments(at["motions"][name], course[:-1], np.diff(course, axis=0), CATEGORY_COLORS[obstacle.category])
    for name, xy, color in (("start", scene.start[:2], SGF_COLOR), ("goal", scene.goal, GOAL_COLOR)):
        vertices, faces = triangles("cylinder", (0.1, 0.004), 32)
        _add_solid(at[name]["disc"], vertices + [*xy, 0.004], faces, color)
    ball = triangles("sphere", (0.05,))
    _add_solid(at["goal"]["pelvis"], ball[0] + scene.goal_W, ball[1], GOAL_COLOR)
    ahead = 0.3 * np.array([math.cos(scene.start[2]), math.sin(scene.start[2]), 0.0])
    _add_segments(at["start"]["heading"], np.array([[*scene.start[:2], 0.01]]), ahead[None], SGF_COLOR)


def _add_robot(at: Any, scene: Scene) -> None:
    solids = start_solids(scene)
    for g, name in enumerate(viewer_names(solids.geom_names)):
        vertices, faces = triangles(solids.geom_types[g], tuple(solids.geom_sizes[g].tolist()))
        points = vertices @ quat_to_mat(solids.geom_quat_W[0, g]).T + solids.geom_pos_W[0, g]
        color = OBJECT_COLOR if solids.geom_is_object[g] else ROBOT_COLOR
        _add_solid(at["robot"][name], points, faces, color)


def _add_arrows(at: Any, scene: Scene) -> None:
    from hotice.fields import build_hod_pf

    field = build_hod_pf(scene)
    low, high = scene.bounds_m
    x, y = (np.arange(low[i] + 0.5 * ARROW_SPACING_M, high[i], ARROW_SPACING_M) for i in range(2))
    p_W = np.stack(np.meshgrid(x, y, [GOAL_HEIGHT_M], indexing="ij"), axis=-1).reshape(-1, 3)
    for name, part, color, lift in (("sgf", field.sgf, SGF_COLOR, 0.0), ("ogf", field.ogf, OGF_COLOR, 0.02)):
        free = p_W[part.signed_distance(p_W) > 0.0]
        force = part.sample(free)
        strength = np.linalg.norm(force, axis=1, keepdims=True)
        shaft = force / np.maximum(strength, 1e-12) * 0.5 * ARROW_M * -np.expm1(-strength / FIELD_SCALE)
        _add_segments(at["field"][name], free + [0.0, 0.0, lift], shaft, color)


def _add_solid(at: Any, vertices: Array, faces: NDArray[np.int64], color: str, opacity: float = 1.0) -> None:
    import meshcat.geometry as g

    material = g.MeshLambertMaterial(color=_rgb(color), opacity=opacity, transparent=opacity < 1.0)
    at.set_object(g.TriangularMeshGeometry(vertices.astype(np.float32), faces.astype(np.uint32)), material)


def _add_segments(at: Any, start: Array, shaft: Array, color: str) -> None:
    """Arrows (n, 3) drawn as shafts with two barbs."""
    import meshcat.geometry as g

    aside = np.cross(shaft, [0.0, 0.0, 1.0])
    tip = start + shaft
    ends = [start, tip, tip, tip - 0.3 * shaft + 0.15 * aside, tip, tip - 0.3 * shaft - 0.15 * aside]
    points = np.stack(ends, axis=1).reshape(-1, 3).T.astype(np.float32)
    at.set_object(g.LineSegments(g.PointsGeometry(points), g.LineBasicMaterial(color=_rgb(color))))  # type: ignore[arg-type]


def _rgb(color: str) -> int:
    return int(color.removeprefix("#"), 16)


def _translation(offset: Array) -> Array:
    X = np.eye(4)
    X[:3, 3] = offset
    return X
