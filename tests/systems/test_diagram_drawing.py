"""Drawings of diagrams: wires join what they say, pass behind no box and lie on no other wire."""

from itertools import combinations, pairwise

import pytest

from hotice.systems.record.routing import HEIGHT, WIDTH, route

STATION = {
    "plant": (0, 0),
    "now": (0, 1),
    "adaptor": (1, 0),
    "sensor": (2, 0),
    "pickup": (2, 1),
    "walk": (2, 2),
    "policy": (3, 0),
    "selector": (4, 0),
    "safety": (5, 0),
}
WIRES = [
    ("plant", "adaptor"),
    ("adaptor", "sensor"),
    ("sensor", "policy"),
    ("policy", "selector"),
    ("selector", "safety"),
    ("safety", "plant"),
    ("safety", "policy"),
    ("safety", "pickup"),
    ("safety", "walk"),
    ("selector", "walk"),
    ("selector", "pickup"),
    ("walk", "selector"),
    ("pickup", "selector"),
    ("adaptor", "pickup"),
    ("adaptor", "walk"),
    ("plant", "walk"),
    ("plant", "pickup"),
    ("plant", "selector"),
    ("adaptor", "safety"),
    ("sensor", "safety"),
    ("now", "sensor"),
    ("now", "safety"),
    ("walk", "now"),
]


@pytest.fixture(scope="module")
def drawing():
    return route(STATION, {ends: f"from {ends[0]} to {ends[1]}" for ends in WIRES})


def test_wires_join_what_they_say_along_the_axes(drawing):
    assert [(w.source, w.target) for w in drawing.wires] == WIRES
    for wire in drawing.wires:
        for name, (x, y) in ((wire.source, wire.points[0]), (wire.target, wire.points[-1])):
            cx, cy = drawing.boxes[name]
            on_side = abs(x - cx) == pytest.approx(0.5 * WIDTH) and y == pytest.approx(cy)
            on_end = abs(y - cy) == pytest.approx(0.5 * HEIGHT) and abs(x - cx) < 0.5 * WIDTH
            assert on_side or on_end, (wire.source, wire.target)
        assert all(a[0] == b[0] or a[1] == b[1] for a, b in pairwise(wire.points))


def test_no_wire_is_behind_a_box(drawing):
    for wire in drawing.wires:
        for (ax, ay), (bx, by) in pairwise(wire.points):
            for name, (x, y) in drawing.boxes.items():
                aside = max(ax, bx) <= x - 0.499 * WIDTH or min(ax, bx) >= x + 0.499 * WIDTH
                beyond = max(ay, by) <= y - 0.499 * HEIGHT or min(ay, by) >= y + 0.499 * HEIGHT
                assert aside or beyond, f"{wire.source} to {wire.target} passes {name}"


def test_no_wire_lies_on_another(drawing):
    parts = [(w, a, b) for w in drawing.wires for a, b in pairwise(w.points)]
    for (one, a, b), (other, c, d) in combinations(parts, 2):
        for i, j in ((0, 1), (1, 0)):
            if one is not other and a[i] == b[i] and c[i] == d[i] and abs(a[i] - c[i]) < 0.03:
                apart = max(a[j], b[j]) <= min(c[j], d[j]) or max(c[j], d[j]) <= min(a[j], b[j])
                assert apart, f"{one.source} to {one.target} lies on {other.source} to {other.target}"


def test_labels_are_on_their_wires_and_boxes_apart(drawing):
    for wire in drawing.wires:
        x, y = wire.at
        assert any(
            min(a[0], b[0]) <= x <= max(a[0], b[0]) and a[1] == pytest.approx(y) == b[1]
            for a, b in pairwise(wire.points)
        )
    for (x, y), (u, v) in combinations(drawing.boxes.values(), 2):
        assert abs(x - u) > WIDTH or abs(y - v) > HEIGHT
