import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.fields import build_hod_pf
from hotice.fields.similarity import scene_similarity, similarity_to_set
from hotice.model import Scene, load_scene


@pytest.fixture(scope="module")
def fields():
    return {n: build_hod_pf(load_scene(n), 0.08) for n in ("open_floor", "gap", "pipe", "beam", "pillars")}


def test_a_scene_is_like_itself_and_the_measure_symmetric(fields):
    assert scene_similarity(fields["gap"], fields["gap"]) == pytest.approx(1.0, abs=1e-6)
    ab, ba = scene_similarity(fields["gap"], fields["pipe"]), scene_similarity(fields["pipe"], fields["gap"])
    assert ab == pytest.approx(ba) and 0.3 < ab < 0.999


def test_opposite_goals_are_opposite():
    a, b = (build_hod_pf(Scene("e", ((-9, -0.2, 0.6), (9, 0.2, 0.9)), (0, 0, 0), (x, 0)), 0.1) for x in (-9, 9))
    assert scene_similarity(a, b) < -0.9


def test_best_of_a_set(fields):
    training = [fields["gap"], fields["pipe"], fields["open_floor"]]
    value, index = similarity_to_set(fields["pipe"], training)
    assert index == 1 and value == pytest.approx(1.0, abs=1e-6)
    value, index = similarity_to_set(fields["beam"], training)
    assert value == max(scene_similarity(fields["beam"], t) for t in training)


def test_grid_nodes_are_the_positions(fields):
    a, b = fields["gap"], fields["beam"]
    p = a.grid.points()
    want = []
    for name in ("sgf", "ogf"):
        f, g = getattr(a, name).sample(p), getattr(b, name).sample(p)
        want.append(((f * g).sum(1) / np.linalg.norm(f, axis=1) / np.linalg.norm(g, axis=1)).mean())
    assert scene_similarity(a, b) == pytest.approx(np.mean(want), abs=1e-6)


def test_errors(fields):
    far = build_hod_pf(Scene("far", ((9, 9, 0), (11, 11, 1.5)), (10, 10, 0), (10.5, 10)), 0.2)
    with pytest.raises(InvalidConfig, match="share no grid node"):
        scene_similarity(fields["gap"], far)
    with pytest.raises(InvalidConfig, match="resolution_m is 0"):
        scene_similarity(fields["gap"], fields["gap"], 0)
    with pytest.raises(InvalidConfig, match="no training scenes"):
        similarity_to_set(fields["gap"], [])
