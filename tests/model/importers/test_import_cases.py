"""Imports that people met: rooms with ceilings, bodies over the border, maps far away, upside down or aslant."""

import numpy as np
import pytest
import trimesh

from hotice.errors import InvalidConfig, InvalidMap, InvalidScene
from hotice.model.frames import quat_from_axis_angle, quat_to_mat
from hotice.model.geometry.shapes import BoxShape, MeshShape
from hotice.model.importers import voxels
from hotice.model.importers.bodies import inside, rooms_and_solids
from hotice.model.importers.scene_import import ImportOptions, from_points, from_triangles, import_scene
from hotice.model.importers.upright import TURNED, fit_upright
from tests.model.importers.test_importers import block, pcd_bytes, rectangle, room, turned

ACROSS = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0))


def box(low, high, inwards=False):
    mesh = trimesh.creation.box(np.subtract(high, low))
    corners = (mesh.vertices + 0.5 * np.add(low, high))[mesh.faces]
    return corners[:, ::-1] if inwards else corners


def pierced(low, high):
    """A box with a hole of a few centimetres, as scans have them."""
    mesh = trimesh.creation.box(np.subtract(high, low))
    for _ in range(4):
        mesh = mesh.subdivide()
    return ((mesh.vertices + 0.5 * np.add(low, high))[mesh.faces])[1:]


ROOM, CABINET = ((-1.5, -1.5, 0.0), (3.5, 1.5, 2.4)), ((0.8, 0.5, 0.0), (1.2, 0.9, 0.8))
FLOOR = np.array([[(-2, -2, 0), (4, -2, 0), (4, 2, 0)], [(-2, -2, 0), (4, 2, 0), (-2, 2, 0)]], dtype=float)


# rooms and bodies


@pytest.mark.parametrize("inwards", [False, True])
@pytest.mark.parametrize("ceiling", [False, True])
def test_a_closed_room_is_stood_on_at_its_floor(inwards, ceiling):
    walls = box(*ROOM, inwards)
    if not ceiling:
        walls = walls[walls[:, :, 2].min(axis=1) < 2.4]
    scene = from_triangles(np.concatenate([walls, box(*CABINET)]), ACROSS, "a").scene
    p_W = [(1.0, 0.7, 0.4), (1.0, 0.0, 0.4), (1.0, 0.7, 1.0)]
    np.testing.assert_allclose(scene.signed_distance(p_W), [-0.2, 0.5, 0.2], atol=1e-6)


def test_a_room_with_thick_walls_is_hollow():
    shell = np.concatenate([box((-1.7, -1.7, -0.2), (3.7, 1.7, 2.6)), box(*ROOM, inwards=True), box(*CABINET)])
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(5.6, 3.6, 1.5))
    scene = from_triangles(shell, options, "a").scene
    assert scene.signed_distance([1.0, 0.7, 0.4]) == pytest.approx(-0.2, abs=1e-6)
    assert scene.signed_distance([1.0, 0.0, 0.75]) == pytest.approx(0.5, abs=1e-6)  # to the cabinet
    assert scene.signed_distance([2.4, 0.0, 0.75]) == pytest.approx(1.1, abs=0.04)  # to the inner wall


def test_a_block_with_things_on_it_is_stood_on():
    """A closed ground 2.5 m thick is no room: things stand on it, and none inside."""
    ground = box((-2, -2, -2.5), (4, 2, 0))
    imported = from_triangles(np.concatenate([ground, box(*CABINET)]), ACROSS, "a")
    assert imported.floor.height_m == pytest.approx(0.0, abs=1e-9)
    assert imported.scene.signed_distance([1.0, 0.7, 1.0]) == pytest.approx(0.2, abs=1e-6)
    places = np.array([[0.0, 0.0], [2.0, 0.0]])
    corners = np.concatenate([ground, box(*CABINET)])
    place = rooms_and_solids(corners, np.ones(len(corners), bool), places)
    assert len(place.surface) == 0 and len(place.solids) == 2 and len(place.stood_on) == 4
    corners = np.concatenate([box((-2, -2, 0), (4, 2, 2.5)), box(*CABINET)])
    place = rooms_and_solids(corners, np.ones(len(corners), bool), places)
    assert len(place.surface) == 12 and len(place.solids) == 1


