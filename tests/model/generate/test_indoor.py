from collections import Counter

import numpy as np
import pytest

from hotice.errors import InvalidScene
from hotice.model import Obstacle, Scene
from hotice.model.frames import quat_from_yaw
from hotice.model.generate import furniture, rooms
from hotice.model.generate.crop import (
    BODY_M,
    LOAD_AHEAD_M,
    LOAD_M,
    SMALL_M,
    SPACING_M,
    ClearanceMap,
    crop,
    propose_ways,
)
from hotice.model.generate.indoor import IndoorScenes, indoor_scene, indoor_scenes
from hotice.model.generate.traversable import check_traversable
from hotice.model.geometry.extents import extent
from hotice.model.geometry.shapes import BoxShape

KINDS = list(rooms.RECIPES)


@pytest.fixture(scope="module")
def drawn() -> IndoorScenes:
    return indoor_scenes(6, seed=1)


# Rooms


@pytest.mark.parametrize("kind", KINDS)
def test_furniture_stays_in_the_room_and_apart(kind):
    room = rooms.furnish(kind, 0.8, np.random.default_rng(5))
    assert len(room.kinds) >= 3
    walls = [o for o in room.obstacles if o.name.endswith("_wall") or o.name.startswith("door")]
    for obstacle in room.obstacles:
        low, high = extent(obstacle)
        assert (high[0] > 0.0 and low[0] < room.length_m) or obstacle in walls
        if obstacle not in walls:
            assert low[:2].min() >= 0.0 and high[0] <= room.length_m and high[1] <= room.width_m
    built = 6 * len(room.doors) + 3
    for i, a in enumerate(room.taken[built:], built):
        assert all(((a[1] <= b[0]) | (b[1] <= a[0])).any() for b in room.taken[:i])


def test_density_fills_a_room():
    number = [
        np.mean([len(rooms.furnish("storage", d, np.random.default_rng(s)).kinds) for s in range(8)]) for d in (0, 1)
    ]
    assert number[0] + 4 < number[1]


def test_the_door_leads_out():
    room = rooms.furnish("living", 0.0, np.random.default_rng(0))
    clearance = room.clearance()
    (x, y, width) = room.doors[0]
    middle = np.array([[x - 0.05, y], [x - 0.6, y]])
    assert (clearance(middle) > 0.5 * width - 0.1).all()
    assert (clearance(np.array([[x - 0.6, y + 0.5 * width + 0.4], [-9.0, y]])) < 0.0).all()


def test_clearance_is_the_distance_to_furniture():
    room = rooms.Room(rng=np.random.default_rng(0), length_m=4.0, width_m=4.0)
    assert room.place(
        furniture.Piece("post", (Obstacle("p", "side", BoxShape((0.4, 0.4, 1.5)), (0, 0, 0.75)),)), 2, 2, 0.0
    )
    clearance = room.clearance()
    p = np.array([[3.0, 2.0], [2.0, 1.3], [2.6, 2.6]])
    np.testing.assert_allclose(clearance(p), [0.8, 0.5, 0.4 * np.sqrt(2)], atol=1e-6)
    assert not room.place(furniture.chair(room.rng), 2.3, 2.0, 0.0) and not room.place(
        furniture.chair(room.rng), 4.0, 1, 0
    )


# Ways and crops


def map_of(distance) -> ClearanceMap:
    """A map of a square of 6 m."""
    x = np.arange(61) * SPACING_M
    nearest = distance(np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1))
    return ClearanceMap(origin=np.zeros(2), nearest=nearest, things=nearest)


