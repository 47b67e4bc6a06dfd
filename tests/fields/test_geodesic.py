import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.fields import build_hod_pf
from hotice.fields.geodesic.fast_marching import solve_geodesic
from hotice.fields.geodesic.segments import blocker
from hotice.fields.grid import Grid
from hotice.fields.solids import FAR_M, Space, distance_within
from hotice.fields.volumes import solve_scene
from hotice.model import Obstacle, Scene, load_scene
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, SphereShape

GOAL = np.array([2.0, 0.0, 0.75])


def wall(thickness_m=0.01, reach_y=0.3):
    """A floor-to-ceiling plate at x = 1 from the right border to y = reach_y."""
    shape = BoxShape((thickness_m, 1.5 + reach_y, 4.0))
    return Scene("wall", obstacles=(Obstacle("wall", "side", shape, (1.0, reach_y - shape.size_m[1] / 2, 0.75)),))


def test_grid_defaults_and_errors():
    grid = Grid.of(Scene("empty"), 0.04)
    assert grid.shape == (75, 50, 38)
    np.testing.assert_allclose(grid.points(np.array([0, 1])), [[-0.48, -0.98, 0.02], [-0.48, -0.98, 0.06]])
    for bad in (0.0, -1, float("nan"), "fine", 1.0, 1e-4):
        with pytest.raises(InvalidConfig, match="resolution_m"):
            build_hod_pf(Scene("empty"), resolution_m=bad)  # type: ignore[arg-type]
    for bad in (-0.1, float("nan"), 5, None):
        with pytest.raises(InvalidConfig, match="margin_m"):
            build_hod_pf(Scene("empty"), margin_m=bad)  # type: ignore[arg-type]


def test_nodes_hold_exact_distances():
    scene = load_scene("table_edge")
    nodes = solve_scene(scene, 0.1, (0.0,))
    np.testing.assert_allclose(nodes.sdf, scene.signed_distance(nodes.grid.points()), atol=1e-6)
    assert (solve_scene(Scene("empty"), 0.1, (0.0,)).sdf == FAR_M).all()


@pytest.mark.parametrize(("resolution_m", "worst"), [(0.1, 0.02), (0.05, 0.01)])
def test_free_space_is_euclidean(resolution_m, worst):
    field = build_hod_pf(Scene("empty"), resolution_m).sgf
    p = np.random.default_rng(0).uniform([-0.5, -1, 0], [2.5, 1, 1.5], (5000, 3))
    truth = np.linalg.norm(p - GOAL, axis=1)
    error = np.abs(field.geodesic_distance(p) - truth)[truth > 0.2]
    assert error.max() < worst


@pytest.mark.parametrize(("thickness_m", "resolution_m"), [(0.01, 0.04), (0.2, 0.04), (0.01, 0.02)])
def test_round_a_corner(thickness_m, resolution_m):
    """Within a cell of the closed form at every free node in the wall's shadow, and within a tenth on average."""
    field = build_hod_pf(wall(thickness_m), resolution_m).sgf
    p = np.random.default_rng(1).uniform([-0.4, -0.9, 0.1], [0.7, 0.2, 1.4], (500, 3))
    edges = [np.array([1.0 + s * thickness_m / 2, 0.3]) for s in (-1, 1)]
    flat = np.linalg.norm(p[:, :2] - edges[0], axis=1) + thickness_m + np.linalg.norm(edges[1] - GOAL[:2])
    truth = np.hypot(flat, p[:, 2] - GOAL[2])
    got = field.geodesic_distance(p)
    assert np.abs(got - truth).max() < resolution_m and np.abs(got - truth).mean() < 0.1 * resolution_m
    assert (got > np.linalg.norm(p - GOAL, axis=1) + 0.02).all()


def test_forces_lead_round_the_wall():
    field = build_hod_pf(wall()).sgf
    p = np.array([0.0, -0.5, 0.75])
    for _ in range(400):
        f = field.sample(p)
        p = p + 0.01 * f / np.linalg.norm(f)
        assert field.signed_distance(p) > 0
    assert np.linalg.norm(p - GOAL) < 0.1


