"""Orders from a page: what is exactly one is taken, everything else is refused in words."""

import contextlib
import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hotice.errors import HoticeError
from hotice.model import Box, load_scene
from hotice.model.objects import Cylinder
from hotice.view import orders
from hotice.view.orders import Known, read_order

KNOWN = Known(scene=load_scene("gap"), policies=("student", "carry"))
NAME = KNOWN.scene.obstacles[0].name


def read(**said):
    return read_order(json.dumps(said).encode(), KNOWN)


@pytest.mark.parametrize(
    ("said", "order"),
    [
        ({"order": "move", "obstacle": NAME, "to": [1, 0.5, 0.7]}, orders.Move(obstacle=NAME, to_W=(1.0, 0.5, 0.7))),
        ({"order": "push", "velocity": [0.5, -1.5]}, orders.Push(velocity_W=(0.5, -1.5))),
        (
            {"order": "take", "object": {"shape": "box", "size_m": [0.3, 0.2, 0.4], "mass_kg": 2}},
            orders.Take(carried=Box((0.3, 0.2, 0.4), 2.0)),
        ),
        (
            {"order": "take", "object": {"shape": "cylinder", "radius_m": 0.1, "length_m": 0.3, "mass_kg": 1}},
            orders.Take(carried=Cylinder(0.1, 0.3, 1.0)),
        ),
        ({"order": "policy", "policy": "carry"}, orders.UsePolicy(policy="carry")),
        ({"order": "noise", "on": False}, orders.Noise(on=False)),
        ({"order": "pause", "on": True}, orders.Pause(on=True)),
        ({"order": "restart"}, orders.Restart()),
        ({"order": "restore"}, orders.Restore()),
        ({"order": "slice", "field": "ogf", "height": 1.2}, orders.Slice(field="ogf", height_m=1.2)),
    ],
)
def test_orders(said, order):
    assert read(**said) == order


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({}, "order is None: known are move, push"),
        ({"order": "shutdown"}, "known are move"),
        ({"order": ["move"]}, "known are move"),
        ({"order": "restart", "twice": 1}, "unknown key 'twice'"),
        ({"order": "move", "obstacle": NAME}, "lacks 'to'"),
        ({"order": "move", "obstacle": "nobody", "to": [0, 0, 0]}, "obstacle is 'nobody': known are"),
        ({"order": "move", "obstacle": NAME, "to": [0, 0]}, "3 numbers"),
        ({"order": "move", "obstacle": NAME, "to": [9, 0, 0]}, "to x is 9.0: a finite number from -1 to 3 m"),
        ({"order": "move", "obstacle": NAME, "to": [0, float("nan"), 0]}, "finite"),
        ({"order": "move", "obstacle": NAME, "to": [0, 0, 10**400]}, "finite"),
        ({"order": "push", "velocity": [2, 0]}, "within ±1.5 m/s"),
        ({"order": "push", "velocity": [float("inf"), 0]}, "within"),
        ({"order": "push", "velocity": "01"}, "2 numbers"),
        ({"order": "take", "object": {"shape": "box", "size_m": [0.3, 0.2, 4], "mass_kg": 2}}, "from 0.05 to 0.6 m"),
        ({"order": "take", "object": {"shape": "sphere", "radius_m": 0.1, "mass_kg": 99}}, "from 0.1 to 6 kg"),
        ({"order": "take", "object": {"shape": "mesh", "file": "/etc/passwd"}}, "known are box, cylinder, sphere"),
        ({"order": "policy", "policy": "../../x.onnx"}, "known are student, carry"),
        ({"order": "noise", "on": 1}, "true or false"),
        ({"order": "slice", "field": "both", "height": 1}, "known are none, sgf, ogf"),
        ({"order": "slice", "field": "sgf", "height": 7}, "from 0 to 1.5 m"),
    ],
)
def test_what_is_no_order_is_refused(said, why):
    with pytest.raises(HoticeError, match=why.replace("[", r"\[")):
        read(**said)


@pytest.mark.parametrize(
    "content", [b"", b"[]", b"null", b"\xff", b"{", b'{"order":"restart","order":"pause"}', b"[" * 4000]
)
def test_what_is_no_json_object_is_refused(content):
    with pytest.raises(HoticeError):
        read_order(content, KNOWN)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from([NAME, "sgf", "student", "box"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
KEYS = st.sampled_from(["obstacle", "to", "velocity", "object", "policy", "on", "field", "height", "x"])
KINDS = st.sampled_from(["move", "push", "take", "policy", "noise", "pause", "restart", "restore", "slice"])


@given(KINDS, st.dictionaries(KEYS, VALUES, max_size=3))
@settings(max_examples=300, deadline=None)
def test_whatever_comes_is_an_order_or_refused_in_words(kind, more):
    with contextlib.suppress(HoticeError):
        assert isinstance(read_order(json.dumps({"order": kind, **more}).encode(), KNOWN), orders.Order)
