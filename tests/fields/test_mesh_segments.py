"""Segments beside meshes against closed forms and against points along them."""

import numpy as np
import pytest
import trimesh

from hotice.fields.geodesic.fast_marching import solve_geodesic
from hotice.fields.geodesic.mesh_segments import approach
from hotice.fields.geodesic.segments import blocker
from hotice.fields.grid import Grid
from hotice.fields.solids import Space
from hotice.model import Obstacle, Scene
from hotice.model.geometry.bvh import Tree, signed_distances
from hotice.model.geometry.shapes import BoxShape, MeshShape, SphereShape


def mesh_scene(tmp_path, mesh, centre=(1.0, 0.0, 0.75), quaternion=(1.0, 0.0, 0.0, 0.0)):
    mesh.export(tmp_path / "mesh.obj")
    return Scene(
        "mesh", obstacles=(Obstacle("mesh", "side", MeshShape("mesh.obj", folder=tmp_path), centre, quaternion),)
    )


def test_the_distance_of_a_segment_is_the_least_of_its_points():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    tree = Tree.of(np.asarray(mesh.triangles))
    rng = np.random.default_rng(0)
    passed = np.empty((65, 4))
    f = np.linspace(0, 1, 2000)[:, None]
    through = 0
    for _ in range(60):
        a, b = rng.uniform(-0.9, 0.9, (2, 3))
        inside = signed_distances(*tree, np.stack([a, b])) < 0
        near, at, number = approach(*tree, 0, tuple(a), tuple(b), 5.0, 0.0, passed)
        points = a + f * (b - a)
        truth = np.abs(signed_distances(*tree, points))
        assert number % 2 == int(inside[0] != inside[1])
        through += number > 0
        if number:
            assert near == 0.0 and (np.diff(passed[:number, 0]) >= 0).all()
            places = a + passed[:number, :1] * (b - a)
            assert np.abs(signed_distances(*tree, places)).max() < 1e-6
        else:
            assert near == pytest.approx(truth.min(), abs=2e-4) and near <= truth.min() + 1e-9
            assert truth[np.abs(f[:, 0] - at).argmin()] == pytest.approx(truth.min(), abs=2e-3)
        assert approach(*tree, 0, tuple(a), tuple(b), 0.5 * near + 1e-6, 0.0, passed)[0] <= max(0.5 * near + 1e-6, 0.0)
    assert 10 < through < 55


@pytest.mark.parametrize("margin_m", [0.0, 0.08])
def test_a_box_of_triangles_blocks_what_the_box_blocks(tmp_path, margin_m):
    size, turn = (0.2, 0.6, 0.5), (0.9238795, 0.0, 0.0, 0.3826834)
    scene = mesh_scene(tmp_path, trimesh.creation.box(size), quaternion=turn)
    plain = Scene("box", obstacles=(Obstacle("box", "side", BoxShape(size), (1.0, 0.0, 0.75), turn),))
    grid = Grid.of(scene, 0.05)
    ours, theirs = Space.of(scene, grid), Space.of(plain, grid)
    rng = np.random.default_rng(1)
    a, b = rng.uniform([0.3, -0.8, 0.1], [1.7, 0.8, 1.4], (2, 2000, 3))
    clear = (plain.signed_distance(a) > margin_m) & (plain.signed_distance(b) > margin_m)
    pairs = [(tuple(p), tuple(q)) for p, q in zip(a[clear], b[clear], strict=True)]
    got = np.array([blocker(ours, margin_m, *pair) for pair in pairs])
    expected = np.array([blocker(theirs, margin_m, *pair) for pair in pairs])
    assert 0.2 < (expected >= 0).mean() < 0.9
    assert (got != expected).sum() <= 2


@pytest.mark.parametrize("margin_m", [0.0, 0.08])
def test_paths_round_a_ball_of_triangles_are_those_round_the_ball(tmp_path, margin_m):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.35)
    scene = mesh_scene(tmp_path, mesh, (0.9, 0.1, 0.7))
    plain = Scene("ball", obstacles=(Obstacle("ball", "side", SphereShape(0.35), (0.9, 0.1, 0.7)),))
    grid = Grid.of(scene, 0.08)
    got, _ = solve_geodesic(Space.of(scene, grid), margin_m, scene.goal_W)
    expected, _ = solve_geodesic(Space.of(plain, grid), margin_m, scene.goal_W)
    both = np.isfinite(got) & np.isfinite(expected)
    assert (np.isfinite(got) != np.isfinite(expected)).sum() < 20
    error = np.abs(got[both] - expected[both])
    assert error.max() < 0.02 and error.mean() < 5e-4


@pytest.mark.parametrize("thickness_m", [1e-4, 1e-3])
def test_no_path_bores_through_a_thin_plate_of_triangles(tmp_path, thickness_m):
    scene = mesh_scene(tmp_path, trimesh.creation.box((thickness_m, 4.0, 4.0)))
    grid = Grid.of(scene, 0.1)
    field, _ = solve_geodesic(Space.of(scene, grid), 0.0, scene.goal_W)
    front = grid.points()[:, 0] < 1.0
    assert np.isinf(field[front]).all() and np.isfinite(field[~front]).all()


def test_no_path_squeezes_between_inflated_walls_that_touch(tmp_path):
    halves = [trimesh.creation.box((0.1, 3.0, 4.0)) for _ in range(2)]
    for mesh, y in zip(halves, (-1.58, 1.58), strict=True):
        mesh.apply_translation((0.0, y, 0.0))
    scene = mesh_scene(tmp_path, trimesh.util.concatenate(halves))
    grid = Grid.of(scene, 0.08)
    space = Space.of(scene, grid)
    front = grid.points()[:, 0] < 0.8
    shut, _ = solve_geodesic(space, 0.0801, scene.goal_W)
    open_, _ = solve_geodesic(space, 0.05, scene.goal_W)
    assert np.isinf(shut[front]).all() and np.isfinite(open_[front]).all()
