import copy
import json
import os

import numpy as np
import pytest

from hotice.errors import HoticeError, InvalidScene, UnknownName
from hotice.model import Obstacle, Scene, frames, load_scene, load_scenes, shipped_scenes
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape, signed_distance

GOOD = {
    "format": "hotice-scene/1",
    "name": "low_beam",
    "bounds_m": [[-0.5, -1.0, 0.0], [2.5, 1.0, 1.5]],
    "start": {"position_m": [0.0, 0.0], "yaw_rad": 0.0},
    "goal": {"position_m": [2.0, 0.0]},
    "obstacles": [
        {
            "name": "beam",
            "category": "overhead",
            "shape": {"type": "box", "size_m": [0.2, 2.0, 0.4]},
            "position_m": [1.0, 0.0, 1.35],
            "quaternion_wxyz": [1, 0, 0, 0],
        },
        {
            "name": "pipe",
            "category": "ground",
            "shape": {"type": "cylinder", "radius_m": 0.04, "length_m": 2.0},
            "position_m": [1.5, 0.0, 0.04],
            "quaternion_wxyz": [0.7071068, 0.7071068, 0, 0],
        },
    ],
}


def _write(folder, data, name="scene.json"):
    path = folder / name
    path.write_text(data if isinstance(data, str) else json.dumps(data))
    return path


def _cube(folder, name="cube.obj", size=(0.4, 0.6, 0.8)):
    import trimesh

    trimesh.creation.box(size).export(folder / name)
    return name


# Distances


def _surface_distance(sample_surface, p):
    return np.linalg.norm(p[:, None] - sample_surface[None], axis=-1).min(axis=1)


def test_box_closed_forms():
    box = BoxShape((2.0, 4.0, 6.0))
    p = np.array([[2.0, 0, 0], [0, 0, 0], [1 + 3.0, 2 + 4.0, 0], [0.9, 0, 0], [2, 3, 4]])
    np.testing.assert_allclose(signed_distance(box, p), [1, -1, 5, -0.1, np.sqrt(3)])


def test_cylinder_and_capsule_closed_forms():
    p = np.array([[2.0, 0, 0], [0, 0, 3], [1 + 3, 0, 2 + 4], [0, 0, 0], [0, 0, 1.9]])
    np.testing.assert_allclose(signed_distance(CylinderShape(1.0, 4.0), p), [1, 1, 5, -1, -0.1])
    np.testing.assert_allclose(signed_distance(CapsuleShape(1.0, 4.0), p), [1, 0, np.hypot(4, 4) - 1, -1, -1])
    np.testing.assert_allclose(signed_distance(SphereShape(0.5), p[:1]), [1.5])


def test_distance_to_a_rotated_box_by_brute_force():
    rng = np.random.default_rng(1)
    quat = frames.normalize(rng.normal(size=4))
    size = np.array([0.4, 0.3, 0.2])
    box = Obstacle("b", "side", BoxShape(tuple(size)), (0.3, -0.2, 0.9), tuple(quat))
    surface = rng.uniform(-0.5, 0.5, (60_000, 3))
    rows = np.arange(len(surface))
    surface[rows, rows % 3] = np.sign(surface[rows, rows % 3]) * 0.5
    surface_W = surface * size @ frames.quat_to_mat(quat).T + box.position_m
    p = rng.uniform(-0.6, 1.2, (40, 3))
    np.testing.assert_allclose(np.abs(box.signed_distance(p)), _surface_distance(surface_W, p), atol=0.006)


def test_distance_to_a_wall():
    wall = Obstacle("w", "side", BoxShape((0.2, 50.0, 50.0)), (1.0, 0, 0), tuple(frames.quat_from_yaw(0.0)))
    p = np.random.default_rng(2).uniform(-2, 2, (100, 3))
    np.testing.assert_allclose(wall.signed_distance(p), np.abs(p[:, 0] - 1.0) - 0.1, atol=1e-12)


