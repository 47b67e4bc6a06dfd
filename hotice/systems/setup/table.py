"""The table from which an object is picked up: where it stands, beside what, and how fields lead around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hotice.errors import InvalidStation
from hotice.model.frames import quat_from_yaw, quat_rotate, rotation_z
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.systems.setup.config import StationConfig

SUPPORT = "support"
TABLE_M = (0.40, 0.60)
"""Depth and width of the table's top."""
WIDER_M = (0.25, 0.4)  # on the side of the goal, on the other
BEARINGS_RAD = tuple(float(b) for b in np.radians([90, -90, 120, -120, 150, -150, 180, 60, -60]))
"""Where a table may stand, the best first."""
BODY_M, HEIGHTS_M = 0.3, (0.1, 0.3, 0.55, 0.8, 1.05)


def pick_origin(scene: Scene, config: StationConfig) -> tuple[float, float, float]:
    """Frame of the pick-up: x, y [m] of the scene's start, yaw [rad] towards the table."""
    x, y, yaw = scene.start
    return x, y, yaw + config.pick_bearing_rad


def table_of(scene: Scene, config: StationConfig) -> Obstacle:
    """Table that the object stands on, in W."""
    (x, y, yaw), (depth, width), top = pick_origin(scene, config), TABLE_M, config.support_height_m
    turn = quat_from_yaw(yaw)
    middle = quat_rotate(turn, np.array([config.support_near_m + 0.5 * depth, 0.0, 0.5 * top])) + [x, y, 0.0]
    quat = tuple(float(v) for v in turn)
    return Obstacle(SUPPORT, "side", BoxShape((depth, width, top)), tuple(middle.tolist()), quat)  # type: ignore[arg-type]


def beside_start(scene: Scene, config: StationConfig) -> StationConfig:
    """The configuration with the first bearing at which table and robot, stepping back from it, are clear of obstacles.

    Raises `InvalidStation` where there is none.
    """
    for bearing in BEARINGS_RAD:
        tried = replace(config, pick_bearing_rad=bearing)
        if not scene.obstacles or room_for(scene, pick_origin(scene, tried), tried.support_near_m, (-0.4, -0.2, 0.0)):
            return tried
    raise InvalidStation(
        f"scene {scene.name!r} leaves no room for a table beside its start: "
        "set pick_bearing_rad, or take a scene with more room"
    )


def room_for(scene: Scene, origin: tuple[float, float, float], near_m: float, body_x_m: Sequence[float]) -> bool:
    """Whether a table `near_m` ahead of `origin`, x, y [m], yaw [rad], and a robot at `body_x_m` ahead have room."""
    x, y, yaw = origin
    (depth, width), near = TABLE_M, near_m
    ahead, across = np.meshgrid(np.linspace(near, near + depth, 9), np.linspace(-0.5, 0.5, 9) * width)
    table = np.stack([ahead.ravel(), across.ravel()], axis=1)
    body = np.column_stack([body_x_m, np.zeros(len(body_x_m))])
    R_WG = rotation_z(yaw)[:2, :2]
    for points, margin in ((table, 0.05), (body, BODY_M)):
        xy = points @ R_WG.T + [x, y]
        for z in HEIGHTS_M:
            if scene.signed_distance(np.column_stack([xy, np.full(len(xy), z)])).min() < margin:
                return False
    return True


def with_table(scene: Scene, table: Obstacle) -> Scene:
    """The scene and the table in it, its bounds widened to hold both."""
    centre, radius = table.bounding_ball()
    low, high = (np.array(b) for b in scene.bounds_m)
    low[:2], high[:2] = np.minimum(low, centre - radius)[:2], np.maximum(high, centre + radius)[:2]
    bounds = (tuple(low.tolist()), tuple(high.tolist()))
    return replace(scene, bounds_m=bounds, obstacles=(*scene.obstacles, table))


def around_table(world: Scene) -> Scene:
    """The scene for the fields: the table reaches up to the ceiling, or they would lead the pelvis across it.

    It is also wider, more so on the side away from the goal: whoever stands behind it is led well round its corners,
    and straight behind it both ways would be equally long.
    """
    obstacles = list(world.obstacles)
    for i, o in enumerate(obstacles):
        if o.name == SUPPORT and isinstance(o.shape, BoxShape):
            depth, width, _ = o.shape.size_m
            high, middle = world.bounds_m[1][2], np.array(o.position_m)
            across = quat_rotate(np.array(o.quaternion_wxyz), np.array([0.0, 1.0, 0.0]))
            away = -1.0 if across[:2] @ (world.goal - middle[:2]) >= 0.0 else 1.0
            middle = middle + 0.5 * away * (WIDER_M[1] - WIDER_M[0]) * across
            place = (float(middle[0]), float(middle[1]), 0.5 * high)
            obstacles[i] = replace(o, shape=BoxShape((depth, width + sum(WIDER_M), high)), position_m=place)
    return replace(world, obstacles=tuple(obstacles))
