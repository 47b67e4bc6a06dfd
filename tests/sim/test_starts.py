"""Places where episodes may start, against what they promise."""

import numpy as np
import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.sim.starts import (
    BODY_RADIUS_M,
    FARTHEST_M,
    HEIGHTS_M,
    NEAREST_M,
    OBJECT_REACH_M,
    STEP_M,
    all_places,
    standing_places,
)

WALL = Obstacle("wall", "side", BoxShape((0.1, 1.2, 1.5)), (1.0, -0.4, 0.75))
GOAL = np.array([2.0, 0.0])


def straight(p):
    """A field straight at the goal, and the straight way to it."""
    return GOAL - p[:, :2]


def places(scene, geodesic=None):
    return standing_places(
        scene,
        lambda p: np.column_stack([straight(p), np.zeros(len(p))]),
        geodesic or (lambda p: np.linalg.norm(straight(p), axis=1)),
    )


def test_an_open_floor_is_a_lattice_without_its_rim_and_goal():
    found = places(Scene("open"))
    xy = found[:, :2]
    togo = np.linalg.norm(GOAL - xy, axis=1)
    assert xy.min(axis=0) == pytest.approx([-0.2, -0.7]) and xy.max(axis=0) == pytest.approx([2.2, 0.7])
    assert togo.min() > NEAREST_M and np.allclose(xy / STEP_M, np.round(xy / STEP_M))
    every = np.stack(np.meshgrid(np.arange(-2, 23), np.arange(-7, 8), indexing="ij"), -1).reshape(-1, 2) * STEP_M
    farther = [(np.linalg.norm(GOAL - every, axis=1) > NEAREST_M + eps).sum() for eps in (1e-6, -1e-6)]
    assert farther[0] <= len(found) <= farther[1] == farther[0] + 3  # three places are exactly so near
    np.testing.assert_allclose(found[:, 2], np.arctan2(*(GOAL - xy).T[::-1]))


def test_body_and_object_have_room():
    scene = Scene("wall", obstacles=(WALL,))
    found = places(scene)
    assert 0 < len(found) < len(places(Scene("open")))
    for x, y, heading in found:
        gap = [float(scene.signed_distance(np.array([x, y, z]))) for z in HEIGHTS_M]
        assert min(gap) > 0.6 * BODY_RADIUS_M and min(gap[2:]) > BODY_RADIUS_M
        ahead = np.array([x + 0.3 * np.cos(heading), y + 0.3 * np.sin(heading), 0.85])
        assert float(scene.signed_distance(ahead)) > OBJECT_REACH_M - 0.3


def test_where_no_way_leads_nobody_starts():
    def cut(p):
        return np.where(p[:, 0] < 1.0, np.inf, np.linalg.norm(straight(p), axis=1))

    assert (places(Scene("open"), cut)[:, 0] >= 1.0).all()
    assert len(places(Scene("open"), lambda p: np.full(len(p), FARTHEST_M))) == 0


def test_a_scene_without_room_keeps_its_own_start():
    pillars = tuple(
        Obstacle(f"p{i}{j}", "side", BoxShape((0.05, 0.05, 1.5)), (x, y, 0.75))
        for i, x in enumerate(np.arange(-0.3, 2.4, 0.35).tolist())
        for j, y in enumerate(np.arange(-0.875, 0.9, 0.35).tolist())
    )
    tight = Scene(
        "tight", start=(0.1, 0.0, 0.5), obstacles=tuple(p for p in pillars if abs(p.position_m[0] - 2.0) > 0.1)
    )
    full, own = all_places(FieldBank.build([Scene("open"), tight]))
    assert len(full) > 100 and own.tolist() == [[0.1, 0.0, 0.5]]


def test_headings_follow_the_field_round_the_wall():
    bank = FieldBank.build([Scene("wall", obstacles=(WALL,))])
    (found,) = all_places(bank)
    behind = found[(found[:, 0] < 0.6) & (found[:, 1] < -0.2)]
    assert len(behind) and (behind[:, 2] > 0.2).all()  # up, to the free end, though the goal lies straight ahead
    ids = torch.zeros(len(found), dtype=torch.int64)
    at = torch.tensor(np.column_stack([found[:, :2], np.full(len(found), 0.75)]), dtype=torch.float32)[:, None]
    force = bank.sample("sgf", ids, at).force_W[:, 0].numpy()
    np.testing.assert_allclose(found[:, 2], np.arctan2(force[:, 1], force[:, 0]), atol=1e-5)
