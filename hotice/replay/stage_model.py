"""MuJoCo's model of what a film shows: sun, floor, goal, and a body for every solid and obstacle of a record."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from matplotlib.colors import to_rgb

from hotice.replay.palette import (
    CATEGORY_COLORS,
    FIELD_OF_VIEW_DEG,
    FLOOR,
    GOAL_COLOR,
    HAZE_M,
    OTHER_COLOR,
    SKY,
    TILE_LINES,
    TILE_M,
)
from hotice.replay.rollout import RolloutRecord
from hotice.replay.solids import obstacle_geom, obstacle_triangles
from hotice.task.rules import GOAL_M

SUN = np.array([-1.6, -2.2, 5.5])
"""The sun seen from the point on the floor below the pelvis [m]; also `viewer.js`."""
AMBIENT, AT_CAMERA, SUNLIGHT = 0.6, 0.22, 0.36
"""Light from everywhere, from the camera and from the sun; together what faces both is not brighter than its colour."""
EXTENT_M = 3.0
"""Half the width of what casts shadows; unit of MuJoCo's distances of view."""
OBSTACLES = 1
"""Group of the geoms of obstacles, so that rays find them alone."""
_GEOM = mujoco.mjtGeom


def stage_model(record: RolloutRecord, size_px: tuple[int, int]) -> mujoco.MjModel:
    """Bodies that are placed from outside: the sun, the solids and the obstacles of a record, in this order."""
    spec = mujoco.MjSpec()
    _set_view(spec, size_px)
    _add_floor(spec)
    world = spec.worldbody
    sun = world.add_body(name="sun", mocap=True)
    light = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    sun.add_light(type=light, dir=-SUN, ambient=[0.0] * 3, diffuse=[SUNLIGHT] * 3, specular=[0.1] * 3)
    for kind, size, color in zip(record.geom_types, record.geom_sizes, record.display_rgba, strict=True):
        _add_geom(world.add_body(mocap=True), type=_kind(kind), size=size, rgba=color)
    for number, obstacle in enumerate(record.scene.obstacles):
        kind, size = obstacle_geom(obstacle)
        body, color = world.add_body(mocap=True), rgba(CATEGORY_COLORS.get(obstacle.category, OTHER_COLOR))
        if kind != "mesh":
            _add_geom(body, type=_kind(kind), size=[*size, *[0.0] * (3 - len(size))], rgba=color, group=OBSTACLES)
            continue
        vertices, faces = obstacle_triangles(obstacle)
        surface = dict(uservert=vertices.ravel(), userface=faces.ravel())
        spec.add_mesh(name=f"mesh{number}", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL, **surface)
        _add_geom(body, type=_GEOM.mjGEOM_MESH, meshname=f"mesh{number}", rgba=color, group=OBSTACLES)
    _add_goal(world, record.scene.goal)
    return spec.compile()


def rgba(color: str, opacity: float = 1.0) -> list[float]:
    """A colour of the palette as MuJoCo takes it."""
    return [*to_rgb(color), opacity]


def _set_view(spec: mujoco.MjSpec, size_px: tuple[int, int]) -> None:
    spec.stat.extent = EXTENT_M
    sight = spec.visual
    sight.map.znear, sight.map.zfar = 0.05 / EXTENT_M, 2.0 * HAZE_M[1] / EXTENT_M
    sight.map.fogstart, sight.map.fogend = np.divide(HAZE_M, EXTENT_M)
    sight.rgba.fog = rgba(SKY)
    sight.global_.offwidth, sight.global_.offheight = size_px
    sight.global_.fovy = FIELD_OF_VIEW_DEG
    # a power of two near twice the width: 4096 for films
    sight.quality.shadowsize, sight.quality.offsamples = 2 ** min(13, (2 * size_px[0]).bit_length()), 4
    light = sight.headlight
    light.ambient, light.diffuse, light.specular = [AMBIENT] * 3, [AT_CAMERA] * 3, [0.0] * 3


def _add_floor(spec: mujoco.MjSpec) -> None:
    flat = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    sky = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    spec.add_texture(name="sky", type=sky, builtin=flat, rgb1=to_rgb(SKY), width=8, height=8)
    spec.add_texture(
        name="tile",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=flat,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=to_rgb(FLOOR),
        markrgb=to_rgb(TILE_LINES),
        width=256,
        height=256,
    )
    tiles = spec.add_material(name="tiles", texrepeat=[1.0 / TILE_M] * 2, texuniform=True, specular=0.0)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tile"
    # of no size: as far as one sees
    _add_geom(spec.worldbody, type=_GEOM.mjGEOM_PLANE, size=[0.0, 0.0, 0.1], material="tiles")


def _add_goal(world: Any, goal: tuple[float, float]) -> None:
    green, turn = rgba(GOAL_COLOR), np.linspace(0.0, 2.0 * np.pi, 41)
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) * GOAL_M + goal
    for one, other in zip(ring[:-1], ring[1:], strict=True):
        ends = [*one, 0.008, *other, 0.008]
        _add_geom(world, type=_GEOM.mjGEOM_CAPSULE, size=[0.008, 0.0, 0.0], fromto=ends, rgba=green)
    pole = [*goal, 0.0, *goal, 0.75]
    _add_geom(world, type=_GEOM.mjGEOM_CYLINDER, size=[0.006, 0.0, 0.0], fromto=pole, rgba=green)


def _add_geom(body: Any, **look: Any) -> None:
    body.add_geom(contype=0, conaffinity=0, **look)


def _kind(name: str) -> mujoco.mjtGeom:
    return getattr(_GEOM, f"mjGEOM_{name.upper()}")
