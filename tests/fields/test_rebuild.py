"""Fields that are built again after a change, `hotice.fields.rebuild`: bit for bit those of a build from nothing."""

from dataclasses import replace

import numpy as np
import pytest

from hotice.errors import InvalidScene
from hotice.fields.geodesic.changes import changed_boxes, changed_obstacles
from hotice.fields.rebuild import Rebuilder
from hotice.fields.volumes import solve_scene
from hotice.model import BoxShape, Obstacle
from hotice.model.frames import mat_to_quat
from hotice.model.geometry.shapes import CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.model.scene import MomentaryScene

H, MARGINS = 0.1, (0.0, 0.08)
BOUNDS = ((-0.5, -1.0, 0.0), (2.5, 1.0, 1.5))
SHAPES = (
    BoxShape((0.3, 0.5, 1.2)),
    CylinderShape(0.12, 1.3),
    CapsuleShape(0.1, 0.9),
    SphereShape(0.25),
    BoxShape((0.1, 1.2, 0.2)),
)


def scene(obstacles, goal=(2.0, 0.0), bounds=BOUNDS):
    return MomentaryScene("room", bounds, (0.0, 0.0, 0.0), goal, tuple(obstacles))


def drawn(rng, name, shapes=SHAPES):
    """An obstacle somewhere, turned somehow."""
    quat = mat_to_quat(np.linalg.qr(rng.normal(size=(3, 3)))[0])
    p_W = rng.uniform((0.2, -0.8, 0.2), (1.8, 0.8, 1.2))
    return Obstacle(name, "side", shapes[rng.integers(len(shapes))], tuple(p_W.tolist()), tuple(quat.tolist()))


def expect_fresh(rebuilder, now):
    mine, fresh = rebuilder.solve(now), solve_scene(now, H, MARGINS)
    np.testing.assert_array_equal(mine.sdf, fresh.sdf)
    assert mine.step == fresh.step
    for a, b in zip(mine.geo + mine.reached, fresh.geo + fresh.reached, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("seed", range(4))
def test_after_any_change_the_fields_are_those_of_a_fresh_build(seed, tmp_path):
    rng, rebuilder = np.random.default_rng(seed), Rebuilder(H, MARGINS, threads=1 + seed % 2)
    obstacles, goal, bounds = [drawn(rng, f"o{i}") for i in range(5)], (2.0, 0.0), BOUNDS
    if seed == 3:
        (tmp_path / "wedge.obj").write_text(
            "v 0 0 0\nv 0.4 0 0\nv 0 0.5 0\nv 0 0 1.3\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
        )
        obstacles[2] = Obstacle("wedge", "side", MeshShape(str(tmp_path / "wedge.obj")), (0.9, -0.2, 0.05))
    for k in range(24):
        expect_fresh(rebuilder, scene(obstacles, goal, bounds))
        i, kind = int(rng.integers(len(obstacles))), k % 8
        x, y, z = obstacles[i].position_m
        if kind < 3:
            dx, dy = rng.uniform(-0.2, 0.2, 2).tolist()
            obstacles[i] = replace(obstacles[i], position_m=(x + dx, y + dy, z))
        elif kind == 3:
            obstacles.append(drawn(rng, f"n{k}"))
        elif kind == 4:
            del obstacles[i]
        elif kind == 5:
            goal = (2.0, float(rng.uniform(-0.5, 0.5)))
        elif kind == 6:
            obstacles = obstacles[1:] + obstacles[:1]
        else:
            bounds = (BOUNDS[0], (2.5, 1.0, 1.5 + 0.1 * (k % 3)))


def test_what_comes_back_to_a_place_is_found_again():
    post = Obstacle("post", "side", CylinderShape(0.12, 1.4), (1.0, 0.1, 0.7))
    there = replace(post, position_m=(1.0, 0.2, 0.7))
    rebuilder = Rebuilder(H, MARGINS)
    for obstacle in (post, there, post, there, post):
        expect_fresh(rebuilder, scene([obstacle]))


def test_a_lone_obstacle_is_joined_by_others():
    post = Obstacle("post", "side", CylinderShape(0.12, 1.4), (1.0, 0.1, 0.7))
    ball = Obstacle("ball", "side", SphereShape(0.1), (0.6, 0.3, 0.8))
    rebuilder, kept = Rebuilder(H, MARGINS), []
    for obstacles in (
        [post],
        [post, ball],
        [replace(post, position_m=(1.1, 0.1, 0.7)), ball],
        [ball],
        [],
        [ball, post],
    ):
        expect_fresh(rebuilder, scene(obstacles))
        kept.append(searched(rebuilder) > 0)
    assert kept == [False, True, True, False, False, True]


def searched(rebuilder):
    return sum(int(kept.count[0]) for kept in rebuilder._searches.values())


def test_what_a_change_does_not_touch_is_not_searched_again():
    wall = Obstacle("wall", "side", BoxShape((0.1, 1.2, 1.5)), (1.2, 0.3, 0.75))
    ball = Obstacle("ball", "side", SphereShape(0.1), (-0.2, 0.8, 1.2))
    rebuilder = Rebuilder(H, MARGINS)
    rebuilder.solve(scene([wall, ball]))
    whole = searched(rebuilder)
    assert whole > 1000
    rebuilder.solve(scene([wall, ball]))
    assert searched(rebuilder) == whole
    rebuilder.solve(scene([wall, replace(ball, position_m=(-0.2, 0.8, 1.1))]))
    assert whole < searched(rebuilder) < 1.2 * whole


def test_after_a_scene_that_cannot_be_built_the_next_one_is(tmp_path):
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nf 1 2 3\n")
    post = Obstacle("post", "side", CylinderShape(0.12, 1.4), (1.0, 0.1, 0.7))
    rebuilder = Rebuilder(H, MARGINS)
    expect_fresh(rebuilder, scene([post]))
    with pytest.raises(InvalidScene):
        rebuilder.solve(scene([post, Obstacle("open", "side", MeshShape(str(tmp_path / "open.obj")), (0.5, 0.5, 0.0))]))
    expect_fresh(rebuilder, scene([replace(post, position_m=(0.9, 0.1, 0.7))]))


def test_changes_and_their_boxes():
    rng = np.random.default_rng(0)
    a, b, c = (drawn(rng, name) for name in "abc")
    assert changed_obstacles([a, b], [a, b]) == []
    assert changed_obstacles([a, b], [a, c]) == [b, c]
    assert changed_obstacles([a, b, c], [c, a]) is None
    for shape in SHAPES:
        obstacle = replace(a, shape=shape)
        (box,) = changed_boxes([obstacle], 0.08, H)
        p_W = np.array(obstacle.position_m) + rng.normal(0.0, 0.5, (20_000, 3))
        near = p_W[obstacle.signed_distance(p_W) <= 0.08]
        assert len(near) > 100 and (near >= box[:3]).all() and (near <= box[3:]).all()
