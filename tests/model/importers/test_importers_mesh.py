"""Meshes to scenes: closed bodies stay exact, open sheets become boxes."""

import json
import struct

import numpy as np
import pytest

from hotice.errors import HoticeError, InvalidMap, InvalidScene
from hotice.model import Scene
from hotice.model.geometry.shapes import BoxShape, MeshShape
from hotice.model.importers.meshes import read_triangles, sample_surface, split_bodies
from hotice.model.importers.scene_import import ImportOptions, from_triangles, import_scene

ACROSS = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0))
QUAD = np.array([[0, 1, 2], [0, 2, 3]])


def box_corners(low, high):
    import trimesh

    mesh = trimesh.creation.box(np.subtract(high, low))
    return (mesh.vertices + 0.5 * np.add(low, high))[mesh.faces]


def sheet(*corners):
    return np.array(corners, dtype=float)[QUAD]


FLOOR_SHEET = sheet((-2, -2, 0), (4, -2, 0), (4, 2, 0), (-2, 2, 0))
CABINET = box_corners((0.8, 0.45, 0.0), (1.2, 0.85, 0.8))
WALL = sheet((-2, 0.97, 0), (4, 0.97, 0), (4, 0.97, 2), (-2, 0.97, 2))
BEAM = box_corners((1.0, -0.9, 1.21), (1.2, 0.3, 1.41))
ROOM = np.concatenate([FLOOR_SHEET, CABINET, WALL, BEAM])


def write_obj(path, corners):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.reshape(-1, 3).tolist()]
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(1, 3 * len(corners), 3)]
    path.write_text("\n".join(lines))
    return path


def test_closed_bodies_stay_exact_and_sheets_become_boxes(tmp_path):
    imported = import_scene(write_obj(tmp_path / "room.obj", ROOM), ACROSS)
    scene = imported.scene
    meshes = [o for o in scene.obstacles if isinstance(o.shape, MeshShape)]
    boxes = [o for o in scene.obstacles if isinstance(o.shape, BoxShape)]
    assert sorted(o.category for o in meshes) == ["overhead", "side"] and len(boxes) == 1
    p_W = np.array([[0.5, 0.65, 0.4], [1.1, 0.0, 1.0], [1.0, 0.65, 0.9]])
    np.testing.assert_allclose(scene.signed_distance(p_W), [0.3, 0.21, 0.1], atol=1e-4)
    assert abs(scene.signed_distance([0.0, 0.5, 0.5]) - 0.47) < 0.03
    (tmp_path / "out").mkdir()
    scene.save(tmp_path / "out" / "scene.json")
    again = Scene.load(tmp_path / "out" / "scene.json")
    np.testing.assert_array_equal(again.signed_distance(p_W), scene.signed_distance(p_W))


def test_up_axis_scale_and_tilt(tmp_path):
    from hotice.model.frames import quat_from_axis_angle, quat_to_mat

    reference = from_triangles(ROOM, ACROSS, "a").scene
    y_up = 1000.0 * ROOM[..., [0, 2, 1]] * [1, 1, -1]
    import trimesh

    mesh = trimesh.Trimesh(y_up.reshape(-1, 3), np.arange(3 * len(y_up)).reshape(-1, 3), process=False)
    mesh.export(tmp_path / "room.glb")
    mesh.export(tmp_path / "room.stl")
    p_W = np.random.default_rng(0).uniform((-0.9, -0.9, 0.1), (2.9, 0.8, 1.4), (200, 3))
    for name, more in (("room.glb", {}), ("room.stl", {"up": "y"})):
        options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), scale=0.001, **more)
        scene = import_scene(tmp_path / name, options).scene
        np.testing.assert_allclose(scene.signed_distance(p_W), reference.signed_distance(p_W), atol=2e-3)
    R = quat_to_mat(quat_from_axis_angle((1.0, 1.0, 0.0), 0.1))
    imported = from_triangles(ROOM @ R.T + [0.0, 0.0, 0.7], ACROSS, "a")
    assert imported.floor.tilt_rad == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("up", ["x", "-x", "y", "-y", "z", "-z"])
def test_every_up_axis_is_a_rotation_that_takes_it_to_z(up):
    from hotice.model.importers.scene_import import _UP

    turn = np.array(_UP[up])
    axis = np.eye(3)["xyz".index(up[-1])] * (-1.0 if up.startswith("-") else 1.0)
    np.testing.assert_array_equal(turn @ axis, [0, 0, 1])
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_floor_slab_is_stood_on_not_below():
    slab = box_corners((-2, -2, -0.1), (4, 2, 0.0))
    scene = from_triangles(np.concatenate([slab, CABINET]), ACROSS, "a").scene
    assert [type(o.shape) for o in scene.obstacles] == [MeshShape]
    assert scene.signed_distance([1.0, 0.65, 0.9]) == pytest.approx(0.1, abs=1e-6)


