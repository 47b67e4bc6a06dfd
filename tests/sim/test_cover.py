"""The sphere cover that ends training episodes against exact contacts."""

import mujoco
import numpy as np
import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model import Box, g1
from hotice.model.carry import solve_carry
from hotice.model.frames import quat_to_mat
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, SphereShape
from hotice.model.objects import Cylinder, Sphere
from hotice.model.scene import Obstacle, Scene
from hotice.sim import TransportEnv
from hotice.sim.carry_bank import CarryBank
from hotice.sim.cover import EDGE_DEPTH_M, EDGE_RADIUS_M, OBJECT_SPHERES, object_cover, robot_cover, skin

CPU = torch.device("cpu")
SCENES, PER_SCENE = 14, 42
DEEPEST_MISSED_M = 0.01
STICKS_OUT_M = EDGE_RADIUS_M - EDGE_DEPTH_M


def random_obstacle(kind, rng):
    return (
        lambda: BoxShape(tuple(rng.uniform(0.08, 0.5, 3))),
        lambda: CylinderShape(rng.uniform(0.03, 0.15), rng.uniform(0.3, 1.2)),
        lambda: SphereShape(rng.uniform(0.05, 0.2)),
        lambda: CapsuleShape(rng.uniform(0.03, 0.08), rng.uniform(0.2, 0.8)),
        lambda: BoxShape((0.04, rng.uniform(0.3, 1.0), 0.04)),
        lambda: CylinderShape(0.02, rng.uniform(0.5, 1.2)),
        lambda: BoxShape((0.02, *rng.uniform(0.3, 1.0, 2))),
    )[kind]()


def unit(q):
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def both():
    """Depth of the deepest exact contact and clearance of the cover, (S, 2) each: robot, object."""
    objects = (
        Box((0.3, 0.3, 0.3), 1.0),
        Box((0.36, 0.36, 0.38), 1.5),
        Box((0.24, 0.36, 0.22), 3.0),
        Cylinder(0.13, 0.3, 1.5),
        Cylinder(0.18, 0.4, 1.5),
        Sphere(0.14, 1.2),
    )
    states = [solve_carry(o) for o in objects]
    rng = np.random.default_rng(0)
    depth, gap = np.zeros((SCENES * PER_SCENE, 2)), np.zeros((SCENES * PER_SCENE, 2))
    for n in range(SCENES):
        place = (0.9, 0.0, rng.uniform(0.1, 1.2))
        obstacle = Obstacle("it", "side", random_obstacle(n % 7, rng), place, tuple(unit(rng.normal(size=4))))
        scene = Scene(f"scene_{n}", ((-1.5, -1.5, 0), (2.5, 1.5, 1.6)), (-0.9, 0.0, 0.0), (2.2, 1.2), (obstacle,))
        carry = CarryBank.of(states, 0.005, CPU, scene=scene)
        env = TransportEnv(PER_SCENE, FieldBank.build([scene], 0.04), carry, threads=1)
        model = env.memory.model
        qpos = carry.qpos[model].numpy().copy()
        qpos[:, 7:27] += rng.uniform(-0.3, 0.3, (PER_SCENE, 20))
        shift = np.column_stack([0.9 - rng.uniform(-0.4, 0.7, PER_SCENE), rng.uniform(-0.4, 0.4, PER_SCENE)])
        qpos[:, 27:29] += shift - qpos[:, :2]
        qpos[:, :2] = shift
        qpos[:, 30:34] = unit(qpos[:, 30:34] + 0.15 * rng.normal(size=(PER_SCENE, 4)))
        env.physics.qpos[:] = torch.from_numpy(qpos)
        env.physics.forward(torch.arange(PER_SCENE))
        s = env.snapshot()
        for i in range(PER_SCENE):
            row = n * PER_SCENE + i
            gap[row] = float(s.clearance[i]), float(s.object_clearance[i])
            m = carry.models[int(model[i])]
            data = mujoco.MjData(m)
            data.qpos[:] = qpos[i]
            mujoco.mj_forward(m, data)
            for contact in data.contact:
                names = [m.geom(int(g)).name for g in contact.geom]
                if any(name.startswith("obstacle/") for name in names):
                    which = int("object" in names)
                    depth[row, which] = max(depth[row, which], -contact.dist)
    return depth, gap


def test_agrees_with_exact_contacts(both):
    depth, gap = both
    for which in (0, 1):
        exact, covered = depth[:, which] > 0, gap[:, which] < 0
        assert 0.1 < exact.mean() < 0.9
        assert (exact == covered).mean() > 0.96