@pytest.mark.parametrize("size_m", [None, (4.0, 1.4, 1.5), (2.4, 1.4, 1.0)])
def test_a_body_across_the_border_stays_whole(size_m):
    wardrobe = box((0.4, 0.5, 0.0), (1.6, 0.95, 1.2))
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=size_m)
    scene = from_triangles(np.concatenate([FLOOR, wardrobe]), options, "a").scene
    assert [type(o.shape) for o in scene.obstacles] == [MeshShape]
    p_W = [(1.0, 0.7, 0.6), (1.0, 0.3, 0.6), (1.0, 0.7, 1.3)]
    np.testing.assert_allclose(scene.signed_distance(p_W), [-0.2, 0.2, 0.1], atol=1e-6)


def test_a_body_with_too_many_faces_is_solid_boxes():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    corners = np.concatenate([FLOOR, (ball.vertices + [1.0, 0.9, 0.7])[ball.faces]])
    assert len(ball.faces) > 4000
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(4.0, 2.0, 1.5))  # cuts the ball open
    scene = from_triangles(corners, options, "a").scene
    assert all(isinstance(o.shape, BoxShape) for o in scene.obstacles)
    rng = np.random.default_rng(0)
    p_W = rng.uniform((0.5, 0.4, 0.2), (1.5, 0.98, 1.2), (2000, 3))
    depth = 0.5 - np.linalg.norm(p_W - [1.0, 0.9, 0.7], axis=1)
    distance = scene.signed_distance(p_W)
    assert (distance[depth > 0.0] < 0.0).all() and (distance[depth < -0.08] > 0.0).all()


def test_inside_of_bodies():
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    p = np.array([[0.0, 0.0, 0.0], [0.49, 0.0, 0.0], [0.51, 0.0, 0.0], [5.0, 0.0, 0.0]])
    assert inside([(np.array(mesh.vertices), np.array(mesh.faces))], p).tolist() == [True, True, False, False]


@pytest.mark.parametrize("closed", [True, False])
def test_air_that_start_and_goal_share_stays_free(closed):
    """With its ceiling in the crop a room encloses all of its air; what is closed inside it is solid all the same."""
    scanned = (box if closed else pierced)((0.8, 0.7, 0.0), (1.2, 1.1, 0.8))
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(5.4, 3.4, 2.6), floor="given")
    scene = from_triangles(np.concatenate([box(*ROOM), scanned]), options, "a").scene
    free = [(0.0, 0.0, 0.5), (2.0, 0.0, 0.5), (1.0, 0.0, 1.0), (0.0, -1.2, 2.2)]
    assert (scene.signed_distance(free) > 0.1).all()
    solid = [(-1.5, 0.0, 1.0), (3.5, 0.0, 1.0), (1.0, -1.5, 1.0), (1.0, 1.5, 1.0), (1.0, 0.0, 2.4)]
    assert (scene.signed_distance(solid) < 0.01).all()
    assert scene.signed_distance([1.0, 0.9, 0.4]) == pytest.approx(-0.2, abs=0.05)


def test_a_start_in_a_cupboard_is_refused():
    """Only air that start and goal share is a room."""
    cupboard = box((-0.4, -0.4, 0.0), (0.4, 0.4, 2.0))
    with pytest.raises(InvalidScene, match="start .* is inside obstacle"):
        from_triangles(np.concatenate([FLOOR, cupboard]), ACROSS, "a")
    hollow = np.concatenate([FLOOR, pierced((-0.4, -0.4, 0.0), (0.4, 0.4, 2.0))])
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(4.0, 2.0, 2.4))
    with pytest.raises(InvalidScene, match="start .* is inside obstacle"):
        from_triangles(hollow, options, "a")


def test_enclosed_air_is_kept_by_masks():
    shell = np.ones((20, 12, 12), bool)
    shell[1:-1, 1:-1, :-1] = False
    stood = [np.zeros_like(shell) for _ in range(2)]
    stood[0][3, 6, 4] = stood[1][16, 6, 4] = True
    assert voxels.enclosed(shell).all()
    np.testing.assert_array_equal(voxels.enclosed(shell, stood), shell)
    wall = shell.copy()
    wall[10] = True  # start and goal do not share their air
    assert voxels.enclosed(wall, stood).all()


# clouds


