"""What the guard does about the robot: states, link, gamepad, heat and charge."""

import numpy as np
import pytest

from hotice.deploy.command import DAMPING_KD
from hotice.deploy.guard.commands import damping
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.link.faults import Faults
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_STATE
from tests.deploy.guard_fixture import DT_S, TORQUE, Bench, bench_in, untouched


def state_fault(name, value):
    def edit(state):
        if name == "quaternion":
            state["imu_state"]["quaternion"] = value
        elif name == "gyroscope":
            state["imu_state"]["gyroscope"][1] = value
        else:
            state["motor_state"][name][3] = value

    return edit


def leaning(lean_rad, rate_rad_s=0.0):
    """Leans forward by so much, further at a rate."""

    def edit(state):
        state["imu_state"]["quaternion"] = np.cos(0.5 * lean_rad), 0.0, np.sin(0.5 * lean_rad), 0.0
        state["imu_state"]["gyroscope"][:] = 0.0, rate_rad_s, 0.0

    return edit


NOW = {
    "lean": (leaning(1.0002, -1.0), Cause.LEAN, 0.0),
    "falling over": (leaning(0.6, 2.05), Cause.FALLING, 0.02),
    "joint speed": (state_fault("dq", 30.1), Cause.JOINT_SPEED, 0.0),
    "gyro": (state_fault("gyroscope", -6.1), Cause.GYRO, 0.0),
    "angle not finite": (state_fault("q", np.nan), Cause.STATES_REFUSED, 0.008),
    "angle infinite": (state_fault("q", np.inf), Cause.STATES_REFUSED, 0.008),
    "angle huge": (state_fault("q", 1e30), Cause.STATES_REFUSED, 0.008),
    "no attitude": (state_fault("quaternion", (0.0, 0.0, 0.0, 0.0)), Cause.STATES_REFUSED, 0.008),
    "attitude not finite": (state_fault("quaternion", (np.nan, 0.0, 0.0, 0.0)), Cause.STATES_REFUSED, 0.008),
    "an encoder that stays off": (
        lambda s: s["motor_state"]["q"].__setitem__(3, s["motor_state"]["q"][3] + 1.0),
        Cause.STATES_REFUSED,
        0.008,
    ),
}


@pytest.mark.parametrize("mode", [Mode.POSTURE, Mode.CARRY])
@pytest.mark.parametrize("name", NOW)
def test_states_that_end_in_damping(name, mode):
    edit, cause, after_s = NOW[name]
    bench = bench_in(mode)
    bench.edit = edit
    bench.ticks(1)
    assert bench.until_damping() == pytest.approx(after_s) and bench.guard.cause is cause
    bench.edit = untouched
    assert bench.seconds(1.0) is Mode.DAMPING


HARMLESS = {
    "lean": leaning(0.9998, -1.0),
    "leaning on": leaning(0.6, 1.95),
    "leaning less and less": leaning(0.6, -5.0),
    "negated attitude": state_fault("quaternion", (-1.0, 0.0, 0.0, 0.0)),
    "joint speed": state_fault("dq", -29.9),
    "gyro": state_fault("gyroscope", 5.9),
}


@pytest.mark.parametrize("name", HARMLESS)
def test_states_that_do_not(name):
    bench = bench_in(Mode.CARRY)
    bench.edit = HARMLESS[name]
    assert bench.seconds(1.0) is Mode.CARRY


def test_one_state_that_says_so_is_no_fall():
    bench = bench_in(Mode.CARRY)
    once(bench, leaning(0.6, 5.0), ticks=9)
    assert bench.ticks(50) is Mode.CARRY


def once(bench, edit, ticks=1):
    bench.edit = edit
    bench.ticks(ticks)
    bench.edit = untouched