def test_no_deep_penetration_is_missed(both):
    depth, gap = both
    missed = np.where(gap >= 0, depth, 0.0)
    assert missed.max() < DEEPEST_MISSED_M, missed.max(axis=0)


def test_collisions_are_invented_only_by_a_hair(both):
    """Where the cover sticks out, it may report a collision just before there is one, and does so rarely."""
    depth, gap = both
    invented = (depth == 0) & (gap < 0)
    assert gap[depth == 0].min() > -STICKS_OUT_M
    assert invented.mean() < 0.003


def test_robot_spheres_stay_inside_the_links(carry):
    """By sampling each sphere's surface against the geoms of its body, grown by what the cover may stick out."""
    model = carry.models[0]
    body, centre, radius = robot_cover(model)
    assert set(body) <= {b for b in range(model.nbody) if model.body_rootid[b] == model.body(g1.ROOT_BODY).id}
    directions = unit(np.random.default_rng(0).normal(size=(100, 3)))
    for b, c, r in zip(body, centre, radius, strict=True):
        geoms = np.flatnonzero(model.geom_bodyid == b)
        thickness = np.where(
            model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_BOX,
            model.geom_size[geoms].min(axis=1),
            model.geom_size[geoms, 0],
        )
        fits = (
            inside(model, g, c + (r - (STICKS_OUT_M if r == EDGE_RADIUS_M else skin(t)) - 1e-6) * directions).all()
            for g, t in zip(geoms, thickness, strict=True)
        )
        assert any(fits), model.body(b).name


def test_edge_spheres_reach_the_very_edge():
    box = Box((0.4, 0.3, 0.3), 1.0)
    centre, radius = object_cover("box", box.half_extents_m)
    edges = np.isclose(radius, EDGE_RADIUS_M)
    assert edges.sum() == 12 * 10 + 8
    below = np.sort(box.half_extents_m - np.abs(centre[edges]), axis=1)[:, :2]
    np.testing.assert_allclose(below, EDGE_DEPTH_M)
    np.testing.assert_allclose(np.linalg.norm(below, axis=1), radius[edges])


def inside(model, geom, points):
    local = (points - model.geom_pos[geom]) @ quat_to_mat(model.geom_quat[geom])
    size, kind = model.geom_size[geom], model.geom_type[geom]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return (np.abs(local) <= size).all(axis=1)
    axis = np.clip(local[:, 2], -size[1], size[1]) if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
    return np.linalg.norm(local - np.column_stack([0 * local[:, :2], axis + 0 * local[:, 2]]), axis=1) <= size[0]


def test_every_link_of_the_robot_is_covered(carry):
    model = carry.models[0]
    with_geoms = {int(b) for b in model.geom_bodyid if model.body_rootid[b] == model.body(g1.ROOT_BODY).id}
    assert set(robot_cover(model)[0].tolist()) == with_geoms


def test_obstacles_of_the_model_are_no_part_of_the_robot(states, carry):
    scene = Scene("s", obstacles=(Obstacle("o", "side", CylinderShape(0.1, 1.0), (1.0, 0.6, 0.5)),))
    with_obstacle = CarryBank.of(states[:1], 0.005, CPU, scene=scene).models[0]
    assert with_obstacle.ngeom == carry.models[0].ngeom + 1
    for a, b in zip(robot_cover(with_obstacle), robot_cover(carry.models[0]), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("obj", [Box((0.2, 0.3, 0.4), 1.0), Cylinder(0.15, 0.3, 1.0), Sphere(0.2, 1.0)])
def test_object_spheres_stay_inside_and_reach_the_surface(obj):
    centre, radius = object_cover(obj.shape, obj.half_extents_m)
    assert centre.shape == (OBJECT_SPHERES, 3) and radius.shape == (OBJECT_SPHERES,)
    edge = np.isclose(radius, EDGE_RADIUS_M)
    radius = np.where(edge, EDGE_DEPTH_M, radius)  # the spheres along edges stick out on purpose
    half = obj.half_extents_m
    if obj.shape == "sphere":
        assert (np.linalg.norm(centre, axis=1) + radius <= half[0] + 1e-9).all()
    elif obj.shape == "cylinder":
        assert (np.linalg.norm(centre[:, :2], axis=1) + radius <= half[0] + 1e-9).all()
        assert (np.abs(centre[:, 2]) + radius <= half[2] + 1e-9).all()
    else:
        assert (np.abs(centre) + radius[:, None] <= half + 1e-9).all()
    for axis in range(3):
        assert (centre[:, axis] + radius).max() == pytest.approx(half[axis])
        assert (centre[:, axis] - radius).min() == pytest.approx(-half[axis])
