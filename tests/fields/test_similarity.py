import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.fields.similarity import scene_similarity, similarity_matrix, similarity_to_set
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
    assert value == pytest.approx(max(scene_similarity(fields["beam"], t) for t in training), abs=1e-5)


def test_grid_nodes_are_the_positions(fields):
    a, b = fields["gap"], fields["beam"]
    p = a.grid.points()
    want = []
    for name in ("sgf", "ogf"):
        f, g = getattr(a, name).sample(p), getattr(b, name).sample(p)
        want.append(((f * g).sum(1) / np.linalg.norm(f, axis=1) / np.linalg.norm(g, axis=1)).mean())
    assert scene_similarity(a, b) == pytest.approx(np.mean(want), abs=1e-6)


def test_the_matrix_holds_every_pair(fields):
    """Also across scenes of other bounds and resolutions, each pair over the box that it shares."""
    small = build_hod_pf(Scene("small", ((-0.3, -0.6, 0.1), (2.3, 0.8, 1.2))), 0.08)
    fine = build_hod_pf(load_scene("gap"), 0.06)
    rows, columns = [fields["gap"], small, fields["pipe"], fine], [fields["beam"], fine, small]
    found = similarity_matrix(rows, columns)
    want = [[scene_similarity(a, b) for b in columns] for a in rows]
    assert found.shape == (4, 3) and found.dtype == np.float32
    np.testing.assert_allclose(found, want, atol=2e-6)
    coarse = similarity_matrix(rows, columns, 0.2)
    assert coarse[0, 0] == pytest.approx(scene_similarity(rows[0], columns[0], 0.2), abs=2e-6)


def test_a_bank_is_as_similar_as_its_scenes(fields):
    names = ["gap", "pipe", "open_floor"]
    bank = FieldBank.build([load_scene(n) for n in names], 0.08)
    shares = []
    found = similarity_matrix(bank, [fields[n] for n in names], progress=shares.append)
    np.testing.assert_allclose(found, similarity_matrix([fields[n] for n in names], bank), atol=2e-6)
    np.testing.assert_allclose(np.diag(found), 1.0, atol=1e-5)
    assert (np.diff(shares) > 0).all() and shares[-1] == pytest.approx(1.0)
    assert similarity_to_set(fields["pipe"], bank)[1] == 1


def test_errors(fields):
    far = build_hod_pf(Scene("far", ((9, 9, 0), (11, 11, 1.5)), (10, 10, 0), (10.5, 10)), 0.2)
    with pytest.raises(InvalidConfig, match="share no grid node"):
        scene_similarity(fields["gap"], far)
    with pytest.raises(InvalidConfig, match="resolution_m is 0"):
        scene_similarity(fields["gap"], fields["gap"], 0)
    with pytest.raises(InvalidConfig, match="no scenes"):
        similarity_to_set(fields["gap"], [])
    with pytest.raises(InvalidConfig, match="share no grid node"):
        similarity_matrix([fields["gap"], fields["pipe"]], [far])
