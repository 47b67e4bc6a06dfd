"""Logs of branches as rows of their run."""

import pytest

from hotice.learn.branches.rows import Rows, joined, logged


def test_a_row_of_several_counts_what_they_did_together():
    one = {"reward": 1.0, "episodes": 3.0, "share/fall": 0.0, "length": 10.0, "steps_per_s": 100.0, "family/gap": 1.0}
    two = {"reward": 3.0, "episodes": 1.0, "share/fall": 1.0, "length": 30.0, "steps_per_s": 50.0}
    assert joined([one, two]) == {
        "reward": 2.0,
        "episodes": 4.0,
        "share/fall": 0.25,
        "length": 15.0,
        "steps_per_s": 150.0,
        "family/gap": 1.0,
    }


def test_shares_without_an_episode_are_no_division_by_zero():
    assert joined([{"episodes": 0.0, "length": 0.0}]) == {"episodes": 0.0, "length": 0.0}


def test_rows_come_in_order_once_all_have_done_them():
    rows = Rows(4, 1000, 64)
    for number in (0, 1):
        rows.take_part(number, 4)
    rows.add(0, 5, {"reward": 1.0})
    rows.add(0, 6, {"reward": 2.0})
    assert list(rows.whole()) == []
    rows.add(1, 5, {"reward": 3.0})
    assert list(rows.whole()) == [(5, 1128, {"reward": 2.0, "branches": 2.0})]
    rows.leave_out(1)
    assert list(rows.whole()) == [(6, 1192, {"reward": 2.0, "branches": 1.0})]


def test_a_branch_that_is_ahead_is_waited_for_and_a_row_that_is_lost_is_not():
    rows = Rows(0, 0, 64)
    rows.take_part(0, 2)
    rows.take_part(1, 0)
    rows.add(0, 2, {"reward": 1.0})
    rows.add(1, 1, {"reward": 5.0})
    assert list(rows.whole()) == [(1, 128, {"reward": 5.0, "branches": 2.0})]
    rows.add(1, 2, {"reward": 3.0})
    assert [row["reward"] for _, _, row in rows.whole()] == [pytest.approx(2.0)]


def test_logs_are_read_back_without_counters_and_torn_lines(tmp_path):
    path = tmp_path / "log.jsonl"
    path.write_text(
        '{"update": 1, "steps": 8, "minutes": 0.1, "reward": 1.0}\n{"update": 2, "reward": 2.0}\n'
        '[1]\n{"update": 3, "reward": 3.0}\n{"upd'
    )
    assert list(logged(path, 1, 3)) == [(2, {"reward": 2.0}), (3, {"reward": 3.0})]
    assert list(logged(tmp_path / "none", 0, 9)) == []