def test_against_scikit_fmm():
    skfmm = pytest.importorskip("skfmm")
    scene = load_scene("pillars")
    nodes = solve_scene(scene, 0.05, (0.0,))
    shape = nodes.grid.shape
    phi = (np.linalg.norm(nodes.grid.points() - GOAL, axis=1) - 0.15).reshape(shape)
    oracle = skfmm.distance(np.ma.MaskedArray(phi, (nodes.sdf <= 0).reshape(shape)), dx=0.05, order=2) + 0.15
    free = (nodes.sdf > 0) & (phi.reshape(-1) > 0.1)
    difference = nodes.geo[0][free, 0] * nodes.step[0] - np.asarray(oracle).reshape(-1)[free]
    assert np.abs(difference).max() < 0.13 and np.abs(difference).mean() < 0.012  # its walls are whole voxels


def test_closed_room_is_unreachable_though_thinner_than_a_cell():
    half, thin = 0.3, 0.012
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            size, centre = [2 * half + thin] * 3, [0.9, 0.0, 0.75]
            size[axis] = thin
            centre[axis] += sign * half
            sides.append(Obstacle(f"s{axis}{sign}", "side", BoxShape(tuple(size)), tuple(centre)))
    field = build_hod_pf(Scene("room", obstacles=tuple(sides)), resolution_m=0.05, margin_m=0.0).sgf
    inside = np.random.default_rng(2).uniform(-0.2, 0.2, (200, 3)) + [0.9, 0, 0.75]
    assert np.isinf(field.geodesic_distance(inside)).all()
    assert np.isfinite(field.extended_geodesic_distance(inside)).all()
    assert np.isfinite(field.geodesic_distance(np.array([[0.0, 0, 0.75], [2.0, 0.5, 0.3]]))).all()
    assert np.isfinite(field.sample(inside)).all()


def test_infinite_inside_obstacles_finite_beside_them():
    field = build_hod_pf(load_scene("gap")).sgf
    assert np.isinf(field.geodesic_distance(np.array([1.0, 0.7, 0.5])))
    assert np.isfinite(field.geodesic_distance(np.array([[0.89, 0.7, 0.5], [1.0, 0.42, 0.5]]))).all()


def test_forces_point_out_of_obstacles():
    scene = Scene("pillar", obstacles=(Obstacle("p", "side", CylinderShape(0.2, 3.0), (1.0, 0.0, 0.0)),))
    field = build_hod_pf(scene).sgf
    angle = np.linspace(0, 2 * np.pi, 20)
    out = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    force = field.sample(out * 0.12 + [1, 0, 0.75])
    assert ((force * out).sum(axis=-1) > 10).all()


def test_goal_inside_the_inflated_obstacles_is_still_approached():
    post = Obstacle("post", "side", BoxShape((0.1, 0.1, 1.5)), (2.0, 0.1, 0.75))
    pf = build_hod_pf(Scene("post", obstacles=(post,)), margin_m=0.2)
    p = np.array([0.5, 0.0, 0.75])
    assert abs(pf.ogf.geodesic_distance(p) - 1.5) < 0.2
    assert pf.ogf.sample(p)[0] > 0.5


@pytest.mark.parametrize(
    "shape",
    [
        BoxShape((0.3, 0.4, 0.5)),
        CylinderShape(0.2, 0.6),
        CapsuleShape(0.1, 0.4),
        SphereShape(0.3),
    ],
)
def test_compiled_distance_equals_the_plain_one(shape):
    quat = np.array([0.3, -0.5, 0.7, 0.4])
    quat /= np.linalg.norm(quat)
    other = Obstacle("other", "side", BoxShape((0.1, 0.1, 1.0)), (1.4, 0.5, 0.5))
    scene = Scene("s", obstacles=(Obstacle("o", "side", shape, (1.0, 0.1, 0.6), tuple(quat)), other))
    grid = Grid.of(scene, 0.05)
    space = Space.of(scene, grid)
    np.testing.assert_allclose(space.sdf, scene.signed_distance(grid.points()), atol=1e-12)
    p = np.random.default_rng(3).uniform([-0.5, -1, 0], [2.5, 1, 1.5], (500, 3))
    got = [distance_within(space, *q) for q in p]
    np.testing.assert_allclose(got, scene.signed_distance(p), atol=1e-12)


