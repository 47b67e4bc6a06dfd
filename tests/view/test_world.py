"""Obstacles that move: what they touch is what the same obstacles, built where they are now, would touch."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hotice.model import Obstacle, Scene, builder
from hotice.model.frames import quat_from_axis_angle
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.replay.touch import find_touches
from hotice.view.world import World

DT_S = 0.02


def ball_mesh(folder, rings=8, around=12):
    """A ball of radius 0.2 m of 180 triangles: enough for MuJoCo to look for contacts by bounding volumes."""
    polar, turn = np.linspace(0, np.pi, rings + 1)[1:-1], np.linspace(0, 2 * np.pi, around, endpoint=False)
    points = [(0, 0, 1), *((np.sin(p) * np.cos(t), np.sin(p) * np.sin(t), np.cos(p)) for p in polar for t in turn)]
    points.append((0, 0, -1))
    at = lambda ring, k: 2 + ring * around + k % around  # noqa: E731
    last = len(points)
    faces = [(1, at(0, k), at(0, k + 1)) for k in range(around)]
    for ring in range(rings - 2):
        for k in range(around):
            faces += [
                (at(ring, k), at(ring + 1, k), at(ring + 1, k + 1)),
                (at(ring, k), at(ring + 1, k + 1), at(ring, k + 1)),
            ]
    faces += [(last, at(rings - 2, k + 1), at(rings - 2, k)) for k in range(around)]
    lines = [*("v {} {} {}".format(*p) for p in points), *("f {} {} {}".format(*f) for f in faces)]
    (folder / "ball.obj").write_text("\n".join(lines) + "\n")
    return MeshShape("ball.obj", 0.2, folder)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    far = (
        Obstacle("box", "side", BoxShape((0.3, 0.2, 0.6)), (1.4, 0.7, 0.8)),
        Obstacle("rod", "side", CylinderShape(0.05, 1.0), (1.5, -0.7, 0.8)),
        Obstacle("pill", "side", CapsuleShape(0.08, 0.4), (2.0, 0.8, 0.8)),
        Obstacle("ball", "side", SphereShape(0.15), (2.2, -0.8, 0.8)),
        Obstacle("mesh", "side", ball_mesh(tmp_path_factory.mktemp("mesh")), (1.2, -0.2, 0.8)),
    )
    return Scene("movers", obstacles=far)


@pytest.fixture
def world(states, scene):
    return World(states[0], scene, DT_S)


def test_nothing_is_touched_far_away(world):
    world.step(world.carry.joint_target)
    assert world.touched == set() and world.failure == ""


@pytest.mark.parametrize("name", ["box", "rod", "pill", "ball", "mesh"])
@pytest.mark.parametrize("turn", [0.0, 0.8])
def test_touches_are_those_of_the_obstacle_where_it_is_now(world, scene, states, name, turn):
    """Contacts by name and depth, of a model that was compiled with the obstacle there, bounding volumes and all."""
    at = next(o for o in scene.obstacles if o.name == name)
    quat = tuple(quat_from_axis_angle(np.array([0.6, 0.8, 0.0]), turn).tolist())
    moved = replace(at, position_m=(0.1, 0.22, 0.9), quaternion_wxyz=quat)
    world.put([moved])
    mujoco.mj_forward(world.model, world.data)
    fresh = builder.build_model(
        states[0].carried, replace(scene, obstacles=(moved,)), wrist_pos=states[0].wrist_pos, elliptic=True
    )
    expected = find_touches(fresh, world.data.qpos[None].copy(), np.zeros(1))
    world._see_touches()
    assert {event.solids for event in expected.events} == world.touched != set()
    data = mujoco.MjData(fresh)
    data.qpos[:] = world.data.qpos
    mujoco.mj_forward(fresh, data)

    def depths(model, data):
        names = [[model.geom(int(g)).name for g in pair] for pair in data.contact.geom]
        found = zip(names, data.contact.dist.tolist(), strict=True)
        return sorted(d for pair, d in found if any(n.startswith("obstacle/") for n in pair))

    np.testing.assert_allclose(depths(world.model, world.data), depths(fresh, data), atol=1e-9)


def test_an_obstacle_that_comes_pushes_the_robot(states, scene):
    """Contacts act; and without the obstacle it stands."""

    def aside(obstacle):
        world = World(states[0], scene, DT_S)
        world.put([obstacle])
        for _ in range(15):
            world.step(world.carry.joint_target)
        return world.data.qpos[1]

    box = scene.obstacles[0]
    assert aside(replace(box, position_m=(0.0, 0.30, 0.8))) < aside(box) - 0.005


def test_what_comes_goes_evenly_through_the_physics_steps(world, scene, monkeypatch):
    """And counts as moving above the rule's speed alone: 5 cm/s, 1 mm a step of 20 ms."""
    box, turned = scene.obstacles[0], tuple(quat_from_axis_angle(np.array([0.0, 0.0, 1.0]), 0.4).tolist())
    to = replace(box, position_m=(1.4, 0.74, 0.8), quaternion_wxyz=tuple(-np.array(turned)))
    slow = replace(scene.obstacles[1], position_m=(1.5009, -0.7, 0.8))
    seen, step = [], mujoco.mj_step
    monkeypatch.setattr(mujoco, "mj_step", lambda m, d: (step(m, d), seen.append((d.mocap_pos[0, 1], d.xquat.copy()))))
    world.step(world.carry.joint_target, coming=[to, slow])
    assert world.substeps == 10 and world.moved == {"box"}
    np.testing.assert_allclose([y for y, _ in seen], 0.7 + 0.004 * np.arange(1, 11), atol=1e-9)
    body = world.model.body("obstacle/box").id
    angles = [2.0 * np.arctan2(abs(quat[body][3]), abs(quat[body][0])) for _, quat in seen]
    np.testing.assert_allclose(angles, 0.04 * np.arange(1, 11), atol=1e-3)
    world.step(world.carry.joint_target)
    assert world.moved == set()


def test_an_action_comes_late(states, scene):
    """The first steps of a late one are those of the target before."""
    worlds = [World(states[0], scene, DT_S) for _ in range(2)]
    other = worlds[0].carry.joint_target + 0.05
    worlds[0].step(other, delay=4)
    worlds[1].data.ctrl[:] = worlds[1].carry.joint_target
    for _ in range(4):
        mujoco.mj_step(worlds[1].model, worlds[1].data)
    worlds[1].data.ctrl[:] = other
    for _ in range(6):
        mujoco.mj_step(worlds[1].model, worlds[1].data)
    np.testing.assert_array_equal(worlds[0].data.qpos, worlds[1].data.qpos)


def test_the_start_is_the_scenes(states):
    world = World(states[0], Scene("turned", start=(0.3, -0.2, 0.7)), DT_S)
    qpos, qvel = world.state()
    np.testing.assert_allclose(qpos[:2], [0.3, -0.2])
    assert not qvel.any()
    # ahead of the robot is where it looks
    np.testing.assert_allclose(np.arctan2(*(qpos[36:38] - qpos[:2])[::-1]), 0.7, atol=0.05)
