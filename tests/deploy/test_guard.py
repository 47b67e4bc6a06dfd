"""The guard in simulated time over the link in memory: modes, faults, and what reaches the motors."""

import numpy as np
import pytest

from hotice.deploy.command import DAMPING_KD, LIMITS
from hotice.deploy.guard.commands import ARMS, damping, enabled_motors, servo, smooth
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.decide import decide
from hotice.deploy.guard.dry import DryLink
from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import NEXT, Mode, Request, wished
from hotice.deploy.link.faults import Faults
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_STATE
from hotice.model import g1
from tests.deploy.guard_fixture import DT_S, POSTURE, TORQUE, Bench, bench_in, untouched

ACTIVE = [Mode.POSTURE, Mode.READY, Mode.CARRY, Mode.HOLD, Mode.LOWER]


def test_from_off_to_a_carry_and_down_again():
    bench = Bench()
    assert bench.ticks(300) is Mode.OFF and bench.robot.command() is None and bench.sent == [None] * 300
    assert bench.ask("start") is Mode.DAMPING
    bench.seconds(0.1)
    assert bench.ask("posture") is Mode.POSTURE
    bench.seconds(3.1)
    assert bench.guard.mode is Mode.READY and np.abs(bench.q - POSTURE).max() < 0.01
    for wish, mode in (("carry", "CARRY"), ("hold", "HOLD"), ("carry", "CARRY"), ("hold", "HOLD"), ("lower", "LOWER")):
        assert bench.ask(wish).name == mode
        assert bench.seconds(0.1).name == mode
    assert bench.ask("stop") is Mode.DAMPING
    assert bench.seconds(1.0) is Mode.DAMPING and bench.guard.cause is Cause.OPERATOR
    assert (bench.worst_torque <= TORQUE).all()


def test_nothing_moves_on_without_a_wish():
    bench = Bench()
    assert bench.seconds(1.0) is Mode.OFF
    bench.ask("start")
    assert bench.seconds(2.0) is Mode.DAMPING
    bench.ask("posture")
    assert bench.seconds(3.0) is Mode.READY


def test_wishes_lead_where_the_table_says_and_nowhere_else():
    for mode in Mode:
        for request in Request:
            if request is not Request.STOP:
                assert wished(mode, request) is NEXT.get((mode, request), mode)
        assert wished(mode, Request.STOP) is (Mode.OFF if mode is Mode.OFF else Mode.DAMPING)
    assert all(NEXT[pair] is not Mode.OFF for pair in NEXT)


@pytest.mark.parametrize(
    ("mode", "wishes", "after"),
    [
        ("PICK_UP", "CARRY HOLD", "HOLD"),
        ("HOLD", "CARRY LOWER", "LOWER"),
        ("CARRY", "LOWER HOLD", "HOLD"),
        ("READY", "CARRY PICK_UP", "PICK_UP"),
        ("CARRY", "HOLD STOP", "DAMPING"),
    ],
)
def test_of_several_wishes_the_calmest_counts(mode, wishes, after):
    asked = {Request[wish] for wish in wishes.split()}
    assert decide(Mode[mode], [], asked).mode is Mode[after]


@pytest.mark.parametrize("mode", ACTIVE)
def test_the_operator_stops_every_mode(mode):
    assert bench_in(mode).ask("stop") is Mode.DAMPING


def test_the_goal_ends_a_carry():
    bench = bench_in(Mode.READY)
    bench.targets["done"] = 1  # of an earlier carry
    bench.ticks(10)
    bench.targets["done"] = 0
    bench.ask("carry")
    assert bench.ticks(20) is Mode.CARRY
    bench.targets["done"] = 1
    assert bench.ticks(20) is Mode.HOLD and bench.guard.cause is Cause.DONE


ENTRY = {
    "no state": (lambda b: setattr(b, "silent", True), "no state within"),
    "battery": (lambda b: setattr(b, "charge", 19.0), "battery has 19 %"),
    "unknown battery": (lambda b: setattr(b, "charge", None), "charge is not known"),
    "gamepad": (lambda b: setattr(b, "keys", None), "no gamepad"),
    "mode_pr": (lambda b: b.state.__setitem__("mode_pr", 1), "mode_pr is 1"),
    "motor": (
        lambda b: b.state["motor_state"]["motorstate"].__setitem__(3, 0x200),
        "left_knee_joint reports error 0x200",
    ),
    "heat": (lambda b: b.state["motor_state"]["temperature"].__setitem__((12, 1), 111), "waist_yaw_joint is hot"),
}


