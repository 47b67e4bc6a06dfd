"""The local obstacle scan: where it looks, what it reads, how it reflects."""

import numpy as np
import pytest
import torch

from hotice.model.geometry.shapes import BoxShape
from hotice.model.objects import Box
from hotice.model.scene import Obstacle, Scene
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.observations import ObservationTable, policy_rows
from hotice.sim.snapshot import FEET
from hotice.task import scan

BLOCK = Obstacle("block", "ground", BoxShape((0.1, 1.6, 0.16)), (0.6, 0.0, 0.08))
SCENE = Scene("block", ((-1.0, -1.0, 0.0), (2.5, 1.0, 1.5)), (0.0, 0.0, 0.0), (2.0, 0.0), (BLOCK,))


@pytest.fixture(scope="module")
def env():
    made = TransportEnv(6, [SCENE], Box((0.3, 0.3, 0.25), 1.0), config=TaskConfig(scan=True), seed=2, threads=1)
    made.reset()
    return made


def test_points_go_with_feet_and_pelvis_and_turn_with_the_heading(env):
    s = env.snapshot()
    points = scan.scan_points(s.p_WK[:, FEET], s.p_WP, s.yaw)
    assert points.shape == (6, scan.NUM_SCAN, 3)
    np.testing.assert_allclose(points[:, :, 2], np.tile(scan.OFFSETS_M[:, 1], (6, 1)), atol=1e-7)
    origins = torch.stack([s.p_WK[:, FEET[0]], s.p_WK[:, FEET[1]], s.p_WP], dim=1)[:, scan.ORIGIN]
    ahead = points[:, :, :2] - origins[:, :, :2]
    along = ahead[..., 0] * torch.cos(s.yaw)[:, None] + ahead[..., 1] * torch.sin(s.yaw)[:, None]
    np.testing.assert_allclose(along, np.tile(scan.OFFSETS_M[:, 0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(ahead.norm(dim=2), np.abs(np.tile(scan.OFFSETS_M[:, 0], (6, 1))), atol=1e-6)


def test_one_robot_in_numpy_looks_where_its_row_of_the_batch_does(env):
    s = env.snapshot()
    seen = [t.double() for t in (s.p_WK[:, FEET], s.p_WP, s.yaw + torch.linspace(-3.0, 3.0, 6))]
    points = scan.scan_points(*seen)
    for i in range(6):
        alone = scan.scan_points(*(t[i].numpy() for t in seen))
        assert isinstance(alone, np.ndarray) and alone.shape == (scan.NUM_SCAN, 3)
        np.testing.assert_allclose(alone, points[i], atol=1e-12)


def test_it_reads_the_distance_to_the_block(env):
    s = env.snapshot()
    points = scan.scan_points(s.p_WK[:, FEET], s.p_WP, s.yaw).numpy()
    gap = np.abs(points - BLOCK.position_m) - np.array([0.05, 0.8, 0.08])
    wanted = np.linalg.norm(np.maximum(gap, 0.0), axis=2) + np.minimum(gap.max(axis=2), 0.0)
    near = np.abs(wanted) < 0.25
    assert near.sum() > 20
    np.testing.assert_allclose(s.scan.numpy()[near], wanted[near], atol=0.02)  # half a voxel at the edges


def test_nearness_is_zero_far_away_and_grows_to_the_surface():
    np.testing.assert_allclose(
        scan.nearness(np.array([9.0, 0.3, 0.2, 0.0, -0.2])), [0.0, 0.0, 1.0, 3.0, 3.5], atol=1e-12
    )
    assert torch.equal(scan.nearness(torch.tensor([0.3, 0.1])).round(decimals=5), torch.tensor([0.0, 2.0]))


def test_mirrored_scan_swaps_the_feet(env):
    table = ObservationTable(policy_rows(True))
    s = env.snapshot()
    observed = table(s)[:, -scan.NUM_SCAN :]
    mirrored = table.mirror(table(s))[:, -scan.NUM_SCAN :]
    n = len(scan.FOOT_POINTS)
    assert torch.equal(mirrored[:, :n], observed[:, n : 2 * n]) and torch.equal(mirrored[:, n : 2 * n], observed[:, :n])
    assert torch.equal(mirrored[:, 2 * n :], observed[:, 2 * n :])


def test_without_the_scan_the_observation_is_the_papers():
    made = TransportEnv(2, [SCENE], Box((0.3, 0.3, 0.25), 1.0), seed=2, threads=1)
    made.reset()
    assert "scan" not in dict(made.policy_table.layout()) and made.snapshot().scan.shape == (2, 0)
