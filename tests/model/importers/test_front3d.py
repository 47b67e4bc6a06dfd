import hashlib
import json
import shutil

import numpy as np
import pytest

from hotice.commands.program import main
from hotice.errors import InputError, InvalidConfig, InvalidMap, InvalidScene
from hotice.model import load_scene
from hotice.model.frames import quat_from_yaw
from hotice.model.generate.traversable import check_traversable
from hotice.model.geometry.extents import extent
from hotice.model.geometry.shapes import BoxShape, MeshShape
from hotice.model.importers.front3d import Front3dReport, House, PlacedMesh, load_house
from hotice.model.importers.house_scenes import (
    Front3dConfig,
    SolidHouse,
    crop_house,
    floor_below,
    front3d_scenes,
    import_front3d,
    level_clearance,
)
from hotice.model.importers.polygons import triangulated
from hotice.model.importers.solids import MAX_BODIES, SHEET_M, VOXEL_M, solidify
from tests.model.importers import front3d_fixture as fixture

HOUSE, MODELS = fixture.FOLDER / "house.json", fixture.FOLDER / "models"


@pytest.fixture(scope="module")
def house():
    return load_house(HOUSE, MODELS)


def piece(house, word):
    return next(p for p in house.pieces if word in p.name)


def written(folder, data=None, **models):
    """A copy of the fixture with another house or more models."""
    for path, text in (fixture.files() | {f"models/{k}/raw_model.obj": v for k, v in models.items()}).items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text)
    if data is not None:
        (folder / "house.json").write_text(data if isinstance(data, str) else json.dumps(data))
    return folder / "house.json", folder / "models"


# Loading


def test_the_stored_fixture_is_what_its_generator_writes():
    for path, text in fixture.files().items():
        assert (fixture.FOLDER / path).read_text() == text


def test_a_box_lands_where_computed_by_hand(house):
    """The model, 1.2 x 0.7 x 0.6 standing on its origin, is scaled, turned by 60 degrees about y, moved, and turned z
    up.

    About the file's y axis, x turns towards -z, which is +y of H: the turn is +60 degrees about z of H."""
    table = piece(house, "coffee_table")
    x, z = 0.5 * np.array(fixture.TABLE_SIZE)[[0, 2]] * np.array(fixture.TABLE_POSE["scale"])[[0, 2]]
    cos, sin = 0.5, np.sqrt(0.75)
    expected = {
        (round(3.0 + cos * a - sin * b, 4), round(2.6 + sin * a + cos * b, 4), h)
        for a in (x, -x)
        for b in (z, -z)
        for h in (0.0, 0.7)
    }
    corners = {tuple(p) for p in (table.corners_H.reshape(-1, 3).round(4) + 0.0).tolist()}
    assert corners == expected
    np.testing.assert_allclose(table.quaternion_wxyz, quat_from_yaw(np.pi / 3), atol=1e-12)


def test_nothing_is_mirrored(house):
    """The chair's back is at -z of its model. A quarter turn about y takes it to -x, the same in H; without a turn it
    is at +y of H. Swapping y and z instead of turning the frame would put it elsewhere."""
    back = np.array([c for c in piece(house, "chair_6").corners_H.reshape(-1, 3) if c[2] > 0.8])
    np.testing.assert_allclose([back[:, 0].min(), back[:, 0].max()], [1.2 - 0.22, 1.2 - 0.19], atol=1e-9)
    back = np.array([c for c in piece(house, "chair_17").corners_H.reshape(-1, 3) if c[2] > 0.8])
    np.testing.assert_allclose([back[:, 1].min(), back[:, 1].max()], [3.4 + 0.19, 3.4 + 0.22], atol=1e-9)


def test_floors_are_at_zero_and_known_by_room(house):
    assert [(f.room, f.height_m) for f in house.floors] == [("LivingRoom_1", 0.0), ("Bedroom_2", 0.0)]
    assert floor_below(house, (1.0, 1.0)).room == "LivingRoom_1" and floor_below(house, (9.0, 3.9)).room == "Bedroom_2"
    assert floor_below(house, (5.1, 2.0)) is None and floor_below(house, (-0.1, 2.0)) is None
    living = house.floors[0].triangles
    assert len(living) == 8 and living.min() == 0.0 and living[..., 0].max() == 5.0


