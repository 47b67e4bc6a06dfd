"""What moves, beside the fields: poses as the scene says, exact distances, and the field that knows both."""

import numpy as np
import pytest
import torch

from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.fields.clearance import Spheres
from hotice.fields.moving.course import Courses
from hotice.fields.moving.distance import mover_clearance, nearest_mover
from hotice.fields.moving.momentary import momentary_pf, moved, poses_of
from hotice.fields.moving.moments import Moments
from hotice.fields.moving.world import MovingWorld
from hotice.fields.potential import FieldParams
from hotice.fields.solids import BOX, CYLINDER
from hotice.model import Obstacle, Scene, load_scene
from hotice.model.frames import normalize, quat_to_mat
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, SphereShape
from hotice.model.moving import Motion, WayPoint
from hotice.model.moving.sight import newest_s, seen_moving

SHAPES = (BoxShape((0.3, 0.2, 0.5)), CylinderShape(0.2, 0.6), CapsuleShape(0.15, 0.4), SphereShape(0.25))


def course(rng, repeat, between):
    points = [
        WayPoint(time_s=0.4 + 1.1 * k, position_m=tuple(rng.uniform(-0.5, 0.5, 3) + [1.2, 0.0, 0.6]), yaw_rad=float(a))
        for k, a in enumerate(rng.uniform(-1.5, 1.5, 4))
    ]
    if repeat == "loop":
        points.append(WayPoint(time_s=6.0, position_m=points[0].position_m, yaw_rad=points[0].yaw_rad))
    return Motion(way_points=tuple(points), repeat=repeat, between=between)


@pytest.fixture(scope="module")
def scenes():
    """Nothing moves in the second; four shapes and all kinds of motion in the others, in one beside a wall."""
    rng = np.random.default_rng(4)
    kinds = [(r, b) for r in ("once", "loop") for b in ("linear", "smooth")]
    moving = [
        Obstacle(
            f"m{i}",
            "side",
            shape,
            tuple(rng.uniform(-0.3, 0.3, 3) + [1.2, 0.0, 0.6]),
            tuple(normalize(rng.normal(size=4)).tolist()),
            course(rng, *kinds[i]),
        )
        for i, shape in enumerate(SHAPES)
    ]
    wall = Obstacle("wall", "side", BoxShape((0.1, 0.6, 1.4)), (1.2, 0.7, 0.7))
    return [Scene("all", obstacles=(*moving[:3], wall)), load_scene("gap"), Scene("ball", obstacles=(moving[3],))]


TIMES = torch.tensor([0.0, 0.4, 0.77, 1.5, 2.55, 3.3, 5.99, 6.2, 17.3])


def test_poses_and_velocities_are_those_of_the_scene(scenes):
    courses = Courses.of(scenes)
    assert courses is not None
    for s, scene in enumerate(scenes):
        ids = torch.full((len(TIMES),), s)
        movers, (p_W, quat) = courses.at(ids, TIMES), courses.poses(ids, TIMES)
        assert movers.there.sum(dim=1).tolist() == [len(scene.moving)] * len(TIMES)
        for n, time_s in enumerate(TIMES.tolist()):
            then = scene.at(time_s)
            names = {o.name: o for o in then.obstacles}
            for m, (before, velocity) in enumerate(zip(scene.moving, then.velocities, strict=True)):
                obstacle = names[before.name]
                np.testing.assert_allclose(movers.p_W[n, m], obstacle.position_m, atol=2e-6)
                np.testing.assert_allclose(movers.R_WB[n, m], quat_to_mat(obstacle.quaternion_wxyz), atol=2e-6)
                np.testing.assert_allclose(p_W[n, m], obstacle.position_m, atol=2e-6)
                np.testing.assert_allclose(quat[n, m], obstacle.quaternion_wxyz, atol=2e-6)
                np.testing.assert_allclose(movers.v_W[n, m], velocity.v_W, atol=1e-5)
                np.testing.assert_allclose(movers.rate[n, m], velocity.yaw_rate_rad_s, atol=1e-5)
    assert Courses.of(scenes[1:2]) is None


