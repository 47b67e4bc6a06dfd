"""Stations of model-based controllers are watched on measured signals as policies are: each fault, for each of them."""

from functools import cache

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.safety import Answer, Fault
from hotice.systems import InjectedFault, StationConfig, lost_box
from hotice.systems.faulty import BOX
from hotice.systems.setup.setup import StationSetup
from hotice.systems.signals import OBJECT_VEL, ROOT_VEL
from hotice.systems.station.make import Station
from tests.systems.test_faults import AT_S, DAMPED, ONE, one, quiet_before, state, watch

ROOT_SPEED, BOX_SPEED = (ROOT_VEL.start,), (OBJECT_VEL.start,)
KINDS = ("hold", "walk", "pickup")
BLIND = {
    "NaN joint": (one("robot_state", ONE), Fault.STATE_NOT_FINITE),
    "NaN gyro": DAMPED["NaN gyro"],
    "zero quaternion": DAMPED["zero quaternion"],
    "speed of 1e6": DAMPED["speed of 1e6"],
    "encoder off by 3 rad": DAMPED["encoder off by 3 rad"],
    "all NaN": DAMPED["all NaN"],
    "frozen tick": DAMPED["frozen tick"],
    "60 ms late": (state("late", value=0.06), Fault.STATE_LATE),
    "missing": (one("tick"), Fault.STATE_MISSING),
}
FAILING = {
    "NaN command": (one("command"), Fault.COMMAND_NOT_FINITE),
    "command of 1e9": (one("command", value=1e9), Fault.COMMAND_RANGE),
    "NaN gravity in the percept": DAMPED["NaN gravity in the percept"],
}
LOST = {
    "lost box": (lost_box(AT_S), Fault.BOX_LATE, 0.5),
    "NaN box pose": (one("percept", BOX), Fault.BOX_INVALID, 0.5),
    "NaN pelvis pose": (one("percept", (0, 1, 2)), Fault.POSE_INVALID, 0.3),
    "pelvis under the floor": (one("percept", (2,), value=-0.3), Fault.POSE_INVALID, 0.3),
}


@cache
def setup(kind):
    if kind != "hold":
        pytest.importorskip("pinocchio")
    return StationSetup.decide(StationConfig(scene="open_floor"), "mujoco", kind)


def seen_under(kind, faults, seconds):
    seen = watch(Station(setup(kind), faults=faults), AT_S + seconds)
    quiet_before(seen)
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", BLIND)
def test_who_does_not_know_its_own_state_is_damped_within_100_ms(name, kind):
    faults, fault = BLIND[name]
    seen = seen_under(kind, faults, 0.4)
    assert seen.counts[fault] >= 15 and 0.0 <= seen.damped_s() <= 0.1
    assert all(a is Answer.DAMP for t, a in zip(seen.time_s, seen.answer, strict=True) if t >= seen.damped_s())


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["walk", "pickup"])
@pytest.mark.parametrize("index", [ROOT_SPEED, BOX_SPEED])
def test_a_velocity_of_1e6_that_only_controllers_read(index, kind):
    seen = seen_under(kind, one("robot_state", index, value=1e6), 0.3)
    assert seen.counts[Fault.STATE_IMPOSSIBLE] >= 10 and 0.0 <= seen.damped_s() <= 0.1


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", FAILING)
def test_bad_commands_are_answered(name, kind):
    """A robot that stands is held; one that walks is damped."""
    faults, fault = FAILING[name]
    seen = seen_under(kind, faults, 0.6)
    assert seen.counts[fault] >= 25
    last = {a for t, a in zip(seen.time_s, seen.answer, strict=True) if t > 0.1}
    assert last == {Answer.DAMP if kind == "walk" else Answer.HOLD}
    if kind != "walk":
        assert seen.up.min() > 0.85 and seen.state[-1, 2] > 0.6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", LOST)
def test_what_is_not_known_of_the_way_ends_in_standing_upright(name, kind):
    """A walk ends where it is, a pick-up waits."""
    faults, fault, stop_s = LOST[name]
    seen = seen_under(kind, faults, 2.0 if kind == "hold" else 3.5)
    assert seen.counts[fault] >= 90
    assert all(a is Answer.PASS for t, a in zip(seen.time_s, seen.answer, strict=True) if t < stop_s - 0.021)
    later = {a for t, a in zip(seen.time_s, seen.answer, strict=True) if t > stop_s + 0.5}
    assert later == {Answer.STOP_WALKING}
    assert seen.up.min() > 0.8 and seen.state[-1, 2] > 0.6
    assert np.abs(seen.state[seen.time_s > seen.time_s[-1] - 0.5][:, :2] - seen.state[-1, :2]).max() < 0.02
    assert seen.speed[-1] < 0.3


@pytest.mark.slow
def test_a_pick_up_goes_on_when_the_box_is_seen_again():
    """Each phase ends as much later as it was told to wait."""
    setting, phases = setup("pickup"), {}
    for lost in ((), lost_box(0.6, 1.6)):
        station = Station(setting, faults=lost)
        pickup, simulator = station.GetSubsystemByName("pickup"), Simulator(station)
        seen = watch(station, 3.6, simulator=simulator)
        assert set(seen.counts) == ({Fault.BOX_LATE} if lost else set()) and seen.up.min() > 0.7
        waited = 0.02 * sum(a is Answer.STOP_WALKING for a in seen.answer)
        memory = pickup.memory(pickup.GetMyContextFromRoot(simulator.get_context()))
        phases[waited] = {name: time_s for time_s, name, _ in memory.log}
    (_, early), (waited, late) = sorted(phases.items())
    assert waited == pytest.approx(0.5, abs=0.03) and "reach" in late
    assert late["crouch"] == early["crouch"] and late["reach"] == pytest.approx(early["reach"] + waited, abs=0.011)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_without_a_fault_none_is_found(kind):
    seen = watch(Station(setup(kind)), 2.5)
    assert not seen.counts and set(seen.answer) == {Answer.PASS}


def test_who_only_holds_a_posture_topples_and_is_damped_before_it_lies():
    """Nobody balances; the fall is a true one, and seen before the robot leans by 60 degrees."""
    seen = watch(Station(setup("hold")), 4.4, 0.0)
    assert 3.0 < seen.damped_s() < 4.2 and set(seen.fault) == {Fault.NONE, Fault.FALLING}
    damped = np.array([answer is Answer.DAMP for answer in seen.answer])
    assert seen.up[damped][0] > 0.5 and seen.up[-1] < 0.1 and seen.state[-1, 2] < 0.2


@pytest.mark.slow
def test_a_fall_of_a_walk_is_seen_in_its_percept():
    """Its pelvis is low for the sensors, whatever the robot's own state says."""
    seen = seen_under("walk", [InjectedFault(signal="percept", index=(2,), value=0.3, from_s=AT_S)], 0.3)
    # the guard holds where the pelvis was: a jump first, then the truth
    assert seen.counts[Fault.POSE_JUMP] >= 4 and seen.counts[Fault.PELVIS_LOW] >= 1 and seen.damped_s() <= 0.1