def test_floor_given_needs_no_floor():
    with pytest.raises(InvalidMap, match="no floor found"):
        from_triangles(WALL, ACROSS, "a")
    scene = from_triangles(WALL, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), floor="given"), "a").scene
    assert len(scene.obstacles) == 1
    empty = from_triangles(FLOOR_SHEET, ACROSS, "a").scene
    assert empty.obstacles == ()


def test_inside_out_bodies_are_turned():
    bodies, loose = split_bodies(CABINET[:, ::-1])
    assert len(bodies) == 1 and len(loose) == 0
    vertices, faces = bodies[0]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(0.4 * 0.4 * 0.8)


def test_samples_lie_on_the_surface_and_leave_no_gap():
    far = sheet((-1e4, -1e4, 0.3), (1e4, -1e4, 0.3), (1e4, 1e4, 0.3), (-1e4, 1e4, 0.3))
    points = sample_surface(far, 0.02, np.zeros(3), np.ones(3))
    assert (points[:, 2] == pytest.approx(0.3)) and 1000 < len(points) < 50_000
    probes = np.random.default_rng(1).random((300, 2))
    nearest = np.linalg.norm(points[None, :, :2] - probes[:, None], axis=2).min(axis=1)
    assert nearest.max() < 0.02
    assert len(sample_surface(far, 0.02, np.zeros(3), np.array([1.0, 1.0, 0.2]))) == 0


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", b""),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n"),
        ("a.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("a.obj", b"v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n"),
        ("a.obj", b"v 1e300 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("a.stl", b"\0" * 84),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 4_000_000_000)),
        ("a.stl", b"solid x\nfacet"),
        ("a.off", b"OFF\n1 1 1\n"),
        ("a.glb", b"glTF" + bytes(40)),
        ("a.glb", b""),
        ("a.obj", bytes(range(256))),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nelement face 9\n"
            b"property list uchar int v\nend_header\n",
        ),
        (
            "a.glb",
            struct.pack("<4sII", b"glTF", 2, 20 + 60)
            + struct.pack("<I4s", 60, b"JSON")
            + json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": "../../x"}]}).ljust(60).encode(),
        ),
    ],
)
def test_broken_mesh_files(name, content, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(HoticeError) as caught:
        import_scene(tmp_path / name, ACROSS)
    assert "\n" not in str(caught.value) and str(tmp_path / name) in str(caught.value)


def test_far_away_and_huge_meshes():
    with pytest.raises(InvalidMap, match="no surface lies within"):
        from_triangles(ROOM + 500.0, ACROSS, "a")
    with pytest.raises(InvalidScene, match="bounds_m"):
        from_triangles(ROOM, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(9e3, 9e3, 1.5)), "a")
    with pytest.raises(InvalidMap, match="no triangles"):
        read_triangles(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", ".obj")


# obstacle meshes of scene files


def scene_of(folder, text, **shape):
    (folder / "m.obj").write_text(text)
    entry = {
        "name": "m",
        "category": "side",
        "shape": {"type": "mesh", "file": "m.obj"} | shape,
        "position_m": [1, 0.8, 0],
    }
    content = Scene("s").to_dict() | {"obstacles": [entry]}
    (folder / "s.json").write_text(json.dumps(content))
    return Scene.load(folder / "s.json")


TETRA = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


@pytest.mark.parametrize(
    "text",
    [
        TETRA.replace("v 0 0 0", "v nan 0 0"),
        TETRA.replace("v 0 0 0", "v inf 0 0"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "f 1 2 3\n",
        TETRA.replace("f 1 3 2", "f 1 3 2000000000"),
        "",
    ],
    ids=["nan", "inf", "open", "no vertices", "dangling", "empty"],
)
def test_bad_obstacle_meshes(text, tmp_path):
    with pytest.raises(InvalidScene) as caught:
        scene_of(tmp_path, text).signed_distance([[0.0, 0.0, 0.5]])
    assert "\n" not in str(caught.value) and "m.obj" in str(caught.value)


def test_enormous_obstacle_meshes(tmp_path):
    with pytest.raises(InvalidScene, match="beyond 10000 m"):
        scene_of(tmp_path, TETRA.replace(".1", "1e7"))


def test_paths_of_meshes_stay_inside(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "secret.obj").write_text(TETRA)
    (tmp_path / "inside" / "link.obj").symlink_to(tmp_path / "secret.obj")
    (tmp_path / "inside" / "up").symlink_to(tmp_path)
    (tmp_path / "inside" / "loop.obj").symlink_to("loop.obj")
    (tmp_path / "inside" / "dir.obj").mkdir()
    for file in (
        "../secret.obj",
        "link.obj",
        "up/secret.obj",
        str(tmp_path / "secret.obj"),
        "loop.obj",
        "dir.obj",
        "\ud800.obj",
    ):
        with pytest.raises(InvalidScene) as caught:
            scene_of(tmp_path / "inside", TETRA, file=file)
        assert "\n" not in str(caught.value)