def test_distances_and_their_gradients(scenes, rng):
    courses = Courses.of(scenes)
    points = torch.tensor(rng.uniform([0.3, -1.0, -0.2], [2.1, 1.0, 1.4], (1, 400, 3)), dtype=torch.float32)
    for s, scene in enumerate(scenes):
        movers = courses.at(torch.tensor([s]), torch.tensor([1.3]))
        away, slope_W = nearest_mover(movers, points)
        if not scene.moving:
            assert torch.isinf(away).all() and not slope_W.any()
            continue
        exact = [o.at(1.3).signed_distance(points[0].numpy()) for o in scene.moving]
        np.testing.assert_allclose(away[0], np.min(exact, axis=0), atol=3e-6)
        assert (away < 0).any() and (away > 0).any()
        np.testing.assert_allclose(slope_W.norm(dim=-1), 1.0, atol=1e-4)
        h = 1e-3
        steps = [torch.tensor(np.eye(3)[k] * h, dtype=torch.float32) for k in range(3)]
        numeric = [
            (nearest_mover(movers, points + e)[0] - nearest_mover(movers, points - e)[0]) / (2 * h) for e in steps
        ]
        off = (torch.stack(numeric, dim=-1) - slope_W).abs().amax(dim=-1)
        # not at edges of the medial axis, where the gradient jumps
        assert (off < 0.02).float().mean() > 0.97


def test_kinds_are_those_of_the_compiled_distance():
    rng = np.random.default_rng(1)
    movers = Courses.of(
        [
            Scene(
                "s",
                obstacles=tuple(
                    Obstacle(f"{i}", "side", shape, (1.0, 0.0, 0.5), motion=course(rng, "once", "linear"))
                    for i, shape in enumerate(SHAPES)
                ),
            )
        ]
    ).at(torch.tensor([0]), torch.tensor([0.0]))
    assert movers.kind[0].tolist()[:2] == [BOX, CYLINDER] and movers.kind[0, 2] == movers.kind[0, 3]


