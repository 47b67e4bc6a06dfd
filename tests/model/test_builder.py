"""Obstacles as MuJoCo compiles them against the analytic signed distance of the scene."""

import math
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hotice.errors import InvalidConfig, InvalidScene
from hotice.model import Obstacle, Scene, builder, frames, shipped_scenes
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.model.shipped import SHIPPED

PROBE_M = 0.01
PRIMITIVES = [BoxShape((0.3, 0.2, 0.5)), CylinderShape(0.1, 0.4), CapsuleShape(0.08, 0.3), SphereShape(0.15)]


def u_profile(folder, name="profile.obj"):
    """A U standing upright, 0.6 m wide, 0.4 m deep, 0.5 m high, walls and bottom 0.1 m thick: its hollow is no
    matter."""
    import trimesh

    outline = np.array([[-0.3, 0], [0.3, 0], [0.3, 0.5], [0.2, 0.5], [0.2, 0.1], [-0.2, 0.1], [-0.2, 0.5], [-0.3, 0.5]])
    n = len(outline)
    vertices = np.array([[x, y, z] for y in (-0.2, 0.2) for x, z in outline])
    cap = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [0, 5, 6], [0, 6, 7]])
    sides = [t for i in range(n) for j in [(i + 1) % n] for t in ([i, n + j, j], [i, n + i, n + j])]
    mesh = trimesh.Trimesh(vertices, np.concatenate([cap, cap[:, ::-1] + n, sides]), process=False)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    mesh.export(folder / name)
    return MeshShape(name, 1.0, folder)


def posed(shape, seed=0):
    """The shape somewhere, turned at random."""
    rng = np.random.default_rng(seed)
    quat = frames.normalize(rng.normal(size=4))
    return Obstacle("thing", "side", shape, tuple(rng.uniform(0.9, 1.3, 3)), tuple(quat))


class Probe:
    """Distance of a small ball to the obstacles of a scene, as MuJoCo computes it."""

    def __init__(self, scene):
        spec = mujoco.MjSpec()
        builder.add_obstacles(spec, scene)
        ball = spec.worldbody.add_body(name="ball")
        ball.add_freejoint()
        ball.add_geom(name="ball", size=[PROBE_M, 0, 0], mass=1, contype=0, conaffinity=builder.OBSTACLE)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.ball = self.model.geom("ball").id

    def place(self, p_W):
        self.data.qpos[:3] = p_W
        mujoco.mj_kinematics(self.model, self.data)

    def distance(self, p_W):
        """To the surface of the nearest obstacle [m], from the centre of the ball."""
        self.place(p_W)
        geoms = (g for g in range(self.model.ngeom) if g != self.ball)
        return PROBE_M + min(mujoco.mj_geomDistance(self.model, self.data, self.ball, g, 5.0, None) for g in geoms)

    def touches(self, p_W):
        self.place(p_W)
        mujoco.mj_collision(self.model, self.data)
        return self.data.ncon > 0


@pytest.mark.parametrize("shape", PRIMITIVES, ids=lambda s: s.type)
def test_primitives_agree_with_the_signed_distance(shape):
    """Outside and inside, to 1e-3 m; whether the ball touches follows the sign."""
    scene = Scene("s", obstacles=(posed(shape, seed=3),))
    probe, rng = Probe(scene), np.random.default_rng(1)
    points = scene.obstacles[0].position_m + rng.uniform(-0.4, 0.4, (300, 3))
    exact = scene.signed_distance(points)
    outside = exact > PROBE_M  # where surfaces interpenetrate MuJoCo's distance is that of the contact it would make
    found = np.array([probe.distance(p) for p in points])
    assert outside.sum() > 100
    np.testing.assert_allclose(found[outside], exact[outside], atol=1e-3)
    assert (found[~outside] < PROBE_M + 1e-6).all()
    touches = np.array([probe.touches(p) for p in points])
    clear = np.abs(exact - PROBE_M) > 1e-3
    np.testing.assert_array_equal(touches[clear], (exact < PROBE_M)[clear])


def test_a_concave_mesh_agrees_with_the_signed_distance(tmp_path):
    scene = Scene("s", obstacles=(posed(u_profile(tmp_path), seed=4),))
    probe, rng = Probe(scene), np.random.default_rng(1)
    R_WB = frames.quat_to_mat(scene.obstacles[0].quaternion_wxyz)
    points = scene.obstacles[0].position_m + (rng.uniform(-0.4, 0.4, (300, 3)) + [0, 0, 0.25]) @ R_WB.T
    exact = scene.signed_distance(points)
    outside = exact > PROBE_M
    assert 0 < (exact < 0).sum() < 200
    found = np.array([probe.distance(p) for p in points])
    np.testing.assert_allclose(found[outside], exact[outside], atol=1e-3)
    near = np.abs(exact) < PROBE_M - 1e-3
    touches = np.array([probe.touches(p) for p in points])
    assert near.any() and touches[near].all() and not touches[exact > PROBE_M + 1e-3].any()