def test_every_defect_is_counted(house):
    assert house.report.used == {"floor": 2, "furniture": 12, "structure": 6}
    assert house.report.dropped == {
        "absurd placement": 1,
        "absurd scale": 1,
        "ceiling or hole, on purpose": 1,
        "dangling reference": 2,
        "entry without uid": 1,
        "furniture marked as not valid": 1,
        "furniture of absurd size": 1,
        "malformed placement": 1,
        "mesh with impossible faces": 1,
        "mesh without triangles": 1,
        "missing model": 1,
        "placement with non-finite numbers": 1,
        "uid given twice": 1,
        "unreadable model": 1,
        "unsafe model name": 1,
    }
    assert house.report.mended == {
        "furniture without valid flag": 3,
        "mesh in no room, placed as it is": 1,
        "mesh of quads": 1,
        "mesh with non-finite vertices": 1,
        "model with non-finite vertices": 1,
        "normalized model scaled to its size": 1,
    }
    assert ("dropped", "missing model", 1) in house.report.rows()


def test_normalized_model_takes_its_size(house):
    p = piece(house, "barstool").corners_H
    np.testing.assert_allclose([p.min(axis=(0, 1)), p.max(axis=(0, 1))], [[7.0, 1.4, 0.0], [7.4, 1.8, 0.5]], atol=1e-9)


@pytest.mark.parametrize(
    "text, match",
    [
        ("", "not JSON"),
        ("[" * 200_000, "nested too deeply"),
        ("[1]", "no scene.room"),
        ("{}", "no scene.room"),
        ('{"scene": {"room": [{"children": []}]}}', "no floor"),
        ('{"scene": {"room": {"children": 3}}}', "no scene.room"),
        ('{"x": ' + "9" * 5000 + "}", "5000 digits"),
        (json.dumps({"scene": {"room": [0] * 100_001}}), "entries"),
    ],
)
def test_bad_houses_are_refused(tmp_path, text, match):
    house, models = written(tmp_path, text)
    with pytest.raises(InvalidMap, match=match) as caught:
        load_house(house, models)
    assert "\n" not in str(caught.value) and str(house) in str(caught.value)


def test_missing_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_house(tmp_path / "house.json", MODELS)
    with pytest.raises(InputError, match="no such folder"):
        load_house(HOUSE, tmp_path / "models")


def test_links_out_of_the_models_folder_are_refused(tmp_path):
    house, models = written(tmp_path)
    outside = tmp_path / "outside"
    (models / "table").rename(outside)
    (models / "table").symlink_to(outside)
    (models / "books" / "raw_model.obj").unlink()
    (models / "books" / "raw_model.obj").symlink_to(outside / "raw_model.obj")
    report = load_house(house, models).report
    assert report.dropped["model outside the models' folder"] == 3 and report.used["furniture"] == 9


def test_odd_entries_do_not_stop_the_house(tmp_path):
    data = fixture.house()
    data["furniture"] += [3, None, {"uid": ["x"]}, {"uid": "f_list", "jid": ["table"], "valid": True}]
    data["mesh"] += ["x", {"uid": "m_text", "type": 7, "xyz": ["a"] * 9, "faces": [0, 1, 2]}]
    data["scene"]["room"] += [None, {"children": [None, 5, {"ref": "f_list"}, {"ref": "f_table", "pos": "here"}]}]
    report = load_house(*written(tmp_path, data)).report
    assert report.used["furniture"] == 12 and report.dropped["entry without uid"] == 5
    assert report.dropped["malformed placement"] == 2 and report.dropped["dangling reference"] == 4


# Polygons


def test_flat_faces_of_either_kind_and_nested_ones():
    entry = fixture.mesh("m", "w", [fixture.upright((x, 0), (x + 1, 0)) for x in range(3)], quads=True)
    p, n = (np.array(entry[k]).reshape(-1, 3) for k in ("xyz", "normal"))
    assert len(entry["faces"]) == 12
    assert triangulated([0, 1, 2, 3, 4, 5], p, n)[1] is False and triangulated([0, 1, 2, 3] * 2, p, n)[1] is True
    nested, polygons = triangulated([[0, 1, 2], [4, 5, 6, 7]], p, None)
    assert polygons and nested.tolist() == [[0, 1, 2], [4, 5, 6], [4, 6, 7]]


