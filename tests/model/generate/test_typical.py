from types import SimpleNamespace

import numpy as np
import pytest

from hotice.errors import InvalidScene
from hotice.model import Scene
from hotice.model.generate import check_traversable, families
from hotice.model.generate.families import CHECKED, LARGEST_M, MIXTURES, draw_scene, generate
from hotice.model.generate.random_clutter import Lane
from hotice.model.generate.typical import DEPTH_M, LOADS_M, TYPICAL


def draws(name, difficulty, count=20):
    return [TYPICAL[name](difficulty, np.random.default_rng(i)) for i in range(count)]


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n == "s_bend" else n for n in CHECKED])
def test_checked_families_are_reproducible_and_traversable(name):
    made = generate(name, 2, seed=5)
    assert generate(name, 1, seed=5).scenes[0] == made.scenes[0]
    assert [s.name for s in made.scenes] == [f"{name}_s5_00", f"{name}_s5_01"]
    for scene in made.scenes:
        assert Scene.from_dict(scene.to_dict()) == scene
    hardest = made.scenes[-1]
    way = check_traversable(hardest, carried_half_extents_m=LOADS_M.get(name, LARGEST_M))
    assert way.ok and way.length_m < 2.8
    assert len({o.category for o in hardest.obstacles}) >= {"gauntlet": 3, "combination": 2}.get(name, 1)


def test_mixtures_deal_their_parts_in_turn(monkeypatch):
    monkeypatch.setattr(
        families,
        "draw_scene",
        lambda name, title, t, stream: (Scene(title), [families.Rejected(scene=title, draw=0, reason="x")]),
    )
    typical = generate("typical", len(TYPICAL) + 1)
    assert [s.name.rsplit("_", 1)[0] for s in typical.scenes] == [*TYPICAL, next(iter(TYPICAL))]
    assert len(typical.rejected) == len(typical.scenes)
    assert set(MIXTURES["all"]) == {*MIXTURES["mixed"], *CHECKED, "indoor"}


def test_rejected_draws_are_reported(monkeypatch):
    """A generator that fails three times, the third time with an invalid scene."""
    solid = TYPICAL["narrow_gap"]
    calls = []

    def make(difficulty, rng):
        calls.append(len(calls))
        blocked = families.TYPICAL["beam_across"](1.0, rng)
        return {0: blocked, 1: blocked, 2: [*blocked, *blocked]}.get(calls[-1], solid(0.0, rng))

    monkeypatch.setitem(families.CHECKED, "random", make)
    answers = iter(["stopped by 'beam'", "stopped by 'beam'", ""])
    monkeypatch.setattr(
        families, "check_traversable", lambda *a, **k: SimpleNamespace(reason=next(answers), length_m=2)
    )
    scene, rejected = draw_scene("random", "s", 0.5, (1, 2))
    assert [r.draw for r in rejected] == [0, 1, 2] and {r.scene for r in rejected} == {"s"}
    assert rejected[0].reason == "stopped by 'beam'" and "occurs twice" in rejected[2].reason
    assert {o.name for o in scene.obstacles} >= {"left_wall", "right_wall"}
    monkeypatch.setattr(families, "check_traversable", lambda *a, **k: SimpleNamespace(reason="no way"))
    with pytest.raises(InvalidScene, match="none of 200 draws can be traversed; the last was no way"):
        draw_scene("random", "s", 0.5, (1, 2))


@pytest.mark.parametrize("difficulty", [0.0, 0.5, 1.0])
def test_ground_obstacles_can_be_stepped_over(difficulty):
    """Heights as graded, at most 15 cm; no more than 20 cm of floor; a foothold between two."""
    for name, easy, hard in (("one_pipe", 0.03, 0.15), ("two_pipes", 0.03, 0.12), ("two_steps", 0.03, 0.12)):
        wish = easy + difficulty * (hard - easy)
        for obstacles in draws(name, difficulty):
            scene = Scene("s", obstacles=tuple(obstacles))
            x = np.linspace(0.4, 1.9, 376)
            column = np.stack(np.meshgrid(x, [0.0], np.linspace(0.002, 0.2, 100), indexing="ij"), axis=-1)[:, 0]
            inside = scene.signed_distance(column) < 0
            height = 0.002 * np.where(inside.any(axis=1), 100 - inside[:, ::-1].argmax(axis=1), 0)
            assert height.max() == pytest.approx(wish, abs=0.004)
            ends = np.flatnonzero(np.diff(np.concatenate([[0], inside.any(axis=1), [0]]).astype(int)))
            starts, stops = ends[::2], ends[1::2]
            assert len(starts) == (1 if name.startswith("one") else 2)
            assert ((stops - starts) * 0.004 <= DEPTH_M + 0.01).all()
            assert ((starts[1:] - stops[:-1]) * 0.004 >= 0.28).all()
    radii = [o.shape.radius_m for d in np.linspace(0, 1, 11) for found in draws("one_pipe", d) for o in found]
    assert min(radii) >= 0.03 - 1e-9 and 0.11 < max(radii) <= 0.15


def test_graded_sizes():
    for t in (0.0, 1.0):
        for left, right, *_ in draws("side_gap", t):
            inner = [o.position_m[1] - s * 0.5 * o.shape.size_m[1] for o, s in ((left, 1), (right, -1))]
            assert inner[0] - inner[1] == pytest.approx((1.0, 0.6)[int(t)])
        for (beam,) in draws("beam_across", t):
            assert beam.position_m[2] - 0.5 * beam.shape.size_m[2] == pytest.approx((1.3, 1.0)[int(t)])
        for first, second in draws("s_bend", t):
            reach = [abs(o.position_m[1]) - 0.5 * o.shape.size_m[1] for o in (first, second)]
            assert sum(reach) == pytest.approx((0.30, 0.08)[int(t)], abs=1e-9) or min(reach) >= 0
        for found in draws("table", t):
            tops = [o for o in found if o.name.endswith("_top")]
            assert len(tops) in (1, 2) and all(0.6 < o.position_m[2] < 1.0 for o in tops)
    sills = [len(f) == 3 for f in draws("side_gap", 0.5)]
    assert any(sills) and not all(sills)


@pytest.mark.parametrize("difficulty", [0.0, 0.6, 1.0])
def test_random_clutter_leaves_its_lane_free(difficulty):
    for seed in range(10):
        obstacles = CHECKED["random"](difficulty, np.random.default_rng(seed))
        lane = Lane.draw(difficulty, np.random.default_rng(seed))  # drawn first
        assert lane.centre(0.0) == 0 and lane.centre(2.0) == pytest.approx(0, abs=1e-12)
        x = np.linspace(0.0, 2.0, 41)
        for a in x.tolist():
            free = 0.9 * lane.half_width(a)
            y = lane.centre(a) + np.linspace(-free, free, 9)
            points = np.stack([np.full(9, a), y], axis=1)
            for o in obstacles:
                if o.category == "side":
                    column = np.concatenate([np.column_stack([points, np.full(9, z)]) for z in (0.2, 0.8, 1.3)])
                    assert o.signed_distance(column).min() > 0, (seed, o.name, a)
                elif o.category == "overhead":
                    below = lane.headroom(o.position_m[0]) - 0.01
                    assert o.signed_distance(np.column_stack([points, np.full(9, below)])).min() > 0
    counts = [len(CHECKED["random"](d, np.random.default_rng(0))) for d in (0.0, 0.5, 1.0)]
    assert counts[0] < counts[1] < counts[2]
