"""Groups of unseen scenes by what was trained on."""

import pytest

from hotice.commands.unseen import compared, group_of, similarities, unseen_points
from hotice.commands.unseen_views import draw_unseen, unseen_markdown
from hotice.evaluate.trials import success_interval
from hotice.learn.checkpoints.trained_on import TrainedOn
from hotice.model.generate.families import family_scenes
from hotice.model.shipped import load_scene


def test_a_scene_stands_to_the_record_as_its_family_does():
    record = TrainedOn.of_items(("bench20", "family:pipe:3"))
    groups = {
        "bench20/05_slalom": "scene_trained_on",
        "unseen50/11_slalom": "family_trained_on",
        "pipe": "family_trained_on",
        "unseen50/31_s_bend": "family_not_trained_on",
        "gap": "family_not_trained_on",
    }
    assert {name: group_of(load_scene(name), record) for name in groups} == groups
    assert group_of(load_scene("gap").renamed("my room"), record) == "family_unknown"
    assert group_of(family_scenes("pipe", 3)[1], record) == "scene_trained_on"


def test_groups_are_counted_apart(tmp_path):
    names = ("unseen50/03_one_step", "gap", "pipe")
    nearest = compared([load_scene(n) for n in names], TrainedOn.of_items(("family:step:2", "family:gap:2", "beam")))
    assert nearest["training"]["compared"] == 5
    rates = [(0.5, 8, 1.0), (1.0, 8, 0.1), (0.25, 4, 0.7)]
    scenes = [
        {
            "success_rate": rate,
            "rollouts": n,
            "mean_distance_m": d,
            "success_interval_95": list(success_interval(round(rate * n), n)),
        }
        for rate, n, d in rates
    ]
    result = unseen_points(nearest, {"scenes": scenes})
    assert [p["group"] for p in result["points"]] == [
        "family_not_trained_on",
        "family_trained_on",
        "family_not_trained_on",
    ]
    apart = result["groups"]["family_not_trained_on"]
    assert (apart["scenes"], apart["rollouts"], apart["families"]) == (2, 12, ["one_step", "pipe"])
    assert apart["success_rate"] == pytest.approx(5 / 12) and apart["mean_distance_m"] == pytest.approx(10.8 / 12)
    assert apart["success_interval_95"] == pytest.approx(success_interval(5, 12), abs=1e-4)
    assert result["groups"]["family_trained_on"]["success_rate"] == 1.0
    text = unseen_markdown(result)
    assert "5 training scenes" in text and "| family not trained on | 2 | 12 | 41.7 |" in text
    assert draw_unseen(result, tmp_path / "unseen.png").stat().st_size > 10_000


def test_similarity_in_parts_is_that_in_one(monkeypatch):
    unseen, training = [load_scene(n) for n in ("pipe", "gap")], family_scenes("beam", 3)
    whole = similarities(unseen, training)
    monkeypatch.setattr("hotice.commands.unseen.AT_A_TIME", 2)
    for row, alike in zip(similarities(unseen, training), whole, strict=True):
        assert row == alike | {"similarity": pytest.approx(alike["similarity"], abs=1e-5)}
