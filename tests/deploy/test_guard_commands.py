"""What the guard sends: servos held to torques and ranges, the way to the posture, damping."""

import numpy as np
import pytest

from hotice.deploy.command import DAMPING_KD, LIMITS
from hotice.deploy.guard.commands import ARMS, enabled_motors, servo, smooth
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.dry import DryLink
from hotice.deploy.guard.modes import Mode
from hotice.model import g1
from tests.deploy.guard_fixture import DT_S, POSTURE, TORQUE, Bench, bench_in


def test_a_locked_waist_stays_off_in_every_mode():
    bench = Bench(machine=6).to(Mode.CARRY)
    bench.ask("stop")
    sent = [command for command in bench.sent if command is not None]
    assert len(sent) > 500 and not any(command.enabled[[13, 14]].any() for command in sent)


def test_the_way_to_the_posture_is_smooth():
    bench = Bench(GuardConfig()).to(Mode.DAMPING)
    bench.q = np.where(ARMS, 0.4, 0.1)
    bench.dq[:] = 0.0
    bench.ticks(20)
    start = bench.q.copy()
    first = len(bench.sent)
    bench.ask("posture")
    bench.seconds(3.1)
    ways = np.array([command.q for command in bench.sent[first : first + 1501]])
    speed, gains = np.diff(ways, axis=0) / DT_S, np.array([command.kp / LIMITS.kp for command in bench.sent[first:]])
    assert np.abs(ways[0] - start).max() < 1e-6 and np.abs(ways[-1] - POSTURE).max() < 1e-6
    assert np.abs(speed[[0, -1]]).max() < 1e-3 and np.abs(speed).max() < 2.0 * np.abs(POSTURE - start).max() / 3.0
    assert gains[0].max() == pytest.approx(0.2) and gains[-1].min() == pytest.approx(1.0)
    assert (np.diff(gains, axis=0) > -1e-6).all() and (bench.worst_torque < 0.5 * TORQUE).all()


def test_smooth():
    s = np.linspace(0, 1, 101)
    values = np.array([smooth(x) for x in s])
    assert (
        values[0] == 0 and values[-1] == 1 and values[50] == pytest.approx(0.5) and smooth(-1) == 0 and smooth(2) == 1
    )
    slope = np.gradient(values, s)
    assert slope[0] < 0.01 and slope[-1] < 0.01 and slope.max() == pytest.approx(1.875, abs=0.01)


def test_damping_keeps_the_squeeze_for_a_second():
    bench = bench_in(Mode.CARRY)
    before = bench.sent[-1]
    bench.ask("stop")
    bench.ticks(499)
    first, last = bench.sent[-500], bench.sent[-1]
    for command in (first, last):
        assert (command.kp[~ARMS] == 0).all() and (command.kd[~ARMS] == DAMPING_KD).all()
        assert (command.tau[~ARMS] == 0).all()
        for name in ("q", "kp", "kd", "tau"):
            assert (getattr(command, name)[ARMS] == getattr(before, name)[ARMS]).all()
    bench.ticks(2)
    released = bench.sent[-1]
    assert (released.kp == 0).all() and (released.kd == DAMPING_KD).all() and (released.tau == 0).all()


def test_a_squeeze_asks_no_arm_for_more_than_its_torque():
    """Arms that a fall bends are pressed on with what their motors have, not with what the bend makes of the gains."""
    bench = bench_in(Mode.CARRY)
    bench.ask("stop")
    stiff = bench.sent[-1]
    bench.q = np.where(ARMS, bench.q - 0.8, bench.q)
    bench.ticks(30)  # a jump of the encoders is believed after a while
    measured = bench.guard.measured.newest.record["motor_state"]
    q, dq = measured["q"][:29], measured["dq"][:29]
    assert (np.abs(stiff.motor_torques(q, dq)) > TORQUE)[ARMS].any()
    assert (np.abs(bench.sent[-1].motor_torques(q, dq)) <= TORQUE * (1 + 1e-5)).all() and bench.sent[-1].kp[ARMS].any()


def test_damping_from_the_posture_squeezes_nothing():
    bench = bench_in(Mode.POSTURE)
    bench.ask("stop")
    assert (bench.sent[-1].kp == 0).all() and (bench.sent[-1].kd == DAMPING_KD).all()


def test_no_motor_is_asked_for_more_than_its_torque(rng):
    for _ in range(300):
        q, dq, measured = rng.uniform(-4, 4, 29), rng.uniform(-20, 20, 29), rng.uniform(-3, 3, 29)
        command = servo(q, rng.uniform(-60, 60, 29), measured, dq, 5, rng.uniform(0, 1))
        assert (np.abs(command.motor_torques(measured, dq)) <= TORQUE * (1 + 1e-5)).all()


def test_a_target_beyond_its_range_asks_for_the_same_torque():
    q, measured = np.zeros(29), np.zeros(29)
    ankle = g1.ALL_JOINTS.index("left_ankle_roll_joint")
    q[ankle] = LIMITS.upper[ankle] + 0.3
    command = servo(q, np.zeros(29), measured, np.zeros(29), 5)
    assert command.q[ankle] == LIMITS.upper[ankle]
    assert command.motor_torques(measured, np.zeros(29))[ankle] == pytest.approx(20.0 * q[ankle], rel=1e-5)
    measured[ankle] = LIMITS.upper[ankle] + 0.01  # at its stop it is not pressed on
    assert servo(q, np.zeros(29), measured, np.zeros(29), 5).motor_torques(measured, np.zeros(29))[ankle] <= 0.0


def test_a_dry_run_sends_nothing():
    bench = Bench(link=DryLink).to(Mode.CARRY)
    assert bench.robot.command() is None and bench.link.commands == sum(c is not None for c in bench.sent) > 500


def test_motors_of_a_machine():
    assert enabled_motors(5).all() and enabled_motors(6).sum() == 27 and not enabled_motors(4).any()
