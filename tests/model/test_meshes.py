import numpy as np
import pytest
import trimesh

from hotice.errors import InvalidScene
from hotice.model.geometry.meshes import MeshRepaired, TriangleMesh, load_mesh


def write(path, mesh):
    mesh.export(path)
    return path


@pytest.fixture
def points():
    return np.random.default_rng(0).uniform(-1.2, 1.2, (2000, 3))


def test_distance_to_a_ball(points):
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.8)
    mesh = TriangleMesh(np.array(ball.vertices), np.array(ball.faces))
    truth = np.linalg.norm(points, axis=1) - 0.8
    np.testing.assert_allclose(mesh.signed_distance(points), truth, atol=2e-3)


def test_distance_against_trimesh(points):
    torus = trimesh.creation.torus(0.7, 0.25, major_sections=40, minor_sections=20)
    mesh = TriangleMesh(np.array(torus.vertices), np.array(torus.faces))
    got = mesh.signed_distance(points)
    _, away, _ = trimesh.proximity.closest_point_naive(torus, points[:300])
    np.testing.assert_allclose(np.abs(got[:300]), away, atol=1e-12)
    ring = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.7, points[:, 2]) - 0.25
    clear = np.abs(ring) > 0.02
    np.testing.assert_array_equal(got[clear] < 0, ring[clear] < 0)


def test_overlapping_solids_are_inside_once(points, tmp_path):
    parts = [trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1)).apply_translation((0.4, 0.3, 0.2))]
    mesh = load_mesh(write(tmp_path / "two.stl", trimesh.util.concatenate(parts)), 1.0)
    inside = np.zeros(len(points), dtype=bool)
    for centre in ((0, 0, 0), (0.4, 0.3, 0.2)):
        inside |= (np.abs(points - centre) < 0.5).all(axis=1)
    np.testing.assert_array_equal(mesh.signed_distance(points) < 0, inside)


def test_repairs_say_what_they_did(points, tmp_path):
    box = trimesh.creation.box((1, 1, 1))
    whole = load_mesh(write(tmp_path / "box.ply", box), 1.0).signed_distance(points)
    holed = box.copy()
    holed.update_faces(np.arange(11))
    turned = box.copy()
    turned.faces[3] = turned.faces[3][::-1]
    inverted = trimesh.Trimesh(box.vertices, box.faces[:, ::-1], process=False)
    for name, mesh, words in (
        ("holed", holed, "fill"),
        ("turned", turned, "turned"),
        ("inverted", inverted, "inside out"),
    ):
        path = write(tmp_path / f"{name}.ply", mesh)
        with pytest.warns(MeshRepaired, match=f"{name}.ply was repaired: .*{words}"):
            got = load_mesh(path, 1.0).signed_distance(points)
        np.testing.assert_allclose(got, whole, atol=1e-9)


def test_meshes_that_cannot_be_used(tmp_path):
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)
    double = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [2, 1, 0]], process=False)
    point = trimesh.Trimesh(np.zeros((3, 3)), [[0, 1, 2]], process=False)
    nan = trimesh.creation.box((1, 1, 1))
    nan.vertices[0] = np.nan
    huge = trimesh.creation.box((1e6, 1, 1))
    half = trimesh.creation.icosphere()
    half.update_faces(half.triangles_center[:, 2] > 0)
    cases = [
        ("flat", flat, "watertight"),
        ("double", double, "watertight|no area|no volume"),
        ("point", point, "no area|cannot be read"),
        ("nan", nan, "not finite|cannot be read"),
        ("huge", huge, "reaches beyond"),
        ("half", half, "watertight"),
    ]
    for name, mesh, words in cases:
        with pytest.raises(InvalidScene, match=words):
            load_mesh(write(tmp_path / f"{name}.ply", mesh), 1.0)