def test_traces_against_dense_samples_of_the_segment():
    scene = load_scene("table_edge")
    space = Space.of(scene, Grid.of(scene, 0.04))
    rng = np.random.default_rng(3)
    a = rng.uniform([0.7, -0.7, 0.6], [1.5, -0.1, 0.9], (400, 3))
    a = a[scene.signed_distance(a) > 0]
    b = a + rng.uniform(-0.2, 0.2, a.shape)
    t = np.linspace(0, 1, 400)[:, None, None]
    truth = scene.signed_distance((a + t * (b - a)).reshape(-1, 3)).reshape(400, -1).min(axis=0)
    free = np.array([blocker(space, 0.0, tuple(p), tuple(q)) < 0 for p, q in zip(a, b, strict=True)])
    clear = (truth > 1e-3) | (truth < -3e-3)
    assert 20 < free.sum() < len(a) - 20
    np.testing.assert_array_equal(free[clear], truth[clear] > 0)


@pytest.mark.parametrize("thickness_m", [1e-4, 1e-3, 5e-3])
def test_no_segment_crosses_a_plate_however_thin(thickness_m):
    plate = Obstacle("plate", "side", BoxShape((thickness_m, 4.0, 4.0)), (1.0, 0.0, 0.75))
    scene = Scene("plate", obstacles=(plate,))
    field, _ = solve_geodesic(Space.of(scene, Grid.of(scene, 0.1)), 0.0, scene.goal_W)
    front = Grid.of(scene, 0.1).points()[:, 0] < 1.0
    assert np.isinf(field[front]).all() and np.isfinite(field[~front]).all()


@pytest.mark.parametrize("margin_m", [0.0, 0.08])
def test_distances_are_lipschitz_and_at_least_straight(margin_m):
    scene = load_scene("pillars")
    grid = Grid.of(scene, 0.05)
    space = Space.of(scene, grid)
    field, slope = solve_geodesic(space, margin_m, scene.goal_W)
    reached = np.isfinite(field)
    assert (field[reached] >= np.linalg.norm(grid.points() - GOAL, axis=1)[reached] - 1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(slope[reached], axis=1), 1.0, atol=1e-9)
    cube = np.where(reached & (space.sdf > margin_m + 0.05), field, np.nan).reshape(grid.shape)
    for axis in range(3):
        step = np.abs(np.diff(cube, axis=axis))
        assert np.nanmax(step) < 0.05 + 0.004


def test_distance_is_the_same_both_ways():
    scene = load_scene("pillars")
    grid = Grid.of(scene, 0.05)
    space = Space.of(scene, grid)
    rng = np.random.default_rng(4)
    ends = rng.choice(np.flatnonzero(space.sdf > 0.1), (6, 2), replace=False)
    for a, b in ends:
        there = solve_geodesic(space, 0.0, grid.points(np.array([a]))[0])[0][b]
        back = solve_geodesic(space, 0.0, grid.points(np.array([b]))[0])[0][a]
        assert abs(there - back) < 0.01


def test_error_behind_a_ball_falls_with_the_square_of_the_spacing():
    """Closed form: two tangents and the arc of a great circle between them."""
    centre, radius = np.array([0.9, 0.1, 0.7]), 0.35
    scene = Scene("ball", obstacles=(Obstacle("ball", "side", SphereShape(radius), tuple(centre)),))
    to_goal = GOAL - centre
    far = np.linalg.norm(to_goal)
    errors = []
    for h in (0.08, 0.04):
        grid = Grid.of(scene, h)
        value, _ = solve_geodesic(Space.of(scene, grid), 0.0, GOAL)
        q = grid.points() - centre
        r = np.linalg.norm(q, axis=1)
        outside = r > radius + 0.15
        angle = np.arccos(q[outside] @ to_goal / (r[outside] * far))
        turn = angle - np.arccos(radius / far) - np.arccos(radius / r[outside])
        hidden = turn > 0.3
        truth = np.sqrt(far**2 - radius**2) + np.sqrt(r[outside] ** 2 - radius**2) + radius * turn
        errors.append(np.abs(value[outside] - truth)[hidden].mean())
    assert errors[1] < 2e-4
    assert np.log2(errors[0] / errors[1]) > 1.6