@pytest.mark.parametrize("jump", [1.0, -1.0, np.nan, 1e30])
def test_an_encoder_that_jumps_for_one_sample_moves_no_motor(jump):
    bench = bench_in(Mode.CARRY)
    before = bench.sent[-1]
    once(bench, lambda state: state["motor_state"]["q"].__setitem__(3, jump + state["motor_state"]["q"][3]))
    assert bench.guard.measured.refused_in_a_row == 1
    assert np.abs(bench.sent[-1].motor_torques(bench.q, bench.dq) - before.motor_torques(bench.q, bench.dq)).max() < 0.1
    assert bench.ticks(50) is Mode.CARRY and bench.guard.measured.refused_in_a_row == 0


def test_four_damaged_states_are_not_silence_and_five_are():
    for count, mode in ((4, Mode.CARRY), (5, Mode.DAMPING)):
        bench = bench_in(Mode.CARRY)
        once(bench, state_fault("q", np.nan), count)
        assert bench.ticks(5) is mode


def test_silence():
    bench = bench_in(Mode.CARRY)
    bench.silent = True
    assert bench.ticks(24) is Mode.CARRY
    # 50 ms are at the limit, which the sums of the clock may pass by a rounding error
    assert bench.ticks(2) is Mode.DAMPING and bench.guard.cause is Cause.STATE_AGE
    assert bench.robot.command().record["motor_cmd"]["kd"][0] == DAMPING_KD
    # a fault that gets worse is told again: what brakes is among the faults, not only a change of mode
    told = [e.text.split(":")[0] for e in bench.events if e.cause is Cause.STATE_AGE and "state is" in e.text]
    assert told == ["warn", "damping", told[-1]] and bench.events[-1].mode is Mode.DAMPING
    warned = [e for e in bench.events if e.text.startswith("warn: state is")]
    assert len(warned) == 1 and warned[0].time_s - (bench.clock.now() - 26 * DT_S) == pytest.approx(0.02, abs=2.1e-3)


def test_a_link_that_cannot_be_read_is_silence_and_stays_guarded():
    bench = bench_in(Mode.CARRY)

    def fails():
        raise LinkError("messages cannot be taken: the reader is gone")

    read, bench.link.state = bench.link.state, fails
    assert bench.until_damping() == pytest.approx(0.05, abs=2.1e-3) and bench.guard.cause is Cause.STATE_AGE
    assert [e.text for e in bench.events if e.cause is Cause.LINK] == [
        "warn: messages cannot be taken: the reader is gone"
    ]
    assert bench.ask("posture") is Mode.DAMPING and "no state within" in bench.events[-1].text
    bench.link.state = read
    bench.ticks(2)
    assert bench.ask("posture") is Mode.POSTURE


def test_a_battery_that_cannot_be_read_is_not_known():
    bench = Bench()

    def fails():
        raise LinkError("messages cannot be taken: the reader is gone")

    bench.guard._charge = fails
    bench.ticks(300)
    assert bench.ask("start") is Mode.OFF and "charge is not known" in bench.events[-1].text


def test_a_tick_that_stands_still_is_silence():
    bench = Bench(state_faults=[Faults(frozen_tick=True, from_s=2.5 - 1e-6)]).to(Mode.CARRY)
    bench.ticks(round((2.5 - bench.clock.now()) / DT_S))
    assert bench.guard.mode is Mode.CARRY
    # the first frozen state is new
    assert bench.until_damping() == pytest.approx(0.052, abs=2.1e-3) and bench.guard.cause is Cause.STATE_AGE


@pytest.mark.parametrize("late_s", [0.005, 0.02, 0.06, 0.2])
def test_late_states(late_s):
    """All late alike: only those older than the limit at their arrival are noticed, by the gap before the first."""
    bench = Bench(state_faults=[Faults(late=1.0, late_s=late_s, from_s=2.5 - 1e-6)]).to(Mode.CARRY)
    bench.ticks(round((2.5 - bench.clock.now()) / DT_S))
    bench.seconds(0.5)
    assert bench.guard.mode is (Mode.DAMPING if late_s > 0.05 else Mode.CARRY)