def test_the_hollow_of_a_mesh_is_free(tmp_path):
    """A ball in the hollow of the U touches nothing, at the bottom of the hollow it does."""
    scene = Scene("s", obstacles=(Obstacle("u", "side", u_profile(tmp_path), (1.0, 0.3, 0.0)),))
    probe = Probe(scene)
    for z in (0.12, 0.3, 0.49):
        assert not probe.touches([1.0, 0.3, z]) and scene.signed_distance([1.0, 0.3, z]) > PROBE_M
    assert probe.touches([1.0, 0.3, 0.105]) and probe.touches([1.195, 0.3, 0.3])


def test_a_robot_meets_what_it_stands_in(tmp_path):
    """Contact bits: links and object meet primitives and meshes; obstacles do not meet the floor or each other."""
    box = Obstacle("box", "side", BoxShape((0.3, 0.3, 0.3)), (1.0, 0.0, 0.15))
    pole = Obstacle("pole", "side", CylinderShape(0.03, 1.5), (0.9, 0.0, 0.75))
    mesh = Obstacle("u", "side", u_profile(tmp_path), (1.0, 0.0, 0.0))
    model = builder.build_model(None, Scene("s", obstacles=(box, pole, mesh)))
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    name = {g: model.geom(g).name for g in range(model.ngeom)}
    assert not any(name[int(g)].startswith(builder.OBSTACLE_PREFIX) for g in data.contact.geom.flatten())
    data.qpos[0] = 0.87
    mujoco.mj_fwdPosition(model, data)
    met = {name[int(g)].split("#")[0] for g in data.contact.geom.flatten()}
    assert {"obstacle/box", "obstacle/pole", "obstacle/u"} <= met


def test_too_many_faces(tmp_path):
    import trimesh

    trimesh.creation.icosphere(subdivisions=4, radius=0.3).export(tmp_path / "ball.obj")
    ball = Obstacle("ball", "side", MeshShape("ball.obj", 1.0, tmp_path), (1.0, 0.5, 0.5))
    with pytest.raises(InvalidScene, match=r"'ball': mesh of 5120 faces, at most 4000"):
        builder.build_model(None, Scene("s", obstacles=(ball,)))


def test_mujoco_geoms_of_shapes(tmp_path):
    assert BoxShape((2, 4, 6)).mujoco_geom() == ("box", (1.0, 2.0, 3.0))
    assert CylinderShape(0.1, 0.4).mujoco_geom() == ("cylinder", (0.1, 0.2))
    assert CapsuleShape(0.1, 0.4).mujoco_geom() == ("capsule", (0.1, 0.2))
    assert SphereShape(0.1).mujoco_geom() == ("sphere", (0.1,))
    profile = u_profile(tmp_path)
    with pytest.raises(InvalidScene, match="use its triangles"):
        profile.mujoco_geom()
    vertices, faces = MeshShape(profile.file, 0.5, tmp_path).triangles()
    assert vertices.shape == (16, 3) and faces.shape == (28, 3)
    np.testing.assert_allclose(np.ptp(vertices, axis=0), [0.3, 0.2, 0.25])
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx((0.6 * 0.5 - 0.4 * 0.4) * 0.4 / 8)


def test_prisms_lie_behind_their_faces():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    prisms = builder.face_prisms(vertices, np.array([[0, 1, 2], [0, 1, 3]]))
    assert prisms.shape == (1, 6, 3)  # the second face has no area
    np.testing.assert_array_equal(prisms[0, :3], vertices[:3])
    np.testing.assert_allclose(prisms[0, 3:, 2], -builder.MESH_SKIN_M)


def test_model_variants():
    full, locked = builder.build_model(joints=29), builder.build_model(joints=20)
    assert (full.nq, full.nv, full.nu) == (36, 35, 29) and (locked.nq, locked.nv, locked.nu) == (27, 26, 20)
    assert full.body_mass.sum() == pytest.approx(locked.body_mass.sum())
    fixed = builder.build_model(joints=20, fixed_base=True, floor=False)
    assert (fixed.nq, fixed.nv) == (20, 20)
    angles = [0.3, -0.2, 0.1, -0.3, -0.2, -0.1]
    wrists = builder.build_model(joints=20, wrist_pos=angles)
    quat = builder.wrist_quats(angles)
    for link, row, angle in zip(builder.g1.WRIST_LINKS, quat, angles, strict=True):
        np.testing.assert_allclose(wrists.body(link).quat, row)
        assert 2 * math.acos(row[0]) == pytest.approx(abs(angle))
    with pytest.raises(InvalidConfig, match="allowed are 20"):
        builder.build_model(joints=23)  # type: ignore[arg-type]


def test_files_that_models_and_scenes_need_are_packaged():
    """Every file beside the code that `hotice.model` and the scenes hold falls under a pattern of the package data."""
    config = tomllib.loads((SHIPPED.parents[1] / "pyproject.toml").read_text())
    data = config["tool"]["setuptools"]["package-data"]
    for package, folder in (("hotice.model", Path(builder.__file__).parent), ("hotice.scenes", SHIPPED)):
        kept = {p for pattern in data[package] for p in folder.glob(pattern)}
        held = {p for p in folder.rglob("*") if p.is_file() and p.suffix not in (".py", ".pyc", ".nbi", ".nbc")}
        assert held and held <= kept
    assert len(shipped_scenes()) >= 6
