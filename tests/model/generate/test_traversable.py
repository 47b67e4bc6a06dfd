import math

import mujoco
import numpy as np
import pytest

from hotice.errors import InvalidConfig, InvalidObject, InvalidScene
from hotice.model import Box, Obstacle, Scene, builder
from hotice.model.carry import Posture, solve_carry
from hotice.model.generate import check_traversable, family_scenes, require_traversable
from hotice.model.generate.envelope import CORE, POSTURES, Envelope, EnvelopePosture, posture_boxes
from hotice.model.generate.traversable import MARGIN_M
from hotice.model.geometry.shapes import BoxShape, CylinderShape

LARGE, SMALL = (0.2, 0.2, 0.2), (0.1, 0.1, 0.1)


def block(name, size, *position):
    return Obstacle(name, "side", BoxShape(size), position)


def gap(width):
    deep = 1.0 - 0.5 * width
    sides = (("left", 1.0), ("right", -1.0))
    return Scene(
        "gap", obstacles=tuple(block(n, (0.2, deep, 1.5), 1.0, s * 0.5 * (1 + 0.5 * width), 0.75) for n, s in sides)
    )


def bar(depth, height):
    return Scene("bar", obstacles=(block("bar", (depth, 2.0, height), 1.0, 0.0, 0.5 * height),))


def beam(under):
    return Scene("beam", obstacles=(block("beam", (0.2, 2.0, 0.4), 1.0, 0.0, under + 0.2),))


def shelves(low, high, half_width):
    """On both sides of a lane."""
    size = (0.5, 1.0 - half_width, high - low)
    y, z = 0.5 * (1 + half_width), 0.5 * (low + high)
    return Scene("shelves", obstacles=(block("left", size, 1.0, y, z), block("right", size, 1.0, -y, z)))


def test_open_floor():
    way = check_traversable(Scene("open"))
    assert way.ok and not way.reason and set(way.postures) == {"upright"} and len(way.strides) == 0
    assert way.length_m == pytest.approx(1.92) and way.clearance_m == pytest.approx(0.20)
    np.testing.assert_allclose(way.path[0], [0, 0, 0], atol=1e-12)
    assert math.dist(way.path[-1, :2], (2, 0)) <= 0.1 and np.abs(way.path[:, 1:]).max() < 1e-9


@pytest.mark.parametrize(
    ("scene", "load", "ok"),
    [
        (gap(0.60), LARGE, True),
        (gap(0.52), LARGE, False),
        (gap(0.52), SMALL, True),
        (gap(0.36), SMALL, False),
        (bar(0.05, 0.15), LARGE, True),
        (bar(0.05, 0.17), LARGE, False),
        (bar(0.20, 0.10), LARGE, True),
        (bar(0.28, 0.10), LARGE, False),
        (beam(1.00), LARGE, True),
        (beam(0.95), LARGE, False),
        (shelves(0.75, 0.85, 0.28), LARGE, True),
        (shelves(0.5, 1.2, 0.22), LARGE, False),
        (shelves(0.5, 1.2, 0.26), SMALL, True),
    ],
)
def test_limits(scene, load, ok):
    way = check_traversable(scene, carried_half_extents_m=load)
    assert way.ok == ok, way.reason
    if ok:
        assert way.clearance_m >= MARGIN_M - 1e-6
    else:
        assert way.reason.startswith(f"stopped by '{scene.obstacles[0].name}' at (") or "right" in way.reason


def test_postures_fit_the_obstacle():
    assert any("crouched" in p for p in check_traversable(beam(1.1)).postures)
    assert any("raised" in p or "lowered" in p for p in check_traversable(shelves(0.75, 0.85, 0.24)).postures)
    over = check_traversable(bar(0.1, 0.1))
    assert len(over.strides) == 1 and over.strides[0, 0] < 0.95 - 0.16


def test_a_path_keeps_its_distance():
    """The envelope of every node of the path, against the scene's exact distance."""
    scene = family_scenes("pillars", 2)[-1]
    way, envelope = check_traversable(scene), Envelope.of(LARGE)
    by_name = {p.name: i for i, p in enumerate(POSTURES)}
    assert way.ok and len(way.path) > 20
    steps = np.linalg.norm(np.diff(way.path[:, :2], axis=0), axis=1)
    assert steps.max() <= math.hypot(0.08, 0.04) + 1e-9 and {round(v, 6) for v in steps} > {0.04, 0.0}
    for (x, y, yaw), posture in zip(way.path, way.postures, strict=True):
        blocks = [0, 1, *envelope.posture_blocks[by_name[posture]]]
        rows = np.concatenate([np.arange(envelope.first[b], envelope.first[b + 1]) for b in blocks])
        c, s = math.cos(yaw), math.sin(yaw)
        p_W = envelope.centre[rows] @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [x, y, 0]
        assert (scene.signed_distance(p_W) - envelope.radius[rows]).min() > MARGIN_M - 0.01