def test_ways_pass_something_and_keep_room_for_the_load():
    def beside_a_post(p):
        return np.minimum(np.linalg.norm(p - 3.0, axis=-1) - 0.3, np.minimum(p, 6.0 - p).min(axis=-1))

    clearance = map_of(beside_a_post)
    ways = propose_ways(clearance, np.random.default_rng(0))
    start, goal = np.array([w.start for w in ways]), np.array([w.goal for w in ways])
    length = np.linalg.norm(goal - start, axis=1)
    assert len(ways) > 50 and (length > 2.0 - 1e-9).all() and (length < 3.0).all()
    assert 0.3 < (length < 2.0 + 1e-9).mean() < 0.8
    ahead = (goal - start) / length[:, None] * LOAD_AHEAD_M
    assert min(clearance(start).min(), clearance(goal).min()) > BODY_M
    assert min(clearance(start + ahead).min(), clearance(goal + ahead).min()) > LOAD_M
    crowding = [w.crowding for w in ways]
    assert crowding == sorted(crowding) and crowding[0] > 0.0
    for uniform in (9.0, 0.1):
        assert propose_ways(map_of(lambda p, c=uniform: np.full(p.shape[:-1], c)), np.random.default_rng(0)) == []


def test_a_crop_lies_along_its_way():
    """A box beside the middle of a way that leads along -y ends up to the left or right of x = 1."""
    left = Obstacle("left", "side", BoxShape((0.2, 0.4, 1.0)), (5.6, 2.0, 0.5))
    far = Obstacle("far", "side", BoxShape((0.2, 0.2, 1.0)), (7.0, 2.0, 0.5))
    high = Obstacle("high", "overhead", BoxShape((0.2, 0.2, 0.2)), (5.0, 2.0, 1.7))
    scene = crop("c", [left, far, high], (5.0, 3.0), (5.0, 1.0), SMALL_M)
    assert scene.bounds_m == ((-0.5, -1.0, 0.0), (2.5, 1.0, 1.5)) and scene.goal == (2.0, 0.0)
    (kept,) = scene.obstacles
    np.testing.assert_allclose(kept.position_m, [1.0, 0.6, 0.5], atol=1e-6)
    np.testing.assert_allclose(np.abs(kept.quaternion_wxyz), quat_from_yaw(np.pi / 2), atol=1e-12)
    p = np.array([1.0, 0.0, 0.5])
    assert scene.signed_distance(p) == pytest.approx(0.5)


@pytest.mark.parametrize("goal", [(0.0, 0.0), (3.5, 0.0)])
def test_a_crop_must_hold_its_way(goal):
    with pytest.raises(InvalidScene, match="from start"):
        crop("c", [], (0.0, 0.0), goal, SMALL_M)


# Scenes


def test_scenes_are_reproducible_and_survive_a_file(drawn):
    again = indoor_scene(0.2, 10_001)
    assert again == drawn.scenes[1] and again != indoor_scene(0.2, 10_007)
    assert [Scene.from_dict(s.to_dict()) for s in drawn.scenes] == list(drawn.scenes)
    assert [s.name for s in drawn.scenes] == [f"indoor_{KINDS[n % 6]}_{n}" for n in range(10_000, 10_006)]
    assert all(count > 0 for count in drawn.rejected.values())


def test_every_scene_can_be_crossed_and_passes_something(drawn):
    for scene in drawn.scenes:
        x, y = np.meshgrid(np.linspace(0, scene.goal[0], 40), [0.0])
        line = np.stack([x.ravel(), y.ravel()], axis=-1)
        near = min(scene.signed_distance(np.column_stack([line, np.full(40, z)])).min() for z in rooms.HEIGHTS_M)
        assert near < 0.6 and scene.obstacles
        assert 2.0 - 1e-6 <= scene.goal[0] <= 3.0 and scene.start == (0.0, 0.0, 0.0)
    assert all(check_traversable(s).ok for s in sorted(drawn.scenes, key=lambda s: len(s.obstacles))[:2])


def test_categories_occur(drawn):
    counts = Counter(o.category for s in drawn.scenes for o in s.obstacles)
    assert counts["side"] > counts["overhead"] + counts["ground"] > 0


@pytest.mark.parametrize("count, seed", [(0, 0), (10_001, 0), (3, -1)])
def test_bad_numbers(count, seed):
    with pytest.raises(InvalidScene, match="indoor scenes"):
        indoor_scenes(count, seed)


def test_bad_difficulty():
    for difficulty, number in ((1.5, 0), (-0.1, 0), (float("nan"), 0), (0.5, -1)):
        with pytest.raises(InvalidScene, match="indoor scene "):
            indoor_scene(difficulty, number)