@pytest.mark.parametrize("ordered", [False, True])
def test_mesh_cube_equals_box(tmp_path, ordered):
    mesh = MeshShape(_cube(tmp_path), 1.0, tmp_path)
    p = np.random.default_rng(3).uniform(-0.8, 0.8, (3000, 3))
    if ordered:
        p = np.stack(np.meshgrid(*[np.linspace(-0.7, 0.7, 15)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(mesh.signed_distance(p), BoxShape((0.4, 0.6, 0.8)).signed_distance(p), atol=1e-9)
    half = MeshShape("cube.obj", 0.5, tmp_path)
    np.testing.assert_allclose(half.signed_distance(p), BoxShape((0.2, 0.3, 0.4)).signed_distance(p), atol=1e-9)


def test_mesh_sphere_and_inverted_mesh(tmp_path):
    import trimesh

    ball = trimesh.creation.icosphere(4, radius=0.5)
    ball.export(tmp_path / "ball.ply")
    ball.invert()
    ball.export(tmp_path / "inverted.stl")
    p = np.random.default_rng(4).uniform(-1, 1, (500, 3))
    for name in ("ball.ply", "inverted.stl"):
        d = MeshShape(name, 1.0, tmp_path).signed_distance(p)
        np.testing.assert_allclose(d, np.linalg.norm(p, axis=1) - 0.5, atol=0.003)


def test_scene_distance_is_the_least_of_its_obstacles():
    scene = load_scene("table_edge")
    p = np.random.default_rng(5).uniform(-1, 3, (2000, 3))
    each = np.min([o.signed_distance(p) for o in scene.obstacles], axis=0)
    np.testing.assert_allclose(scene.signed_distance(p), each, atol=1e-12)


def test_frames_against_scipy():
    from scipy.spatial.transform import Rotation

    r = Rotation.random(50, random_state=0)
    q, R = r.as_quat(scalar_first=True), r.as_matrix()
    v = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_allclose(frames.quat_to_mat(q), R, atol=1e-12)
    np.testing.assert_allclose(frames.quat_to_mat(frames.mat_to_quat(R)), R, atol=1e-12)
    np.testing.assert_allclose(frames.quat_rotate(q, v), r.apply(v), atol=1e-12)
    np.testing.assert_allclose(frames.quat_to_mat(frames.quat_mul(q, q[::-1])), R @ R[::-1], atol=1e-12)
    np.testing.assert_allclose(frames.quat_mul(q, frames.quat_conj(q))[:, 0], 1.0)
    np.testing.assert_allclose(frames.yaw_from_quat(frames.quat_from_yaw([0.3, -3.0])), [0.3, -3.0])
    np.testing.assert_allclose(
        frames.quat_from_axis_angle([[0, 0, 2.0], [0, 0, 1.0]], [0.3, -3.0]), frames.quat_from_yaw([0.3, -3.0])
    )
    for flip in (np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1])):
        np.testing.assert_allclose(frames.quat_to_mat(frames.mat_to_quat(flip)), flip, atol=1e-12)
    for angle in (0.3, -3.0):
        np.testing.assert_allclose(frames.rotation_z(angle), Rotation.from_euler("z", angle).as_matrix(), atol=1e-15)
        np.testing.assert_allclose(frames.rotation_y(angle), Rotation.from_euler("y", angle).as_matrix(), atol=1e-15)


# Files


def test_shipped_scenes_load():
    assert set(shipped_scenes()) >= {"beam", "gap", "open_floor", "pillars", "pipe", "table_edge"}
    for name in shipped_scenes():
        assert load_scene(name).name == name
    gap = load_scene("gap")
    np.testing.assert_allclose(gap.signed_distance([[1.0, 0.0, 0.5]]), [0.425])
    np.testing.assert_allclose(load_scene("beam").signed_distance([[1.0, 0.0, 1.2]]), [0.05])


def test_round_trip(tmp_path):
    _cube(tmp_path)
    data = copy.deepcopy(GOOD)
    data["obstacles"].append(
        {
            "name": "chair",
            "category": "side",
            "shape": {"type": "mesh", "file": "cube.obj"},
            "position_m": [0.8, 0.7, 0.0],
        }
    )
    scene = Scene.load(_write(tmp_path, data))
    scene.save(tmp_path / "again.json")
    assert Scene.load(tmp_path / "again.json") == scene
    assert sorted(os.listdir(tmp_path)) == ["again.json", "cube.obj", "scene.json"]
    other = tmp_path / "other"
    other.mkdir()
    scene.save(other / "moved.json")
    p = np.random.default_rng(0).uniform(0, 1, (20, 3))
    np.testing.assert_array_equal(Scene.load(other / "moved.json").signed_distance(p), scene.signed_distance(p))
    _cube(other, size=(1, 1, 1))
    with pytest.raises(InvalidScene, match="another mesh"):
        scene.save(other / "moved.json")


def test_save_into_a_missing_folder(tmp_path):
    with pytest.raises(InvalidScene, match="cannot write"):
        load_scene("gap").save(tmp_path / "none" / "x.json")


def test_load_scenes(tmp_path):
    for name in ("b", "a"):
        load_scene("gap").renamed(name).save(tmp_path / f"{name}.json")
    assert [s.name for s in load_scenes(["pipe", tmp_path, tmp_path / "b.json"])] == ["pipe", "a", "b", "b"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InvalidScene, match=r"no \.json"):
        load_scenes([tmp_path / "empty"])


def test_unknown_name_lists_the_shipped_ones():
    with pytest.raises(UnknownName, match="beam, bench20, gap, moving20, open_floor"):
        load_scene("no_such_scene")


def test_slightly_long_quaternion_is_normalised():
    obstacle = Obstacle("o", "side", SphereShape(0.1), (1, 0.5, 0.5), (1.0005, 0, 0, 0))
    assert obstacle.quaternion_wxyz == (1.0, 0.0, 0.0, 0.0)


def _edit(path, value):
    data = copy.deepcopy(GOOD)
    node = data
    for key in path[:-1]:
        node = node[key]
    if value is KeyError:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return data


NAN, INF = float("nan"), float("inf")
BAD = [
    (("format",), "hotice-scene/9", "known is 'hotice-scene/1'"),
    (("format",), KeyError, "known is 'hotice-scene/1'"),
    (("goal",), KeyError, "scene lacks 'goal'"),
    (("gravity",), 1, "scene has unknown key 'gravity'"),
    (("goal", "z"), 1, "goal has unknown key 'z'"),
    (("name",), "", "scene name"),
    (("name",), 3, "scene name"),
    (("name",), "a\nb", "scene name"),
    (("obstacles",), {}, "obstacles is {}"),
    (("obstacles", 0), 7, r"obstacles\[0\] is 7"),
    (("obstacles", 0, "name"), "pipe", "'pipe' occurs twice"),
    (("obstacles", 0, "colour"), "red", "unknown key 'colour'"),
    (("obstacles", 0, "category"), "flying", "known are ground, side, overhead"),
    (("obstacles", 0, "shape", "type"), "torus", "known are box, cylinder, capsule, sphere, mesh"),
    (("obstacles", 0, "shape", "type"), [], r"shape type is \[\]"),
    (("obstacles", 0, "shape", "size_m"), KeyError, "lacks 'size_m'"),
    (("obstacles", 0, "shape", "radius_m"), 1, "unknown key 'radius_m'"),
    (("obstacles", 0, "shape", "size_m"), [0.2, -2.0, 0.4], r"size_m\[1\] is -2"),
    (("obstacles", 0, "shape", "size_m"), [0.2, 2.0], "a list of 3"),
    (("obstacles", 0, "shape", "size_m"), [0.2, NAN, 0.4], "holds NaN"),
    (("obstacles", 0, "position_m"), [INF, 0, 0], "holds Infinity"),
    (("obstacles", 0, "position_m"), [1e300, 0, 0], r"position_m\[0\] is 1e\+300"),
    (("obstacles", 0, "position_m"), [10**400, 0, 0], r"position_m\[0\] is an integer"),
    (("obstacles", 0, "position_m"), ["1", 0, 0], r"position_m\[0\] is '1': a finite number within ±10000 is needed"),
    (("obstacles", 0, "position_m"), [True, 0, 0], "is True: a finite number"),
    (("obstacles", 0, "quaternion_wxyz"), [0, 0, 0, 0], "has length 0"),
    (("obstacles", 0, "quaternion_wxyz"), [1, 1, 0, 0], "has length 1.414"),
    (("obstacles", 1, "shape", "radius_m"), 0, "radius_m is 0"),
    (("bounds_m",), [[0, 0, 0]], "lowest and highest"),
    (("bounds_m",), [[-0.5, 1, 0], [2.5, -1, 1.5]], "must grow"),
    (("bounds_m",), [[-0.5, -1, 0], [2.5, 1, 0.5]], "pelvis height"),
    (("bounds_m",), [[-500, -500, 0], [500, 500, 1.5]], "grid nodes"),
    (("start", "position_m"), [-3, 0], "start .* is outside"),
    (("goal", "position_m"), [9, 0], "goal .* is outside"),
    (("goal", "position_m"), [1.0, 0], "goal .* is inside obstacle 'beam'"),
    (("start", "yaw_rad"), None, "yaw_rad is None"),
]


@pytest.mark.parametrize(("path", "value", "message"), BAD, ids=[f"{'.'.join(map(str, b[0]))}-{b[2]}" for b in BAD])
def test_bad_scenes(tmp_path, path, value, message):
    file = _write(tmp_path, _edit(path, value))
    with pytest.raises(InvalidScene, match=message) as caught:
        Scene.load(file)
    assert str(caught.value).startswith(str(file)) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[]", "scene is"),
        ("[" * 100_000, "nested too deeply"),
        ('{"name": 1, "name": 2}', "'name' occurs twice"),
    ],
)
def test_bad_files(tmp_path, text, message):
    with pytest.raises(InvalidScene, match=message):
        Scene.load(_write(tmp_path, text))