def test_gaps_of_spheres(scenes):
    courses = Courses.of(scenes)
    spheres = Spheres(
        frame=torch.tensor([0, 1]),
        centre=torch.tensor([[[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]]),
        radius=torch.tensor([[0.05, 0.1]]),
    )
    xpos = torch.tensor([[[0.5, 0.0, 0.6], [0.9, 0.3, 0.7]]])
    xmat = torch.eye(3).expand(1, 2, 3, 3)
    movers = courses.at(torch.tensor([0]), torch.tensor([2.0]))
    gap = mover_clearance(movers, xpos, xmat, spheres, torch.tensor([0]))
    exact = [
        min(float(o.at(2.0).signed_distance(p)) - r for p, r in (([0.6, 0.0, 0.6], 0.05), ([0.9, 0.5, 0.7], 0.1)))
        for o in scenes[0].moving
    ]
    assert float(gap) == pytest.approx(min(exact), abs=1e-5)


# ---- the field -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bank(scenes):
    return FieldBank.build(scenes)


def test_the_field_is_minus_the_gradient_of_attraction_and_repulsion(scenes, bank, rng):
    """Attraction among what stands still; repulsion by the least of all distances, in finite differences."""
    ids, time_s, params = torch.tensor([0]), torch.tensor([1.3]), FieldParams()
    courses = Courses.of(scenes)
    world = MovingWorld(still=bank, movers=courses.at(ids, time_s))
    points = torch.tensor(rng.uniform([0.6, -0.8, 0.2], [1.9, 0.6, 1.2], (1, 3000, 3)), dtype=torch.float32)
    still = build_hod_pf(scenes[0].still())
    for field, part, margin in (("sgf", still.sgf, 0.0), ("ogf", still.ogf, bank.margin_m)):
        found = world.sample(field, ids, points)
        movers_m = nearest_mover(world.movers, points)[0] - margin
        np.testing.assert_allclose(
            found.signed_distance, torch.minimum(bank.sample(field, ids, points).signed_distance, movers_m)
        )
        np.testing.assert_array_equal(found.geodesic, bank.sample(field, ids, points).geodesic)
        calm = bank.sample(field, ids, points)
        theirs = movers_m < calm.signed_distance
        # where what stands still is nearest nothing changes
        np.testing.assert_allclose(found.force_W[~theirs], calm.force_W[~theirs], atol=1e-6)
        # elsewhere: -dU_rep/ds along the gradient
        s = movers_m.clamp(params.nearest_distance_m, params.influence_distance_m)
        push = params.repulsion * (1.0 / s - 1.0 / params.influence_distance_m) / s**2
        rest = found.force_W - bank.attraction(field, ids, points).force_W
        np.testing.assert_allclose(rest.norm(dim=-1)[theirs], push[theirs], rtol=1e-3, atol=1e-4)
        assert (push[theirs] > 0.05).any()
        assert part.margin_m == margin


def test_scenes_in_which_nothing_moves_are_as_they_were(scenes, bank, rng):
    courses = Courses.of(scenes)
    ids = torch.tensor([1, 0])
    points = torch.tensor(rng.uniform([0.0, -0.8, 0.2], [2.0, 0.8, 1.2], (2, 50, 3)), dtype=torch.float32)
    world = MovingWorld(still=bank, movers=courses.at(ids, torch.tensor([0.5, 0.5])))
    for field in ("sgf", "ogf"):
        for got, was in zip(world.sample(field, ids, points), bank.sample(field, ids, points), strict=True):
            np.testing.assert_allclose(got[0], was[0], atol=1e-6)
    np.testing.assert_array_equal(world.signed_distance(ids, points)[0], bank.signed_distance(ids, points)[0])


def test_attraction_is_the_force_far_from_all(bank, rng):
    points = torch.tensor(rng.uniform([-0.4, -0.9, 0.2], [2.4, 0.9, 1.4], (1, 500, 3)), dtype=torch.float32)
    for s in range(3):
        ids = torch.tensor([s])
        whole, pull = (f("ogf", ids, points) for f in (bank.sample, bank.attraction))
        far = whole.signed_distance > 0.2
        np.testing.assert_array_equal(whole.force_W[far], pull.force_W[far])
        assert not torch.equal(whole.force_W, pull.force_W) or s == 2
        np.testing.assert_array_equal(whole.geodesic, pull.geodesic)
    from hotice.fields import torch_sample

    volumes = torch_sample.TorchVolumes.of(bank.volumes)
    in_torch = torch_sample.sample_field(volumes, 1, bank.margin_m, bank.params, torch.tensor([0]), points, repel=False)
    np.testing.assert_allclose(in_torch[0], bank.attraction("ogf", torch.tensor([0]), points).force_W, atol=1e-5)


def test_moments_are_what_a_build_of_that_moment_gives(scenes, bank, rng):
    moments = Moments.of(bank, rate_hz=2.0, until_s=1.7)
    assert moments.count.tolist() == [5, 1, 5] and moments.first.tolist() == [0, 5, 6]
    rows = moments.index(torch.tensor([0, 0, 0, 1, 2]), torch.tensor([-0.1, 0.99, 40.0, 3.0, 0.5]))
    assert rows.tolist() == [0, 1, 4, 5, 7]
    fresh = build_hod_pf(scenes[0].at(0.5))
    points = torch.tensor(rng.uniform([0.0, -0.8, 0.2], [2.0, 0.8, 1.2], (1, 200, 3)), dtype=torch.float32)
    got = moments.bank.sample("ogf", torch.tensor([1]), points)
    force, away, geodesic = fresh.ogf.query(points[0].numpy())
    np.testing.assert_array_equal(got.force_W[0], force)
    np.testing.assert_array_equal(got.signed_distance[0], away)
    np.testing.assert_array_equal(got.geodesic[0], geodesic)


def test_the_newest_ways_count_where_they_are_given(scenes, bank, rng):
    ids, time_s = torch.tensor([0]), torch.tensor([1.0])
    moments = Moments.of(bank, rate_hz=2.0, until_s=1.7)
    movers = Courses.of(scenes).at(ids, time_s)
    points = torch.tensor(rng.uniform([0.0, -0.8, 0.2], [2.0, 0.8, 1.2], (1, 300, 3)), dtype=torch.float32)
    rows = moments.index(ids, time_s)
    near = MovingWorld(still=bank, movers=movers).sample("sgf", ids, points)
    live = MovingWorld(still=bank, movers=movers, newest=(moments.bank, rows)).sample("sgf", ids, points)
    of_then = moments.bank.attraction("sgf", rows, points)
    np.testing.assert_array_equal(live.geodesic, of_then.geodesic)
    np.testing.assert_array_equal(live.signed_distance, near.signed_distance)
    apart = live.force_W - near.force_W - (of_then.force_W - bank.attraction("sgf", ids, points).force_W)
    assert apart.abs().max() < 1e-5 and not torch.equal(live.geodesic, near.geodesic)


@pytest.mark.parametrize("live", [False, True])
def test_fields_of_one_robot_are_those_of_the_batch(scenes, bank, rng, live):
    """NumPy and torch: the same points, movers and ways."""
    moments = Moments.of(bank, rate_hz=2.0, until_s=3.0)
    for time_s in (0.0, 0.9, 2.6):
        ids, when = torch.tensor([0]), torch.tensor([time_s])
        rows = moments.index(ids, when)
        world = MovingWorld(
            still=bank, movers=Courses.of(scenes).at(ids, when), newest=(moments.bank, rows) if live else None
        )
        then = scenes[0].at(newest_s(time_s, 2.0))
        pf = momentary_pf(
            build_hod_pf(scenes[0].still()),
            scenes[0].at(time_s).obstacles[:3],
            build_hod_pf(then) if live else None,
        )
        p_W = rng.uniform([0.0, -0.8, 0.2], [2.0, 0.8, 1.2], (400, 3)).astype(np.float32)
        p_W[:30] += np.array(then.obstacles[0].position_m, np.float32) - p_W[:30].mean(axis=0)
        for name in ("sgf", "ogf"):
            got, want = getattr(pf, name).query(p_W), world.sample(name, ids, torch.from_numpy(p_W)[None])
            for mine, theirs in zip(got, (want.force_W, want.signed_distance, want.geodesic), strict=True):
                assert mine.dtype == np.float32
                np.testing.assert_allclose(mine, theirs[0], rtol=3e-5, atol=6e-5)
    nothing = momentary_pf(build_hod_pf(scenes[1]), ())
    np.testing.assert_array_equal(nothing.sgf.query(p_W)[0], build_hod_pf(scenes[1]).sgf.query(p_W)[0])


# ---- what is known ---------------------------------------------------------------------------------------------------


def test_movers_are_seen_late_and_go_on_as_they_were():
    motion = Motion(
        way_points=tuple(WayPoint(time_s=t, position_m=(1.0, y, 0.0)) for t, y in ((0.0, -1.0), (1.0, 0.0), (2.0, 0.0)))
    )
    scene = Scene("s", obstacles=(Obstacle("it", "side", SphereShape(0.2), (1.0, -1.0, 0.5), motion=motion),))
    courses, ids = Courses.of([scene]), torch.zeros(6, dtype=torch.int64)
    times = torch.tensor([0.0, 0.15, 0.5, 0.98, 1.15, 1.4])
    seen = courses.seen(ids, times, rate_hz=10.0, delay_s=0.1)
    # nobody has seen it move at first; then the straight course is known; after the stop it goes on until that is seen
    np.testing.assert_allclose(seen.p_W[:, 0, 1], [-1.0, -1.0, -0.5, -0.02, 0.15, 0.0], atol=1e-5)
    np.testing.assert_allclose(seen.v_W[:, 0, 1], [0.0, 0.0, 1.0, 1.0, 1.0, 0.0], atol=1e-4)
    exact = courses.seen(ids, times, rate_hz=1000.0, delay_s=0.0)
    np.testing.assert_allclose(exact.p_W, courses.at(ids, times).p_W, atol=2e-3)


def test_a_turn_is_foreseen():
    points = tuple(WayPoint(time_s=t, position_m=(1.0, 0.0, 0.0), yaw_rad=1.0 * t) for t in (0.0, 2.0))
    door = Obstacle("door", "side", BoxShape((0.1, 0.8, 1.4)), (1.0, 0.4, 0.7), motion=Motion(way_points=points))
    courses, ids = Courses.of([Scene("s", obstacles=(door,))]), torch.tensor([0])
    seen, true = courses.seen(ids, torch.tensor([1.0]), 10.0, 0.1), courses.at(ids, torch.tensor([1.0]))
    np.testing.assert_allclose(seen.R_WB, true.R_WB, atol=1e-5)
    # the place goes on straight along the chord, not on its arc
    assert 0.0 < (seen.p_W - true.p_W).norm() < 0.01


def test_sight_of_one_is_that_of_the_batch(scenes):
    courses = Courses.of(scenes)
    for row in (0, 2):
        moving = scenes[row].moving
        for time_s in TIMES.tolist():
            for rate_hz, delay_s in ((10.0, 0.1), (4.0, 0.0), (30.0, 0.25)):
                want = courses.seen(torch.tensor([row]), torch.tensor([time_s]), rate_hz, delay_s)
                got = seen_moving(moving, time_s, rate_hz, delay_s)
                for m, obstacle in enumerate(got):
                    np.testing.assert_allclose(obstacle.position_m, want.p_W[0, m], atol=2e-5)
                    np.testing.assert_allclose(quat_to_mat(obstacle.quaternion_wxyz), want.R_WB[0, m], atol=2e-5)
    assert moved(moving, poses_of(got)) == got and all(o.motion is None for o in got)
