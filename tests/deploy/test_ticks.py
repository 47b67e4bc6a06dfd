import pytest

from hotice.deploy.link.ticks import TickOrder


def judged(*ticks):
    order = TickOrder()
    return [order.judge(tick) for tick in ticks], order.missed


def test_new_repeated_and_older():
    assert judged(10, 11, 11, 13, 12, 14) == (["new", "new", "repeat", "new", "backwards", "new"], 1)


@pytest.mark.parametrize("step", [1, 2, 2000])
def test_missed_states_whatever_a_tick_is(step):
    """The unit of the tick is learned: 100 states, 5 of them lost in three gaps."""
    kept = [i for i in range(100) if i not in (20, 40, 41, 70, 71)]
    verdicts, missed = judged(*(i * step for i in kept))
    assert set(verdicts) == {"new"} and missed == 5


def test_a_reader_that_sees_every_third_state_knows_what_it_missed():
    ticks = [0, 2, 4, *range(10, 124, 6), 124]
    assert judged(*ticks)[1] == 62 + 1 - len(ticks)


def test_the_tick_wraps():
    top = (1 << 32) - 1
    assert judged(top - 1, top, 0, 1) == (["new"] * 4, 0)


def test_a_robot_that_restarts():
    """The fifth older state in a row, each newer than the one before, is the new beginning."""
    verdicts, missed = judged(1000, 1001, 1, 2, 3, 4, 5, 6, 7)
    assert verdicts == ["new", "new", *["backwards"] * 4, "new", "new", "new"] and missed == 0


def test_old_states_that_keep_coming_are_no_restart():
    assert set(judged(1000, *[7] * 20)[0][1:]) == {"backwards"}
    assert set(judged(1000, *range(100, 80, -1))[0][1:]) == {"backwards"}