def test_twelve_corners_are_read_by_their_normals():
    """Three quads at right angles: read as four triangles, some would join corners of two quads."""
    quads = [fixture.flat((0, 1), (0, 1), 0.0), fixture.upright((0, 0), (1, 0)), fixture.upright((1, 0), (1, 1))]
    for as_quads in (True, False):
        chosen = quads if as_quads else quads[:2]
        entry = fixture.mesh("m", "w", chosen, quads=as_quads)
        p, n = (np.array(entry[k]).reshape(-1, 3) for k in ("xyz", "normal"))
        assert len(entry["faces"]) == 12
        triangles, polygons = triangulated(entry["faces"], p, n)
        corners = p[triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert polygons == as_quads and area == pytest.approx(1.0 + 2.5 * (len(chosen) - 1))
    assert triangulated(list(range(12)), p[[0] * 12], None)[1] is False


@pytest.mark.parametrize(
    "faces", [[0, 1, 9], [0, 1, -1], [0, 1, 2.5], [0, 1, "2"], [0, 1, 2, 3, 4], [[0, 1, 9]], [[None]]]
)
def test_impossible_faces(faces):
    with pytest.raises(ValueError, match="vertex numbers|neither"):
        triangulated(faces, np.zeros((8, 3)), None)


# Solids


def inside(solid, p):
    """Whether points lie in a solid whose parts are all boxes."""
    assert not solid.bodies
    return ((p[:, None] > solid.boxes[:, 0]) & (p[:, None] < solid.boxes[:, 1])).all(axis=2).any(axis=1)


def quads(polygons):
    return np.array([t for a, b, c, d in polygons for t in ((a, b, c), (a, c, d))])


def test_closed_and_nearly_closed_boxes_stay_exact():
    whole = quads(fixture.standing(1.0, 0.5, 0.4))
    for corners, how in ((whole, "closed"), (whole[1:], "repaired")):
        solid = solidify(corners)
        assert solid.how == how and not solid.bodies
        np.testing.assert_allclose(solid.boxes, [[[-0.5, 0.0, -0.2], [0.5, 0.5, 0.2]]])


def test_other_closed_bodies_stay_meshes():
    solid = solidify(quads(fixture.shade()))
    ((vertices, faces),) = solid.bodies
    assert solid.how == "closed" and len(solid.boxes) == 0 and len(vertices) == 8 and len(faces) == 12


def test_a_wall_with_a_doorway_becomes_plates():
    solid = solidify(quads(fixture.with_doorway(5.0)), max_sheets=MAX_BODIES)
    assert solid.how == "thickened" and np.ptp(solid.boxes[..., 0]) == pytest.approx(SHEET_M)
    volume = (solid.boxes[:, 1] - solid.boxes[:, 0]).prod(axis=1).sum()
    assert volume == pytest.approx(SHEET_M * (2.5 * 4.0 - 2.0 * 1.0))
    assert not inside(solid, np.array([[5.0, 1.0, -2.0]])).any() and inside(solid, np.array([[5.0, 1.0, -1.2]])).all()


def test_a_slanting_sheet_becomes_a_closed_plate():
    solid = solidify(np.array([[[0, 0, 0], [1, 0, 1], [0, 1, 0]], [[1, 0, 1], [1, 1, 1], [0, 1, 0]]], float))
    ((vertices, faces),) = solid.bodies
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(SHEET_M * np.sqrt(2.0))


def test_an_open_shelf_becomes_boxes_with_its_air_kept():
    solid = solidify(quads(fixture.shelf()))
    assert solid.how == "boxed" and len(solid.boxes) < 40
    np.testing.assert_allclose(
        [solid.boxes[:, 0].min(axis=0), solid.boxes[:, 1].max(axis=0)],
        [[-0.5, 0.0, -0.15], [0.5, 1.8, 0.15]],
        atol=1e-9,
    )
    surface = quads(fixture.shelf()).mean(axis=1)
    assert inside(solid, surface * 0.999 + [0.0, 1e-4, 0.0]).all()
    rng = np.random.default_rng(0)
    p = rng.uniform([-0.5, 0.0, -0.15], [0.5, 1.8, 0.15], (4000, 3))
    gap = np.minimum.reduce(
        [0.5 - np.abs(p[:, 0]), p[:, 2] + 0.15, *(np.abs(p[:, 1] - h) for h in (0.0, 0.05, 0.6, 1.2, 1.8))]
    )
    assert not inside(solid, p[gap > 1.1 * VOXEL_M]).any()


def test_what_a_leaky_surface_encloses_is_solid():
    """Five sides of a box, open towards the floor (the mesh's third axis is up): filled."""
    corners = quads([q for k, q in enumerate(fixture.box((-0.3, 0.3), (-0.3, 0.3), (0.0, 0.6))) if k != 4])
    extra = corners * 0.5 + [0.0, 0.0, 0.2]
    solid = solidify(np.concatenate([corners, extra[:3]]))
    assert inside(solid, np.random.default_rng(0).uniform([-0.29, -0.29, 0.0], [0.29, 0.29, 0.59], (200, 3))).all()


# Scenes


def test_crop_round_a_way_by_hand(house, tmp_path):
    scene = crop_house(SolidHouse(house, tmp_path), "c", (0.8, 1.2), (3.2, 1.2), (4.0, 3.0, 1.5))
    names = {o.name.rsplit("_", 2)[0] for o in scene.obstacles}
    assert {"livingroom_1_lighting_9", "livingroom_1_chair_6", "livingroom_1_wallinner_1"} <= names
    assert not any("shelf" in n or "rug" in n or "chair_7" in n for n in names)
    category = {o.name: o.category for o in scene.obstacles}
    assert (
        category["livingroom_1_lighting_9_body_1"] == "overhead" and category["livingroom_1_books_11_box_1"] == "ground"
    )
    lamp = next(o for o in scene.obstacles if o.name == "livingroom_1_lighting_9_body_1")
    assert isinstance(lamp.shape, MeshShape)
    np.testing.assert_allclose(extent(lamp), [[1.2, -0.2, 1.2], [1.6, 0.2, 1.5]], atol=1e-6)
    table = next(o for o in scene.obstacles if "coffee_table" in o.name)
    assert isinstance(table.shape, BoxShape)
    np.testing.assert_allclose(table.shape.size_m, [1.8, 0.3, 0.7], atol=1e-9)
    np.testing.assert_allclose(table.position_m, [2.2, 1.4, 0.35], atol=1e-6)
    assert scene.signed_distance(np.array([1.4, 0.0, 1.0])) == pytest.approx(0.2, abs=1e-6)


@pytest.mark.parametrize(
    "start, goal, match", [((-1, 1), (1, 1), "start .* on no floor"), ((1, 1), (5.1, 2), "goal .* on no")]
)
def test_crops_need_a_floor(house, tmp_path, start, goal, match):
    with pytest.raises(InvalidScene, match=match):
        crop_house(SolidHouse(house, tmp_path), "c", start, goal)


def test_levels_are_kept_apart(tmp_path):
    data = fixture.house()
    floor = next(m for m in data["mesh"] if m["uid"] == "m_floor_2")
    floor["xyz"] = [v + 3.0 if k % 3 == 1 else v for k, v in enumerate(floor["xyz"])]
    house = load_house(*written(tmp_path, data))
    assert [f.height_m for f in house.floors] == [0.0, 3.0]
    with pytest.raises(InvalidScene, match="one level"):
        crop_house(SolidHouse(house, tmp_path), "c", (4.0, 2.0), (6.0, 2.0))


def test_clearance_of_a_level(house):
    clearance = level_clearance(house, list(house.floors))
    p = np.array([[0.5, 1.0], [5.1, 2.0], [2.2, 1.2], [-1.0, 2.0]])
    np.testing.assert_allclose(clearance(p), [0.5, 0.5, 0.0, -1.0], atol=0.12)


def test_a_closed_body_that_no_mesh_obstacle_may_be_becomes_boxes(tmp_path, monkeypatch):
    def refuse(shape):
        raise InvalidScene("not as a mesh")

    monkeypatch.setattr(MeshShape, "mesh", refuse)
    a, b, c, d = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    corners = np.array([[a, c, b], [a, b, d], [a, d, c], [b, c, d]])
    assert solidify(corners).how == "closed"
    body = PlacedMesh(name="s", kind="furniture", corners=corners, position_m=(0, 0, 0), quaternion_wxyz=(1, 0, 0, 0))
    report = Front3dReport(used={}, dropped={}, mended={})
    solids = SolidHouse(House(name="h", pieces=(body,), floors=(), report=report), tmp_path)
    obstacles = solids.obstacles((-1, -1, 0), (2, 2, 2), 0.0)
    assert solids.solids == {"furniture boxed": 1} and all(isinstance(o.shape, BoxShape) for o in obstacles)
    assert not list(tmp_path.iterdir())


def test_scenes_of_a_house_can_be_crossed_and_read_again(tmp_path):
    found = front3d_scenes(HOUSE, MODELS, tmp_path, count=3, seed=2, size_m=(4.0, 2.6, 1.5))
    again = front3d_scenes(HOUSE, MODELS, tmp_path, count=3, seed=2, size_m=(4.0, 2.6, 1.5))
    assert found == again and len(found.scenes) == 3
    assert [s.name for s in found.scenes] == [f"front3d_house_{n}" for n in range(2000, 2003)]
    for scene in found.scenes:
        scene.save(tmp_path / "scene.json")
        assert load_scene(tmp_path / "scene.json") == scene
        assert 2.0 - 1e-6 <= scene.goal[0] <= 3.0
        assert (
            min(
                scene.signed_distance(np.array([[x, 0.0, z] for x in np.linspace(0, scene.goal[0], 30)])).min()
                for z in (0.05, 0.3, 0.75, 1.2)
            )
            < 0.6
        )
    assert check_traversable(found.scenes[0]).ok
    assert set(found.solids) <= {
        f"{a} {b}" for a in ("furniture", "structure") for b in ("closed", "repaired", "thickened", "boxed")
    }


def test_the_command_writes_scenes_and_says_what_it_left_out(tmp_path, capsys):
    config = Front3dConfig(house=HOUSE, models=(MODELS,), out=tmp_path / "out", count=1, size_m=(4.0, 2.6, 1.5))
    assert import_front3d(config) == 0
    (file,) = (tmp_path / "out").glob("*.json")
    assert load_scene(file).obstacles
    printed = capsys.readouterr().out
    assert "dangling reference" in printed and "absurd scale" in printed and "1 scenes" in printed


def test_models_in_several_folders(tmp_path, capsys, house):
    """A house whose models came in two parts; what is in neither is said as a share."""
    first, second = tmp_path / "first", tmp_path / "second"
    for n, folder in enumerate(sorted(MODELS.iterdir())):
        shutil.copytree(folder, (first, second)[n % 2] / folder.name)
    both = load_house(HOUSE, (first, second))
    assert both.report == house.report and len(both.pieces) == len(house.pieces)
    whole, part = house.report.missing_share, load_house(HOUSE, first).report.missing_share
    assert whole == pytest.approx(1 / 13) and part > 0.3
    with pytest.raises(InputError, match="no such folder"):
        load_house(HOUSE, (first, tmp_path / "third"))
    command = ["import-front3d", "--house", str(HOUSE), "--out", str(tmp_path / "out"), "--count", "1", "--models"]
    for folders, share in (((first,), part), ((first, second), whole)):
        assert main(["scene", *command, *map(str, folders)]) == 0
        assert f"{100 * share:.0f} % of the furniture is missing" in capsys.readouterr().out


def test_crops_know_where_the_house_lies(house, tmp_path):
    """A point of the house's file (y up) lies in the crop where its obstacle does."""
    scene = crop_house(SolidHouse(house, tmp_path), "c", (1.0, 1.0), (3.0, 1.4))
    assert scene.source and scene.source.file == "house.json"
    assert scene.source.sha256 == hashlib.sha256(HOUSE.read_bytes()).hexdigest()
    y_up = np.array([[1.0, 0.0, -1.0], [3.0, 0.5, -1.4]])  # x, z, -y of the house
    y_up[:, 1] += house.ground_m
    np.testing.assert_allclose(scene.source.to_scene(y_up), [[0.0, 0.0, 0.0], [*scene.goal, 0.5]], atol=1e-6)
    scene.save(tmp_path / "scene.json")
    assert load_scene(tmp_path / "scene.json") == scene


def test_a_house_without_ways_leaves_nothing(tmp_path):
    data = fixture.house()
    data["furniture"] = []
    house, models = written(tmp_path, data)
    assert import_front3d(Front3dConfig(house=house, models=(models,), out=tmp_path / "out", count=1)) == 1
    assert not (tmp_path / "out").exists()


def test_nothing_is_written_for_a_bad_house(tmp_path):
    house, models = written(tmp_path, "{")
    with pytest.raises(InvalidMap):
        import_front3d(Front3dConfig(house=house, models=(models,), out=tmp_path / "out"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("bad", [{"count": 0}, {"seed": -1}, {"size_m": (1.0, 2.0, 1.5)}, {"size_m": (5.0, 50.0, 1.5)}])
def test_bad_arguments(tmp_path, bad):
    with pytest.raises(InvalidConfig, match="allowed"):
        front3d_scenes(HOUSE, MODELS, tmp_path, **{"count": 1} | bad)
