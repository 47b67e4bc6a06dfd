import json

import numpy as np
import pytest

from benchmarks.spread import main
from hotice.errors import InputError, InvalidConfig
from hotice.evaluate.spread import spread_ratio, success_table
from hotice.evaluate.trials import Trials, TrialStore, read_trials, success_interval


def test_ratio_by_hand():
    """Two scenes of rate 1/2 that always agree: means 0 and 1, variance 1/3 (of 4, ddof 1), independent: 2 * (1/3) /
    4."""
    same = [[True, False, True, False], [True, False, True, False]]
    assert spread_ratio(same) == pytest.approx(np.sqrt((1 / 3) / (1 / 6)))
    opposite = [[True, False, True, False], [False, True, False, True]]
    assert spread_ratio(opposite) == 0.0


def test_ratio_of_independent_trials():
    rng = np.random.default_rng(0)
    won = rng.random((20, 5000)) < np.linspace(0.3, 0.99, 20)[:, None]
    assert spread_ratio(won) == pytest.approx(1.0, abs=0.03)
    shared = rng.random(5000) < np.linspace(0.3, 0.99, 20)[:, None]
    assert spread_ratio(shared) > 3


@pytest.mark.parametrize("success", [[], [[True]], [[True, True], [False, False]]])
def test_nothing_to_compare(success):
    with pytest.raises(InvalidConfig):
        spread_ratio(success)


def trials(*won, **more):
    outcome = tuple("success" if w else "fall" for w in won)
    return Trials(outcome=outcome, distance_m=(1.0,) * len(won), time_s=(1.0,) * len(won), **more)


def test_trials_that_were_kept_are_read_again(tmp_path, capsys):
    folders = []
    for seed in range(2):
        store = TrialStore(tmp_path / f"{seed}.trials", {"seed": seed}, ["a", "b"])
        store.add(0, 1, trials(False))
        store.add(0, 0, trials(True, seed == 1))
        store.add(1, 0, trials(True, False, True))
        folders.append(tmp_path / f"{seed}.trials")
    found = [read_trials(f) for f in folders]
    won = success_table(found)
    assert won.tolist() == [[True, False, False, True, True, False], [True, False, True] * 2]
    assert main([str(f) for f in folders]) == 0
    assert f"{spread_ratio(won):.3f} of the binomial" in capsys.readouterr().out
    assert main([*map(str, folders), "--referee", "points"]) == 2
    assert "points was not asked" in capsys.readouterr().err
    with pytest.raises(InvalidConfig, match="same scenes"):
        success_table([found[0], {"a": found[0]["a"]}])
    with pytest.raises(InputError, match="OUT.trials"):
        read_trials(tmp_path)


def test_trials_of_earlier_versions_are_read(tmp_path):
    old = {"name": "gap", "blocks": {"0": {"outcome": ["fall"], "distance_m": [1.0], "time_s": [0.5]}}}
    (tmp_path / "scene-000.json").write_text(json.dumps(old))
    (found,) = read_trials(tmp_path).values()
    assert found == Trials(outcome=("fall",), distance_m=(1.0,), time_s=(0.5,))
    row = found.summary()
    assert row["falls"] == 1 and row["mean_distance_at_limit_m"] is row["stayed_share"] is row["points"] is None


def test_what_one_part_lacks_all_lack():
    new = trials(True, distance_at_limit_m=(0.1,), standing=(True,), stayed=(False,), points=("success",))
    both = Trials.joined([new, trials(False)])
    assert both.rollouts == 2 and both.points == both.standing == ()
    assert Trials.joined([new, new]).points == ("success", "success") and Trials.joined([]) == Trials()
    with pytest.raises(ValueError, match="values of points"):
        trials(True, False, points=("fall",))


def test_rates_of_arrivals():
    row = trials(
        True,
        True,
        False,
        True,
        distance_at_limit_m=(0.1, 0.2, 0.9, 0.0),
        standing=(True, False, False, True),
        stayed=(True, False, False, False),
        points=("success", "success", "robot_collision", "fall"),
    ).summary()
    assert row["standing_share"] == pytest.approx(2 / 3) and row["stayed_share"] == pytest.approx(1 / 3)
    assert row["mean_distance_at_limit_m"] == pytest.approx(0.3)
    assert row["points"]["success_rate"] == 0.5 and row["points"]["robot_collisions"] == row["points"]["falls"] == 1
    assert row["success_rate"] == 0.75


@pytest.mark.parametrize(
    "successes, number, low, high",
    [
        (0, 10, 0.0, 0.2775),
        (10, 10, 0.7225, 1.0),
        (5, 10, 0.2366, 0.7634),
        (81, 263, 0.2553, 0.3662),
        (1, 1, 0.2065, 1.0),
        (0, 0, 0.0, 1.0),
    ],
)
def test_known_intervals(successes, number, low, high):
    """81 of 263 is the example of Newcombe (1998), table I."""
    assert success_interval(successes, number) == pytest.approx((low, high), abs=1e-4)
