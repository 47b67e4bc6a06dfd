"""What the guard does about its runner: late, wrong and missing targets, and what they say."""

import numpy as np
import pytest

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from tests.deploy.guard_fixture import POSTURE, TORQUE, Bench, bench_in


def test_the_posture_needs_a_warm_runner():
    bench = Bench()
    bench.targets["warm"] = 0
    bench.to(Mode.DAMPING)
    bench.ticks(50)
    assert bench.ask("posture") is Mode.DAMPING and "not warm" in bench.events[-1].text
    bench.runner_runs = False
    bench.ticks(50)
    assert bench.ask("posture") is Mode.DAMPING and "no fresh targets" in bench.events[-1].text


def test_a_silent_runner():
    bench = bench_in(Mode.CARRY)
    assert bench.ticks(10 - bench.count % 10 + 1) is Mode.CARRY
    moved = POSTURE.copy()
    moved[4] += 0.4
    bench.put(q=moved)
    bench.runner_runs = False
    assert bench.ticks(39) is Mode.CARRY
    # repeated for 60 ms, then back to the posture by no more than 0.07 rad in 2 ms
    way = np.array([command.q[4] for command in bench.sent[-39:]])
    assert (way[:30] == np.float32(moved[4])).all() and way[31] < moved[4]
    assert way[-1] == pytest.approx(POSTURE[4]) and np.abs(np.diff(way)).max() <= 0.07 + 1e-6
    assert bench.ticks(2) is Mode.DAMPING and bench.guard.cause is Cause.TARGET_AGE
    assert bench.clock.now() - float(bench.slot["stamp_s"]) <= 0.1


BAD_TARGETS = {
    "nan": dict(q=np.full(29, np.nan)),
    "infinite": dict(q=np.full(29, np.inf)),
    "huge": dict(q=np.full(29, 1e30)),
    "torque not finite": dict(tau=np.full(29, np.nan)),
    "beyond the range": dict(q=np.full(29, 4.5)),
    "step": dict(q=POSTURE + 0.75),
    "torque": dict(tau=np.full(29, 200.0)),
    "from the future": dict(stamp_s=1e9),
}


@pytest.mark.parametrize("name", BAD_TARGETS)
def test_bad_targets_are_not_followed_and_three_in_a_row_are_the_end(name):
    bench = bench_in(Mode.CARRY)
    bench.runner_runs = False
    before = bench.sent[-1]
    with np.errstate(over="ignore"):
        for count, mode in ((1, Mode.CARRY), (2, Mode.CARRY), (3, Mode.DAMPING)):
            bench.put(**BAD_TARGETS[name])
            assert bench.ticks(5) is mode and bench.guard.targets.refused == count
            if mode is Mode.CARRY:
                assert (bench.sent[-1].q == before.q).all()
    assert bench.guard.cause is Cause.TARGETS_REFUSED and (bench.worst_torque <= TORQUE).all()


def test_good_targets_between_bad_ones():
    bench = bench_in(Mode.CARRY)
    bench.runner_runs = False
    for _ in range(20):
        for bad in (True, True, False):
            bench.put(**(BAD_TARGETS["nan"] if bad else {}))
            assert bench.ticks(5) is Mode.CARRY
    assert bench.guard.targets.refused == 40


STANDS_STILL = {
    "box": (dict(box_age_s=1.9), dict(box_age_s=2.0), Cause.BOX_UNSEEN),
    "pose": (dict(pose_age_s=0.9), dict(pose_age_s=1.0), Cause.POSE_AGE),
    "movers": (dict(pose_age_s=0.9), dict(pose_age_s=1.0, movers_old=1), Cause.POSE_AGE),
    "dispute": (dict(pose_disputed=0), dict(pose_disputed=1), Cause.POSE_DISPUTED),
}


@pytest.mark.parametrize("name", STANDS_STILL)
def test_a_robot_that_does_not_know_where_stands_still(name):
    good, bad, cause = STANDS_STILL[name]
    bench = bench_in(Mode.CARRY)
    for field, value in good.items():
        bench.targets[field] = value
    assert bench.seconds(0.2) is Mode.CARRY
    for field, value in bad.items():
        bench.targets[field] = value
    assert bench.seconds(0.1) is Mode.HOLD and bench.guard.cause is cause
    assert bench.ask("carry") is Mode.HOLD and "carry is refused" in bench.events[-1].text
    assert ("what moves was seen 1.0 s ago" in bench.events[-1].text) == (name == "movers")
    for field in bad:
        bench.targets[field] = 0
    assert bench.seconds(0.5) is Mode.HOLD  # never on without a wish
    assert bench.ask("carry") is Mode.CARRY


def test_a_runner_elsewhere_is_not_followed():
    bench = bench_in(Mode.READY)
    for turned in (0.4, 0.8):
        bench.targets["q"][2] = POSTURE[2] + turned
        assert bench.ticks(20) is Mode.READY
    assert bench.ask("carry") is Mode.READY and "away from the posture" in bench.events[-1].text
