import math

import numpy as np
import pytest

from hotice.errors import InvalidObject
from hotice.model.objects import Box, Cylinder, Sphere, object_from_dict

OBJECTS = [Box((0.3, 0.2, 0.4), 1.5), Cylinder(0.15, 0.4, 2.0), Sphere(0.2, 1.0)]


def _inside(item, p):
    if isinstance(item, Box):
        return (np.abs(p) <= item.half_extents_m).all(axis=1)
    if isinstance(item, Cylinder):
        return (np.hypot(p[:, 0], p[:, 1]) <= item.radius_m) & (np.abs(p[:, 2]) <= item.length_m / 2)
    return np.linalg.norm(p, axis=1) <= item.radius_m


@pytest.mark.parametrize("item", OBJECTS, ids=lambda o: o.shape)
def test_volume_and_inertia_against_sampled_density(item):
    rng = np.random.default_rng(0)
    p = rng.uniform(-1, 1, (400_000, 3)) * item.half_extents_m
    inside = p[_inside(item, p)]
    box = np.prod(2 * item.half_extents_m)
    assert item.volume_m3 == pytest.approx(box * len(inside) / len(p), rel=0.01)
    second = (inside**2).mean(axis=0)
    np.testing.assert_allclose(item.inertia_diag_kgm2, item.mass_kg * (second.sum() - second), rtol=0.01)


@pytest.mark.parametrize("item", OBJECTS, ids=lambda o: o.shape)
def test_eight_distinct_keypoints_on_the_surface(item):
    k = item.keypoints()
    assert k.shape == (8, 3) and len(np.unique(k.round(9), axis=0)) == 8
    np.testing.assert_allclose(k.mean(axis=0), 0, atol=1e-12)
    assert _inside(item, k * (1 - 1e-9)).all() and not _inside(item, k * (1 + 1e-6)).any()


def test_keypoint_frames():
    assert Sphere(0.1, 1.0).keypoints_world_aligned
    assert not Box((1, 1, 1), 1.0).keypoints_world_aligned
    np.testing.assert_allclose(Sphere(math.sqrt(3), 1.0).keypoints()[-1], [1, 1, 1])
    rim = Cylinder(0.1, 0.4, 1.0).keypoints()
    assert (rim[::2, 2] == -0.2).all() and (rim[1::2, 2] == 0.2).all()
    np.testing.assert_allclose(np.linalg.norm(rim[:, :2], axis=1), 0.1)
    angles = np.sort(np.arctan2(rim[::2, 1], rim[::2, 0]))
    np.testing.assert_allclose(np.diff(angles), np.pi / 2)  # evenly spaced on the rim


def test_mujoco_sizes_are_half_extents():
    import mujoco

    for item in OBJECTS:
        kind, size = item.mujoco_geom()
        text = " ".join(map(str, size))
        xml = (
            f'<mujoco><worldbody><body><freejoint/><geom type="{kind}" size="{text}" mass="{item.mass_kg}"/>'
            "</body></worldbody></mujoco>"
        )
        model = mujoco.MjModel.from_xml_string(xml)
        np.testing.assert_allclose(np.sort(model.body_inertia[1]), np.sort(item.inertia_diag_kgm2), rtol=1e-9)


@pytest.mark.parametrize("item", OBJECTS, ids=lambda o: o.shape)
def test_dict_round_trip(item):
    assert object_from_dict(item.to_dict()) == item
    assert hash(item) == hash(object_from_dict(item.to_dict()))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((0.3, 0.2), 1.0), "a list of 3 numbers"),
        (lambda: Box(0.3, 1.0), "a list of 3 numbers"),
        (lambda: Box((0.3, -0.2, 0.1), 1.0), r"size_m\[1\] is -0.2"),
        (lambda: Box((0.3, 0.2, 0.1), 0.0), "mass_kg is 0.0"),
        (lambda: Box((0.3, 0.2, 0.1), True), "mass_kg is True"),
        (lambda: Cylinder(float("nan"), 0.2, 1.0), "radius_m is nan"),
        (lambda: Cylinder(0.1, 10**400, 1.0), "length_m is an integer of 1329 bits: a finite number above 0"),
        (lambda: Sphere("0.1", 1.0), "radius_m is '0.1'"),
        (lambda: object_from_dict({"shape": "cone", "mass_kg": 1}), "known are box, cylinder, sphere"),
        (
            lambda: object_from_dict({"shape": "sphere", "mass_kg": 1}),
            "object lacks 'radius_m'",
        ),
        (lambda: object_from_dict([]), "mapping"),
    ],
)
def test_impossible_objects(make, message):
    with pytest.raises(InvalidObject, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