def hall(rng, ceiling=True, low=(0.8, 0.5, -1.2), high=(1.2, 0.9, -0.4)):
    """The sensor's view of a hall with a block: z = 0 is 1.2 m above the floor, the ceiling as far above."""
    parts = [
        rectangle(rng, 30_000, (-3, -3, -1.2), (8, 0, 0), (0, 6, 0)),
        block(rng, 8000, low, high),
        rectangle(rng, 15_000, (-3, -3, -1.2), (8, 0, 0), (0, 0, 2.4)),
        rectangle(rng, 15_000, (-3, -3, -1.2), (0, 6, 0), (0, 0, 2.4)),
    ]
    if ceiling:
        parts.append(rectangle(rng, 30_000, (-3, -3, 1.2), (8, 0, 0), (0, 6, 0)))
    return np.concatenate(parts) + rng.normal(0.0, 0.003, (sum(map(len, parts)), 3))


PROBES = np.array([(1.0, 0.7, 0.4), (1.0, 0.0, 0.4), (1.0, 0.7, 1.0), (0.3, 0.7, 0.4)])


@pytest.mark.parametrize("ceiling", [True, False])
def test_an_upside_down_map_is_turned_over(ceiling, tmp_path):
    points = hall(np.random.default_rng(0), ceiling)
    straight = from_points(points, ACROSS, "a")
    assert not straight.upside_down
    (tmp_path / "hall.pcd").write_bytes(pcd_bytes(points @ TURNED, "binary", "<f8"))
    turned_over = import_scene(tmp_path / "hall.pcd", ACROSS)
    assert turned_over.upside_down and turned_over.notes["up"].startswith("-z")
    asked = import_scene(tmp_path / "hall.pcd", ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), up="-z"))
    assert asked.scene == turned_over.scene and asked.scene.source == turned_over.scene.source
    np.testing.assert_allclose(
        turned_over.scene.signed_distance(PROBES), straight.scene.signed_distance(PROBES), atol=1e-9
    )
    np.testing.assert_allclose(turned_over.scene.source.to_scene(np.zeros(3)), [0.0, 0.0, 1.2], atol=2e-3)
    np.testing.assert_allclose(turned_over.scene.source.to_scene([1.0, -0.7, 0.4])[:2], [1.0, 0.7], atol=2e-3)


def test_start_and_goal_that_would_be_mirrored_are_asked_for():
    points = hall(np.random.default_rng(1)) @ TURNED
    for more in ({"goal": (2.0, -0.2)}, {"start": (0.0, 0.1)}, {"start": (0.0, 0.0, 0.5)}):
        with pytest.raises(InvalidMap, match="--up=-z"):
            from_points(points, ImportOptions(**{"start": (0.0, 0.0), "goal": (2.0, 0.0)} | more), "a")


def test_a_map_that_says_neither_is_asked_for():
    rng = np.random.default_rng(2)
    both = np.concatenate([hall(rng), block(rng, 8000, (0.8, 0.5, -1.2), (1.2, 0.9, -0.4)) @ TURNED])
    with pytest.raises(InvalidMap, match="--up=z or --up=-z"):
        fit_upright(both)
    floor = rectangle(rng, 30_000, (-3, -3, 0.0), (8, 0, 0), (0, 6, 0))
    assert not fit_upright(floor)[0]
    assert not fit_upright(floor + [0.0, 0.0, -1.2])[0]  # the map's origin, the sensor, is above
    assert fit_upright(floor + [0.0, 0.0, 1.2])[0]


def test_an_open_floor_in_a_hall_is_a_scene_without_obstacles():
    """If something beside it shows that it is the floor, and all of it was seen."""
    rng = np.random.default_rng(7)
    for ceiling in (True, False):
        points = hall(rng, ceiling, (0.8, 2.0, -1.2), (1.2, 2.4, -0.4))
        assert from_points(points, ACROSS, "a").scene.obstacles == ()
        turned_over = from_points(points @ TURNED, ACROSS, "a")
        assert turned_over.upside_down and turned_over.scene.obstacles == ()
        hole = (np.abs(points[:, :2] - (1.0, 0.0)) < 0.7).all(axis=1) & (points[:, 2] < -1.1)
        with pytest.raises(InvalidMap, match="not seen everywhere"):
            from_points(points[~hole], ACROSS, "a")
    upside_down = hall(rng, True, (0.8, 2.0, -1.2), (1.2, 2.4, -0.4)) @ TURNED
    with pytest.raises(InvalidMap, match="no ceiling"):
        from_points(upside_down, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), up="z"), "a")


