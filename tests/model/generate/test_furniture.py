import re

import numpy as np
import pytest

from hotice.model import Obstacle
from hotice.model.frames import normalize
from hotice.model.generate import furniture
from hotice.model.geometry.extents import category_by_height, extent
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, SphereShape

RETURNS = {n: getattr(f, "__annotations__", {}).get("return") for n, f in vars(furniture).items()}
MAKERS = sorted(n for n, kind in RETURNS.items() if kind == "Piece" and not n.startswith("_") and n != "group")
SETS = [n for n in MAKERS if n.endswith("_set")]


def make(name: str, seed: int) -> furniture.Piece:
    return getattr(furniture, name)(np.random.default_rng(seed))


def member(part: Obstacle) -> str:
    """The member of a set that a part belongs to: `coffee_table2` of `coffee_table2_leg_1`."""
    return re.match(r"\D+\d+", part.name).group()  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "shape", [BoxShape((0.3, 0.5, 0.7)), CylinderShape(0.2, 0.6), CapsuleShape(0.1, 0.5), SphereShape(0.3)]
)
def test_extent_is_tight(shape):
    """Just outside every face of the extent lies no point of the shape, just inside each some do."""
    rng = np.random.default_rng(1)
    obstacle = Obstacle("o", "side", shape, (0.3, -0.2, 0.9), tuple(normalize(rng.normal(size=4))))
    low, high = extent(obstacle)
    inside = (p := rng.uniform(low - 0.02, high + 0.02, (400_000, 3)))[obstacle.signed_distance(p) <= 0]
    assert (inside >= low).all() and (inside <= high).all()
    np.testing.assert_allclose([inside.min(axis=0), inside.max(axis=0)], [low, high], atol=0.05)


def test_categories_by_height():
    assert [category_by_height(*z) for z in ((0, 0.15), (0, 0.16), (1.0, 2.0), (0.99, 2.0))] == [
        "ground",
        "side",
        "overhead",
        "side",
    ]


def test_the_catalogue_is_complete():
    assert {"table", "chair", "shelf", "sofa", "floor_lamp", "pendant", "carton", "dining_set", "bed_set"} <= {*MAKERS}


@pytest.mark.parametrize("name", MAKERS)
def test_pieces_have_plausible_sizes_and_stand_on_the_floor(name):
    for seed in range(20):
        piece = make(name, seed)
        low, high = piece.extent_m
        np.testing.assert_allclose(low[:2] + high[:2], 0.0, atol=1e-9)
        assert 0.05 < (high - low)[:2].min() and (high - low)[:2].max() < 3.6
        hung = name in ("pendant", "wall_shelf")
        assert high[2] <= furniture.ROOM_HEIGHT_M + 1e-9
        assert low[2] >= 1.1 if hung else abs(low[2]) < 0.031
        if name not in SETS:
            assert {p.category for p in piece.parts} == {category_by_height(low[2], high[2])}
        assert len({p.name for p in piece.parts}) == len(piece.parts)
        assert make(name, seed) == piece


def test_known_categories():
    kind = {name: make(name, 0).parts[0].category for name in MAKERS}
    assert {n for n, c in kind.items() if c == "ground"} == {"books", "shoes", "cable_duct", "broom"}
    assert {n for n, c in kind.items() if c == "overhead"} == {"pendant", "wall_shelf"}


@pytest.mark.parametrize("name", SETS)
def test_pieces_of_a_set_do_not_overlap(name):
    for seed in range(10):
        piece, rng = make(name, seed), np.random.default_rng(seed)
        for part in piece.parts:
            points = rng.uniform(*extent(part), (300, 3))
            points = points[part.signed_distance(points) < -0.002]
            for other in piece.parts:
                if member(other) != member(part):
                    assert (other.signed_distance(points) > 0).all(), (seed, part.name, other.name)


def test_placing_turns_then_moves():
    chair = make("chair", 3)
    back = next(p for p in chair.parts if p.name == "back")
    placed = next(p for p in chair.at("c", 1.0, 2.0, 0.5 * np.pi) if p.name == "c_back")
    x, y, z = back.position_m
    np.testing.assert_allclose(placed.position_m, [1.0 - y, 2.0 + x, z], atol=1e-12)
    assert x < 0 and placed.category == "side"