def test_unreadable_files(tmp_path):
    with pytest.raises(InvalidScene, match="no such file"):
        Scene.load(tmp_path / "none.json")
    with pytest.raises(InvalidScene, match="is a folder, pipe or device|cannot be read"):
        Scene.load(tmp_path)
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidScene, match="is not JSON"):
        Scene.load(tmp_path / "binary.json")


def _mesh_scene(file, **more):
    shape = {"type": "mesh", "file": file} | more
    return GOOD | {
        "obstacles": [{"name": "m", "category": "side", "shape": shape, "position_m": [1.0, 0.5, 0.5]}],
    }


def test_mesh_files_stay_in_the_folder(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    _cube(tmp_path)
    os.symlink(tmp_path / "cube.obj", inside / "link.obj")
    for name in ("../cube.obj", str(tmp_path / "cube.obj"), "link.obj"):
        with pytest.raises(InvalidScene, match="outside the scene's folder"):
            Scene.load(_write(inside, _mesh_scene(name)))


def test_bad_meshes(tmp_path):
    import trimesh

    half = trimesh.creation.icosphere()
    half.update_faces(half.triangles_center[:, 2] > 0)
    half.export(tmp_path / "open.obj")
    (tmp_path / "text.obj").write_text("this is no mesh")
    (tmp_path / "binary.stl").write_bytes(b"\x00" * 50)
    (tmp_path / "empty.ply").write_bytes(b"")
    cases = [
        (("none.obj",), {}, "is missing in"),
        (("open.obj",), {}, "not watertight"),
        (("text.obj",), {}, "cannot be read"),
        (("binary.stl",), {}, "cannot be read"),
        (("empty.ply",), {}, "cannot be read"),
        (("cube.txt",), {}, "unknown format"),
        (("",), {}, "a path relative"),
        (("a\0.obj",), {}, "a path relative"),
        (("open.obj",), {"scale": -1}, "mesh scale is -1"),
        (("open.obj",), {"units": "mm"}, "unknown key 'units'"),
    ]
    for args, more, message in cases:
        with pytest.raises(InvalidScene, match=message) as caught:
            Scene.load(_write(tmp_path, _mesh_scene(*args, **more)))
        assert "\n" not in str(caught.value)
    with pytest.raises(InvalidScene, match="needs the scene's folder"):
        Scene.from_dict(_mesh_scene("open.obj"))


def test_errors_are_hotice_errors():
    assert issubclass(InvalidScene, HoticeError)
    with pytest.raises(InvalidScene, match="Obstacle is needed"):
        Scene("x", obstacles=("wall",))  # type: ignore[arg-type]


def test_obstacles_that_are_no_list():
    with pytest.raises(InvalidScene, match="^obstacles is 5: a list of obstacles is needed$"):
        Scene("s", obstacles=5)