@pytest.mark.parametrize("fault", [dict(lost=0.01), dict(lost=0.2), dict(doubled=1.0), dict(late=0.3, late_s=0.006)])
def test_lost_doubled_and_reordered_states_are_borne(fault):
    bench = Bench(state_faults=[Faults(**fault)], seed=3).to(Mode.CARRY)
    assert bench.seconds(2.0) is Mode.CARRY


def test_another_commander_ends_in_damping():
    bench = Bench()
    other = bench.bus.link()
    bench.to(Mode.CARRY)
    other.state()
    other.publish(damping(5))
    assert bench.ticks(1) is Mode.DAMPING and bench.guard.cause is Cause.PUBLISHER


def test_no_gamepad():
    bench = bench_in(Mode.CARRY)
    bench.keys = None
    assert bench.seconds(3.0) is Mode.CARRY
    assert bench.ticks(2) is Mode.HOLD and bench.guard.cause is Cause.GAMEPAD
    bench = Bench(GuardConfig(gamepad_needed=False, posture_s=1.0))
    bench.keys = None
    assert bench.to(Mode.CARRY).seconds(3.1) is Mode.CARRY


HOT = {
    "battery": (lambda b: setattr(b, "charge", 14.9), lambda b: setattr(b, "charge", 80.0), Cause.BATTERY),
    "winding": (
        lambda b: b.state["motor_state"]["temperature"].__setitem__((3, 1), 111),
        lambda b: b.state["motor_state"]["temperature"].__setitem__((3, 1), 40),
        Cause.HEAT,
    ),
    "casing": (
        lambda b: b.state["motor_state"]["temperature"].__setitem__((3, 0), 81),
        lambda b: b.state["motor_state"]["temperature"].__setitem__((3, 0), 40),
        Cause.HEAT,
    ),
    "motor": (
        lambda b: b.state["motor_state"]["motorstate"].__setitem__(3, 1),
        lambda b: b.state["motor_state"]["motorstate"].__setitem__(3, 0),
        Cause.MOTOR,
    ),
}


@pytest.mark.parametrize("name", HOT)
def test_heat_and_charge_put_the_box_down_after_a_second(name):
    change, back, cause = HOT[name]
    bench = bench_in(Mode.CARRY)
    change(bench)
    assert bench.seconds(0.99) is Mode.CARRY
    back(bench)
    bench.ticks(2)
    change(bench)
    assert bench.seconds(1.0) is Mode.CARRY
    assert bench.ticks(2) is Mode.LOWER and bench.guard.cause is cause


def test_no_new_carry_when_hot():
    bench = bench_in(Mode.READY)
    HOT["winding"][0](bench)
    bench.seconds(1.1)
    assert bench.ask("carry") is Mode.READY and "hot" in bench.events[-1].text


def test_a_fault_that_comes_and_goes_is_told_once():
    bench = bench_in(Mode.CARRY)
    before = len(bench.events)
    for _ in range(20):
        once(bench, state_fault("q", np.nan))
        bench.ticks(9)
    assert [event.cause for event in bench.events[before:]] == [Cause.STATES_REFUSED]
    bench.seconds(1.1)
    once(bench, state_fault("q", np.nan))
    assert [event.cause for event in bench.events[before:]] == [Cause.STATES_REFUSED] * 2


def test_a_thousand_damaged_messages_raise_nothing_and_reach_no_motor(rng):
    bench = bench_in(Mode.CARRY)
    good = seal(LOW_STATE, bench.state)
    for i in range(1000):
        rubbish = bytearray(good)
        if i % 2:
            rubbish[int(rng.integers(len(good)))] ^= int(rng.integers(1, 256))
        else:
            rubbish = rng.bytes(int(rng.integers(0, 3000)))
        bench.bus.put_state(bytes(rubbish))
        bench.bus.put_command(rng.bytes(int(rng.integers(0, 1500)))) if i % 10 == 0 else None
        bench.ticks(1)
    bench.robot.command()
    counts = bench.robot.counts()
    assert counts.taken == sum(c is not None for c in bench.sent) and sum(counts.refused.values()) == 100
    assert (bench.worst_torque <= TORQUE).all() and bench.link.counts().refused
