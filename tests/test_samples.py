"""Samples go round, and are the same in all processes of a run."""

from pathlib import Path

from tests.samples import SEED_NAME, draw_seed, sample, split_alone


def test_each_seed_takes_others_until_all_were_taken(monkeypatch):
    taken = set()
    for seed in range(40):
        monkeypatch.setenv(SEED_NAME, str(seed))
        assert len(set(sample("abcdefgh", 2))) == 2 and sample("abcdefgh", 2) == sample("abcdefgh", 2)
        taken |= set(sample("abcdefgh", 2))
    assert taken == set("abcdefgh") and len(sample("abc", 9)) == 3


def test_the_seed_is_drawn_once_and_is_told(monkeypatch, pytestconfig):
    monkeypatch.delenv(SEED_NAME)
    seed = draw_seed()
    assert draw_seed() == seed
    told = pytestconfig.hook.pytest_report_header(config=pytestconfig, start_path=Path())
    assert f"samples: {SEED_NAME}={seed} takes the same again" in told


def test_what_needs_the_machine_for_itself_runs_beside_nothing():
    """Workers leave it out, and with --alone nothing else runs; without either all do."""
    tests, is_alone = ["fast", "walk", "slow"], "walk".__eq__
    assert split_alone(tests, is_alone, asked=False, beside=False) == (tests, [])
    assert split_alone(tests, is_alone, asked=False, beside=True) == (["fast", "slow"], ["walk"])
    for beside in (False, True):
        assert split_alone(tests, is_alone, asked=True, beside=beside) == (["walk"], ["fast", "slow"])
