"""The map that a scene was cut from: its transform, its digest, and what keeps them."""

import hashlib
import json

import numpy as np
import pytest

from hotice.errors import InvalidScene
from hotice.model import Obstacle, Scene
from hotice.model.frames import quat_from_axis_angle, quat_rotate, quat_to_mat
from hotice.model.generate.crop import crop
from hotice.model.geometry.shapes import BoxShape
from hotice.model.importers.scene_import import ImportOptions, import_scene
from hotice.model.source import MapSource
from tests.model.importers.test_importers import pcd_bytes, room, turned

DIGEST = "0123456789abcdef" * 4
SOURCE = MapSource(
    file="hall.pcd",
    sha256=DIGEST,
    unit_m=0.001,
    position_m=(1.0, 2.0, 3.0),
    quaternion_wxyz=tuple(quat_from_axis_angle((0.0, 0.0, 1.0), np.pi / 2).tolist()),
)


def test_points_and_poses_of_the_map_in_the_scene():
    np.testing.assert_allclose(SOURCE.to_scene([1000.0, 0.0, 500.0]), [1.0, 3.0, 3.5], atol=1e-12)
    quat_MB = quat_from_axis_angle((0.3, -0.5, 0.7), 1.1)
    p_W, quat_WB = SOURCE.pose_to_scene([100.0, 200.0, 300.0], quat_MB)
    p_MP = np.array([10.0, 20.0, -30.0]) / 1000.0  # a point fixed to the body [m]
    direct = SOURCE.to_scene(np.array([100.0, 200.0, 300.0]) + 1000.0 * quat_rotate(quat_MB, p_MP))
    np.testing.assert_allclose(p_W + quat_rotate(quat_WB, p_MP), direct, atol=1e-12)


def test_a_moved_scene_keeps_its_map():
    quat, shift = quat_from_axis_angle((0.0, 0.0, 1.0), 0.4), np.array([5.0, -1.0, 0.2])
    p_M = np.random.default_rng(0).normal(size=(20, 3)) * 1000.0
    moved = SOURCE.moved(shift, quat)
    np.testing.assert_allclose(moved.to_scene(p_M), quat_rotate(quat, SOURCE.to_scene(p_M)) + shift, atol=1e-12)
    assert (moved.file, moved.sha256, moved.unit_m) == (SOURCE.file, DIGEST, 0.001)


def test_crops_keep_their_map():
    box = Obstacle("box", "side", BoxShape((0.2, 0.3, 0.8)), (4.0, 3.5, 0.4))
    scene = crop("c", [box], (4.0, 3.0), (4.0, 1.0), (4.0, 3.0, 1.5), SOURCE)
    (kept,) = scene.obstacles
    R = quat_to_mat(np.array(SOURCE.quaternion_wxyz))
    p_M = (np.array(box.position_m) - SOURCE.position_m) @ R / SOURCE.unit_m
    assert scene.source is not None
    np.testing.assert_allclose(scene.source.to_scene(p_M), kept.position_m, atol=1e-6)
    assert crop("c", [box], (4.0, 3.0), (4.0, 1.0), (4.0, 3.0, 1.5)).source is None
    assert scene.renamed("other").source == scene.source


def test_files_keep_it_and_those_without_stay_as_they_are(tmp_path):
    scene = Scene("s", source=SOURCE)
    scene.save(tmp_path / "s.json")
    assert Scene.load(tmp_path / "s.json") == scene
    assert json.loads((tmp_path / "s.json").read_text())["source"] == SOURCE.to_dict()
    assert "source" not in Scene("s").to_dict() and Scene.from_dict(Scene("s").to_dict()).source is None


@pytest.mark.parametrize(
    "change",
    [
        {"file": "../hall.pcd"},
        {"file": ""},
        {"file": 3},
        {"sha256": "ABC"},
        {"sha256": DIGEST.upper()},
        {"unit_m": 0.0},
        {"unit_m": float("nan")},
        {"unit_m": True},
        {"position_m": [0.0, 0.0]},
        {"position_m": [0.0, 0.0, float("inf")]},
        {"position_m": [0.0, 0.0, 10**400]},
        {"quaternion_wxyz": [0.0, 0.0, 0.0, 0.0]},
        {"quaternion_wxyz": "1000"},
        {"more": 1},
    ],
)
def test_impossible_sources_are_one_line(change, tmp_path):
    content = Scene("s").to_dict() | {"source": SOURCE.to_dict() | change}
    (tmp_path / "s.json").write_text(json.dumps(content).replace("Infinity", "1e999"))
    with pytest.raises(InvalidScene) as caught:
        Scene.load(tmp_path / "s.json")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400
    for missing in SOURCE.to_dict():
        with pytest.raises(InvalidScene, match="source lacks"):
            MapSource.from_dict({k: v for k, v in SOURCE.to_dict().items() if k != missing})


@pytest.mark.parametrize(
    ("turn", "more"),
    [
        ({}, {}),
        ({"scale": 0.001}, {}),
        ({"up": "-z"}, {}),
        ({"up": "y", "scale": 0.001}, {}),
        ({"up": "-x"}, {}),
        ({"turn_deg": (10.0, -25.0)}, {}),
        ({}, {"frame": "map"}),
    ],
)
def test_imports_say_how_their_map_lies(turn, more, tmp_path):
    """Points of the file, moved by the scene's source, are the points that the boxes were made of."""
    from hotice.model.importers.map_obstacles import KEPT
    from hotice.model.importers.scene_import import _turn

    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), **turn, **more)
    p_M = turned(room(np.random.default_rng(1)), (1.0, 0.5, 0.0), 0.05, -1.2)
    p_F = (p_M / options.scale) @ _turn(options, ".pcd")
    content = pcd_bytes(p_F, "binary", "<f8")
    (tmp_path / "hall.pcd").write_bytes(content)
    imported = import_scene(tmp_path / "hall.pcd", options)
    source = imported.scene.source
    assert source.file == "hall.pcd" and source.unit_m == options.scale
    assert source.sha256 == hashlib.sha256(content).hexdigest()
    p_W = source.to_scene(p_F)
    kept = imported.points_W[imported.group == KEPT]
    from scipy.spatial import KDTree

    assert KDTree(p_W).query(kept)[0].max() < 1e-9
    assert abs(p_W[:60_000, 2].mean()) < 1e-3  # the floor
    imported.scene.save(tmp_path / "s.json")
    assert Scene.load(tmp_path / "s.json").source == source


def test_a_station_with_a_table_keeps_the_map():
    from hotice.systems.setup.table import with_table

    table = Obstacle("table", "side", BoxShape((0.4, 0.4, 0.7)), (-0.6, 0.0, 0.35))
    assert with_table(Scene("s", source=SOURCE), table).source == SOURCE


def test_the_map_does_not_change_the_fields():
    from hotice.fields.cache import scene_key

    keys = {scene_key(s, 0.04, (0.0, 0.08)) for s in (Scene("s"), Scene("s", source=SOURCE))}
    assert len(keys) == 1