def test_a_cloud_without_obstacles_or_below_its_floor_is_refused():
    rng = np.random.default_rng(3)
    floor = rectangle(rng, 30_000, (-3, -3, 0.0), (8, 0, 0), (0, 6, 0))
    with pytest.raises(InvalidMap, match="gives no obstacle.*--size-m"):
        from_points(floor, ACROSS, "a")
    for points, up, other in ((hall(rng, False) @ TURNED, "z", "-z"), (hall(rng, False), "-z", "z")):
        points = points if up == "z" else points @ TURNED
        with pytest.raises(InvalidMap, match=f"lie below the floor.*--up={other}"):
            from_points(points, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), up=up), "a")


@pytest.mark.parametrize("offset", [(0.0, 0.0, 120.0), (0.0, 0.0, -430.0)])
def test_altitude_does_not_count(offset):
    points = turned(room(np.random.default_rng(4)), (1.0, 0.5, 0.0), 0.02, 0.0)
    here, there = from_points(points, ACROSS, "a"), from_points(points + offset, ACROSS, "a")
    p_W = np.random.default_rng(5).uniform((-0.9, -0.9, 0.1), (2.9, 0.9, 1.4), (300, 3))
    np.testing.assert_allclose(there.scene.signed_distance(p_W), here.scene.signed_distance(p_W), atol=0.05)
    assert there.floor.to_world(np.array([0.0, 0.0, offset[2]]))[2] == pytest.approx(0.0, abs=2e-3)


def test_survey_coordinates(tmp_path):
    points, offset = room(np.random.default_rng(6)), np.array([400_000.0, 4_545_000.0, 311.0])
    here = from_points(points, ACROSS, "a")
    (tmp_path / "utm.pcd").write_bytes(pcd_bytes(points + offset, "binary", "<f8"))
    there = import_scene(
        tmp_path / "utm.pcd", ImportOptions(start=(400_000.0, 4_545_000.0), goal=(400_002.0, 4_545_000.0), frame="map")
    )
    np.testing.assert_allclose(there.scene.start, [0.0, 0.0, 0.0], atol=0.05)
    shift = np.array([*there.scene.start[:2], 0.0])
    p_W = np.random.default_rng(5).uniform((-0.9, -0.9, 0.1), (2.9, 0.9, 1.4), (300, 3))
    np.testing.assert_allclose(there.scene.signed_distance(p_W + shift), here.scene.signed_distance(p_W), atol=0.05)
    np.testing.assert_allclose(there.scene.source.to_scene([*offset[:2], 311.0]), shift, atol=3e-3)
    with pytest.raises(InvalidConfig, match="--frame map"):
        ImportOptions(start=(400_000.0, 4_545_000.0), goal=(400_002.0, 4_545_000.0))
    (tmp_path / "coarse.pcd").write_bytes(pcd_bytes(points + offset, "binary", "<f4"))
    with pytest.raises(InvalidMap, match="32-bit coordinates .* 50 cm apart: subtract an offset"):
        import_scene(tmp_path / "coarse.pcd", ACROSS)


def test_a_map_aslant_says_which_turn_helps():
    R = quat_to_mat(quat_from_axis_angle((0.0, 1.0, 0.0), np.radians(37.0)))
    R = quat_to_mat(quat_from_axis_angle((1.0, 0.0, 0.0), np.radians(10.0))) @ R
    points = hall(np.random.default_rng(7)) @ R.T
    with pytest.raises(InvalidMap, match=r"leans by 38 degrees.*--turn-deg (\S+) (\S+)$") as caught:
        from_points(points, ACROSS, "a")
    roll, pitch = map(float, str(caught.value).split("--turn-deg ")[1].split())
    from hotice.model.importers.scene_import import _turn

    turn = _turn(ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), turn_deg=(roll, pitch)), ".pcd")
    imported = from_points(points @ turn.T, ACROSS, "a")
    assert imported.floor.tilt_rad < np.radians(2.0) and imported.floor.height_m == pytest.approx(-1.2, abs=0.01)
