"""A map as FAST-LIO would have saved it: from the scene to a cloud, and back by the import."""

import numpy as np
import pytest

from hotice.commands.program import main
from hotice.deploy.simulated import SimulatedRobotConfig
from hotice.deploy.simulated.lidar_map import LidarScan, map_in_scene, pcd_of, scan
from hotice.errors import InvalidConfig
from hotice.model import load_scene
from hotice.model.importers import ImportOptions, import_scene
from tests.deploy.simulated_fixture import Lab
from tests.deploy.test_simulated_sources import pelvis_of

RAYS = 150_000


def test_points_lie_on_scene_and_hall():
    scene = load_scene("gap")
    points = scan(scene, LidarScan(rays=4000, noise_m=0.0, ceiling_m=2.4))
    X_WM = map_in_scene(scene)
    # the lidar hangs upside down and leans by 2.9 degrees
    assert X_WM.R[2, 2] == pytest.approx(-np.cos(0.0511)) and 1.2 < X_WM.p[2] < 1.3
    p_W = X_WM.points(points)
    on_scene = np.abs(scene.signed_distance(p_W)) < 2e-3
    on_floor, on_ceiling = np.abs(p_W[:, 2]) < 2e-3, np.abs(p_W[:, 2] - 2.4) < 2e-3
    low, high = (np.array(corner[:2]) for corner in scene.bounds_m)
    on_wall = np.abs(np.minimum(p_W[:, :2] - low, high - p_W[:, :2]).min(axis=1) + 4.0) < 2e-3
    for kind in (on_scene, on_floor, on_ceiling, on_wall):
        assert kind.any()
    # the rest are the two cupboards
    rest = p_W[~(on_scene | on_floor | on_ceiling | on_wall)]
    assert len(rest) > 20 and (np.abs(rest[:, 1]) > 2.0).all() and (rest[:, 2] < 1.2 + 2e-3).all()
    np.testing.assert_array_equal(points, scan(scene, LidarScan(rays=4000, noise_m=0.0, ceiling_m=2.4)))


@pytest.mark.parametrize(
    ("name", "ceiling_m"), [("open_floor", None), ("open_floor", 2.4), ("gap", 2.4), ("beam", None)]
)
def test_the_import_finds_the_scene_and_its_place(name, ceiling_m, tmp_path):
    scene = load_scene(name)
    (tmp_path / "map.pcd").write_bytes(pcd_of(scan(scene, LidarScan(rays=RAYS, ceiling_m=ceiling_m))))
    found = import_scene(tmp_path / "map.pcd", ImportOptions(start=scene.start[:2], goal=scene.goal)).scene
    X_WM, source = map_in_scene(scene), found.source
    np.testing.assert_allclose(source.to_scene(np.zeros(3)), X_WM.p, atol=2e-3)
    np.testing.assert_allclose(source.to_scene(np.eye(3)) - source.to_scene(np.zeros(3)), X_WM.R.T, atol=2e-3)
    assert bool(found.obstacles) == bool(scene.obstacles)
    if not scene.obstacles:
        return
    # what is free stays free but for a voxel and the noise, what is solid there where a lidar sees it
    grid = np.stack(np.meshgrid(*(np.arange(a + 0.02, b, 0.05) for a, b in ((0.6, 1.4), (-0.9, 0.9), (0.1, 1.4)))), -1)
    true, imported = scene.signed_distance(grid), found.signed_distance(grid)
    assert (imported[true > 0.09] > 0.0).all()
    if name == "gap":
        assert imported[np.abs(true) < 0.01].max() < 0.04


def test_a_robot_localizes_itself_in_the_map_of_its_scene():
    lab = Lab(localized_in="scan")
    lab.live(0.21)
    sample = lab.poses.newest().sample
    X_WM = map_in_scene(lab.world.scene)
    assert np.linalg.norm(sample.p_ML) < 0.1
    found = X_WM @ pelvis_of(lab, sample)
    assert found.p == pytest.approx(lab.world.data.qpos[:3], abs=1e-3)


@pytest.mark.parametrize(
    "values", [{"rays": 10}, {"noise_m": -1.0}, {"ceiling_m": 0.5}, {"seed": 0.5}], ids=lambda v: next(iter(v))
)
def test_what_a_scan_refuses(values):
    with pytest.raises(InvalidConfig):
        LidarScan(**values)
    with pytest.raises(InvalidConfig):
        SimulatedRobotConfig(localized_in="hall")


def test_by_the_command_line(tmp_path, capsys):
    cloud, scene = tmp_path / "beam.pcd", tmp_path / "beam.json"
    assert main(["scene", "scan", "beam", "--rays", "100000", "--out", str(cloud)]) == 0
    assert "points in" in capsys.readouterr().out
    assert main(["scene", "import", str(cloud), "--start", "0", "0", "--goal", "2", "0", "--out", str(scene)]) == 0
    assert "turned over" in capsys.readouterr().out
    assert main(["scene", "scan", "beam", "--out", str(tmp_path / "beam.ply")]) == 2
