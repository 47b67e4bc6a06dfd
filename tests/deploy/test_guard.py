"""The guard in simulated time over the link in memory: modes, wishes, and conditions of the first steps."""

import numpy as np
import pytest

from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.decide import decide
from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import NEXT, Mode, Request, wished
from tests.deploy.guard_fixture import DT_S, POSTURE, TORQUE, Bench, bench_in

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


def test_the_status_says_what_the_guard_knows():
    bench = bench_in(Mode.HOLD)
    status = bench.status
    assert status["mode"] == Mode.HOLD and status["cause"] == Cause.OPERATOR and status["sequence"] > 0
    assert status["state"]["tick"] == bench.state["tick"] and status["stamp_s"] == pytest.approx(
        bench.clock.now() - DT_S
    )