def test_a_way_round_through_a_turn():
    wall = (block("wall", (0.1, 1.75, 1.5), 1.0, -0.125, 0.75),)
    way = check_traversable(Scene("round", obstacles=wall))
    assert not way.ok  # 0.25 m between the wall and the border
    way = check_traversable(Scene("round", ((-0.5, -1.0, 0.0), (2.5, 1.5, 1.5)), obstacles=wall))
    assert way.ok and way.path[:, 1].max() > 0.9 and way.length_m > 2.2


def test_start_inside_the_envelope_and_reasons():
    scene = Scene("tight", obstacles=(Obstacle("post", "side", CylinderShape(0.05, 1.5), (0.3, 0.0, 0.75)),))
    way = check_traversable(scene)
    assert not way.ok and way.reason == "stopped by 'post' at (0.00, 0.00), 2.00 m before the goal"
    with pytest.raises(InvalidScene, match="'tight' cannot be traversed with the load: stopped by 'post'"):
        require_traversable(scene)
    assert require_traversable(Scene("open")).ok
    with pytest.raises(InvalidScene, match="places to search"):
        check_traversable(Scene("wide", ((-20.0, -20.0, 0.0), (20.0, 20.0, 1.0))))


def test_impossible_options():
    with pytest.raises(InvalidObject, match=r"carried_half_extents_m\[1\] is nan"):
        check_traversable(Scene("open"), carried_half_extents_m=(0.1, math.nan, 0.1))
    with pytest.raises(InvalidConfig, match="resolution_m is 0: a finite number from 0.01 to 0.1 m is needed"):
        check_traversable(Scene("open"), resolution_m=0)


def inside(points, boxes, slack):
    low, high = np.array(boxes).swapaxes(0, 1)
    return ((points[:, None] >= low - slack) & (points[:, None] <= high + slack)).all(axis=-1).any(axis=-1)


@pytest.mark.parametrize("half", [0.1, 0.15, 0.2])
@pytest.mark.parametrize("drop", [0, 2, 5, 7])
def test_the_envelope_holds_the_robot(half, drop):
    """The ends and corners of every collision geometry of a carry state, with 2.5 cm of slack; crouching, above 20
    cm."""
    posture = EnvelopePosture(drop=drop, lift=0)
    height = min(0.785, 0.793 - 0.05 * drop)
    state = solve_carry(
        Box((2 * half,) * 3, 2.0), Posture(pelvis_height_m=height, lean_rad=(0.0, 0.2, 0.3)[(drop > 2) + (drop > 5)])
    )
    model = builder.build_model(state.carried, None, wrist_pos=state.wrist_pos, timestep_s=0.005)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    mujoco.mj_kinematics(model, data)
    points = []
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] == 0:
            continue
        size, R = model.geom_size[geom], data.geom_xmat[geom].reshape(3, 3)
        corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)], dtype=float)
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            points.append(data.geom_xpos[geom] + corners * size @ R.T)
        else:
            along = size[1] if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            ends = data.geom_xpos[geom] + np.array([[-along], [along]]) * R[:, 2]
            points.append((ends[:, None] + np.concatenate([np.eye(3), -np.eye(3)]) * size[0]).reshape(-1, 3))
    p_W = np.concatenate(points)
    p_W -= [*state.root_pos_W[:2], 0.0]
    missed = ~inside(p_W, posture_boxes(posture, (half,) * 3), 0.025) & ((p_W[:, 2] > 0.2) | (drop < 2))
    assert not missed.any(), np.round(p_W[missed], 3)


def test_core_is_part_of_every_posture():
    for posture in POSTURES:
        boxes = np.array(posture_boxes(posture, SMALL))
        for z, radius in CORE:
            depth = [min((-b[0, :2]).min(), b[1, :2].min(), z - b[0, 2], b[1, 2] - z) for b in boxes]
            assert max(depth) >= radius - 1e-9, (posture.name, z)
