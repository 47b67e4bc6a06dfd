"""What a lidar sees of a person who crosses, `hotice.model.moving.occupancy`."""

from functools import cache

import numpy as np
import pytest

from hotice.errors import InvalidConfig, InvalidScene
from hotice.fields import build_hod_pf
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.moving import Occupancy, OccupancyConfig, walking_person
from hotice.model.scene import MomentaryScene

BOUNDS = ((-0.5, -1.5, 0.0), (2.5, 1.5, 1.5))
EYE = np.array([0.0, 0.0, 1.25])
PILLAR = Obstacle("pillar", "side", BoxShape((0.2, 0.2, 1.4)), (1.7, 0.9, 0.7))
STILL = Scene("still", BOUNDS, obstacles=(PILLAR,))
ANN = walking_person("ann", [(1.1, -1.2), (1.1, 1.2)], speed_m_s=0.8)
CROSSED = Scene("crossed", BOUNDS, obstacles=(PILLAR, *ANN))
VOXEL = OccupancyConfig().voxel_m
AHEAD = np.concatenate(
    [
        np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.full_like(turn, np.sin(up))], axis=-1)
        for up in np.radians(np.arange(-70, 16, 2.0))
        for turn in [np.radians(np.arange(-70, 71, 2.0))]
    ]
)
"""Directions (n, 3) of a lidar that looks ahead and down."""


def moment(name, obstacles):
    return MomentaryScene(name, BOUNDS, obstacles=tuple(obstacles))


def scanned(scene, noise_m=0.008, seed=0):
    """(points, unhit) of the rays in a scene over its floor, by marching spheres."""
    along = np.full(len(AHEAD), 0.3)
    for _ in range(120):
        p = EYE + along[:, None] * AHEAD
        along = np.minimum(along + np.minimum(scene.signed_distance(p), np.abs(p[:, 2])), 4.0)
    p, hit = EYE + along[:, None] * AHEAD, along < 4.0
    return p[hit] + np.random.default_rng(seed).normal(0.0, noise_m, p[hit].shape), p[~hit]


@cache
def crossed(k):
    """The scan after k tenths of a second."""
    return scanned(CROSSED.at(0.1 * k), seed=k)


def looked(first, last, **options):
    """After the scans first .. last, ten a second."""
    seen = Occupancy(STILL, OccupancyConfig(**options))
    for k in range(first, last + 1):
        points, unhit = crossed(k)
        seen.look(EYE, points, 0.1 * k, unhit)
    return seen


@pytest.mark.parametrize("k", [4, 10, 16, 22])
def test_a_person_is_seen_where_she_is_and_nowhere_she_was(k):
    t, boxes = 0.1 * k, looked(0, k).obstacles()
    person = moment("person", [o for o in CROSSED.at(t).obstacles if o.name != "pillar"])
    # nothing is far from her: a voxel, the noise, and what she walked since she hid the place
    assert boxes and person.signed_distance([o.position_m for o in boxes]).max() < 2 * VOXEL
    # what the sensor sees of her surface is in the boxes
    points, _ = scanned(CROSSED.at(t), noise_m=0.0)
    new = (points[:, 2] > 0.15) & (STILL.signed_distance(points) > 0.1)
    hers = points[new & (np.abs(person.signed_distance(points)) < 0.01)]
    assert len(hers) > 30 and (moment("boxes", boxes).signed_distance(hers) < VOXEL).mean() > 0.95


def test_without_rays_that_pass_what_was_seen_stays_for_a_while_only():
    seen = looked(8, 8)
    there = seen.occupied()
    assert there.any() and seen.obstacles(1.79) and not seen.obstacles(1.81)
    # somebody's back hides the place: no ray passes it, and none hits it
    seen.look(EYE, EYE + 0.4 * AHEAD, 1.0)
    assert seen.occupied(1.79)[there].all() and not seen.occupied(1.81)[there].any()


def test_known_obstacles_floor_and_noise_are_nothing_new():
    seen = Occupancy(STILL)
    for k in range(3):
        points, unhit = scanned(STILL, seed=k)
        seen.look(EYE, points, 0.1 * k, unhit)
    assert not seen.occupied().any() and seen.obstacles() == ()
    seen.look(EYE, [[1.0, 0.0, 0.8], [np.nan, 0.0, 0.0], [9.0, 9.0, 9.0]], 1.0)
    assert not seen.occupied().any()
    assert looked(8, 8, min_voxels=1).occupied().sum() >= looked(8, 8).occupied().sum() > 20


def test_a_ray_passes_all_voxels_on_its_way_but_the_last():
    """Against sampling the way finely."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        seen = Occupancy(Scene("empty", BOUNDS))
        eye, end = rng.uniform((-1.0, -2.0, -0.5), (3.0, 2.0, 2.0), (2, 3))
        seen.look(eye, [end], 1.0)
        index = np.floor((eye + np.linspace(0.0, 1.0, 20_001)[:, None] * (end - eye) - seen._low) / VOXEL).astype(int)
        last, shape = index[-1], np.array(seen._shape)
        inside = ((index >= 0) & (index < shape)).all(axis=1) & (index != last).any(axis=1)
        expected, found = np.zeros(seen._shape, bool), seen._passed_s == 1.0
        expected[tuple(index[inside].T)] = True
        if ((last >= 0) & (last < shape)).all():
            assert seen._hit_s[tuple(last)] == 1.0
            found[tuple(last)] = False
        # a corner may be cut by less than the sampling sees
        assert not (expected & ~found).any() and (found & ~expected).sum() <= 2


def test_fields_know_her_and_forget_her():
    pf = {}
    for k in (8, 24):
        pf[k] = build_hod_pf(moment("now", (PILLAR, *looked(0, k).obstacles())))
    there = np.array([1.1, -1.2 + 0.8 * 0.8, 1.0])
    assert pf[8].sgf.signed_distance(there) < 0.1 < 0.3 < pf[24].sgf.signed_distance(there)


def test_bad_input_is_refused_and_nothing_changes():
    seen = looked(8, 8)
    before = seen.obstacles()
    for arguments in (
        ([0.0, np.nan, 1.0], [[1.0, 0.0, 0.5]], 1.0),
        ([0.0, 0.0], [[1.0, 0.0, 0.5]], 1.0),
        (EYE, [[1.0, 0.0]], 1.0),
        (EYE, [1.0, 0.0, 0.5], 1.0),
        (EYE, [[1.0, 0.0, 0.5]], 0.7),
        (EYE, [[1.0, 0.0, 0.5]], np.nan),
    ):
        with pytest.raises(ValueError, match="needed"):
            seen.look(*arguments)
    assert seen.obstacles() == before
    with pytest.raises(InvalidScene, match="move"):
        Occupancy(CROSSED)
    with pytest.raises(InvalidConfig, match="voxel_m"):
        OccupancyConfig(voxel_m=0.0)