@pytest.mark.parametrize("name", ENTRY)
def test_conditions_of_the_first_step(name):
    change, reason = ENTRY[name]
    bench = Bench()
    bench.ticks(300)
    change(bench)
    bench.ticks(20)
    assert bench.ask("start") is Mode.OFF
    assert reason in bench.events[-1].text and set(bench.sent) == {None}


def test_the_first_step_at_its_limits():
    bench = Bench()
    bench.charge = 20.0
    bench.state["motor_state"]["temperature"] = (80, 110)
    bench.ticks(251)
    assert bench.ask("start") is Mode.DAMPING


def test_half_a_second_of_silence_is_needed():
    bench = Bench()
    bench.ticks(245)
    assert bench.ask("start") is Mode.OFF and "somebody else may be commanding" in bench.events[-1].text
    bench.ticks(5)
    assert bench.ask("start") is Mode.DAMPING


@pytest.mark.parametrize("machine", [4, 6])
def test_other_machines(machine):
    bench = Bench(GuardConfig(waist_needed=True), machine=machine)
    bench.ticks(300)
    assert bench.ask("start") is Mode.OFF
    assert ("is not commanded" if machine == 4 else "locked waist") in bench.events[-1].text


def test_a_locked_waist_stays_off_in_every_mode():
    bench = Bench(machine=6).to(Mode.CARRY)
    bench.ask("stop")
    sent = [command for command in bench.sent if command is not None]
    assert len(sent) > 500 and not any(command.enabled[[13, 14]].any() for command in sent)


def test_the_posture_needs_a_warm_runner():
    bench = Bench()
    bench.targets["warm"] = 0
    bench.to(Mode.DAMPING)
    bench.ticks(50)
    assert bench.ask("posture") is Mode.DAMPING and "not warm" in bench.events[-1].text
    bench.runner_runs = False
    bench.ticks(50)
    assert bench.ask("posture") is Mode.DAMPING and "no fresh targets" in bench.events[-1].text


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


def state_fault(name, value):
    def edit(state):
        if name == "quaternion":
            state["imu_state"]["quaternion"] = value
        elif name == "gyroscope":
            state["imu_state"]["gyroscope"][1] = value
        else:
            state["motor_state"][name][3] = value

    return edit


TURNED = (float(np.cos(0.5001)), 0.0, float(np.sin(0.5001)), 0.0)
NOW = {
    "lean": (state_fault("quaternion", TURNED), Cause.LEAN, 0.0),
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
    "lean": state_fault("quaternion", (float(np.cos(0.4999)), 0.0, float(np.sin(0.4999)), 0.0)),
    "negated attitude": state_fault("quaternion", (-1.0, 0.0, 0.0, 0.0)),
    "joint speed": state_fault("dq", -29.9),
    "gyro": state_fault("gyroscope", 5.9),
}


@pytest.mark.parametrize("name", HARMLESS)
def test_states_that_do_not(name):
    bench = bench_in(Mode.CARRY)
    bench.edit = HARMLESS[name]
    assert bench.seconds(1.0) is Mode.CARRY


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
    for field in bad:
        bench.targets[field] = 0
    assert bench.seconds(0.5) is Mode.HOLD  # never on without a wish
    assert bench.ask("carry") is Mode.CARRY


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


def test_a_runner_elsewhere_is_not_followed():
    bench = bench_in(Mode.READY)
    for turned in (0.4, 0.8):
        bench.targets["q"][2] = POSTURE[2] + turned
        assert bench.ticks(20) is Mode.READY
    assert bench.ask("carry") is Mode.READY and "away from the posture" in bench.events[-1].text


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


def test_a_dry_run_sends_nothing():
    bench = Bench(link=DryLink).to(Mode.CARRY)
    assert bench.robot.command() is None and bench.link.commands == sum(c is not None for c in bench.sent) > 500


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


def test_the_status_says_what_the_guard_knows():
    bench = bench_in(Mode.HOLD)
    status = bench.status
    assert status["mode"] == Mode.HOLD and status["cause"] == Cause.OPERATOR and status["sequence"] > 0
    assert status["state"]["tick"] == bench.state["tick"] and status["stamp_s"] == pytest.approx(
        bench.clock.now() - DT_S
    )


def test_motors_of_a_machine():
    assert enabled_motors(5).all() and enabled_motors(6).sum() == 27 and not enabled_motors(4).any()
