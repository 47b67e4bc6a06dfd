"""The in-memory link with each fault of the way, on a simulated clock: 500 states a second."""

import dataclasses

import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.command import LIMITS, CheckedCommand
from hotice.deploy.dds.link import Arrivals
from hotice.deploy.link.faults import Faults
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.link.publishers import SecondPublisher, check_sole_publisher
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_STATE, MACHINES
from hotice.errors import InvalidConfig
from tests.deploy.messages_fixture import low_state

DT_S = 0.002
ZERO = np.zeros(29)
STAND = CheckedCommand(q=ZERO, dq=ZERO, tau=ZERO, kp=LIMITS.kp, kd=LIMITS.kd, enabled=np.ones(29, bool))
LOCKED = dataclasses.replace(STAND, enabled=~np.isin(np.arange(29), (13, 14)))
"""As `STAND`, for machines whose waist is locked."""


class Run:
    """A robot that publishes every `DT_S`, a controller that answers each new state."""

    def __init__(self, *, machine=5, command=STAND, **bus):
        self.command = command
        self.clock = SimulatedClock()
        self.bus = MemoryBus(self.clock, **bus)
        self.link, self.robot = self.bus.link(), self.bus.robot()
        self.record = low_state(np.random.default_rng(0), machine=machine)
        self.ages = []

    def steps(self, count):
        for _ in range(count):
            self.record["tick"] += 1
            self.robot.publish_state(self.record)
            state = self.link.state()
            self.ages.append(np.inf if state is None else state.age_s)
            if state is not None:
                self.link.publish(self.command)
            self.robot.command()
            self.clock.sleep(DT_S)
        return self.link.counts()


def test_without_faults_everything_arrives_and_the_machine_is_echoed():
    run = Run(machine=13)
    assert run.link.state() is None and run.robot.command() is None
    counts = run.steps(100)
    assert counts.taken == 100 and counts.missed == 0 and not counts.refused and max(run.ages) == 0.0
    command = run.robot.command()
    assert command.sequence == 100 and command.record["mode_machine"] == 13
    assert (command.record["motor_cmd"]["kp"][:29] == LIMITS.kp).all()
    state = run.link.state()
    assert state.sequence == 100 and state.tick == 101 and state.mode_machine == 13
    assert state.record["motor_state"]["q"].tobytes() == run.record["motor_state"]["q"].tobytes()


def test_nothing_is_sent_before_the_robot_was_heard():
    run = Run()
    with pytest.raises(LinkError, match="no valid LowState"):
        run.link.publish(STAND)
    assert run.robot.command() is None


def test_nothing_unchecked_is_sent():
    run = Run()
    run.steps(1)
    with pytest.raises(LinkError, match="CheckedCommand only, not ndarray"):
        run.link.publish(STAND.record(5))


def test_machines_with_29_joints_are_commanded_and_no_other():
    for machine in MACHINES:
        run = Run(machine=machine, command=LOCKED)
        if machine in (5, 6, *range(11, 17)):
            run.steps(1)
            assert run.robot.command().record["mode_machine"] == machine
        else:
            with pytest.raises(LinkError, match=f"machine {machine} .*machines 5, 6, 11, .*16 are commanded"):
                run.steps(1)
            assert run.robot.command() is None


@pytest.mark.parametrize("machine", [6, 12, 14, 16])
def test_a_locked_waist_is_not_turned_on(machine):
    run = Run(machine=machine)
    with pytest.raises(LinkError, match=r"waist_roll_joint and waist_pitch_joint.*`enabled` False at 13, 14"):
        run.steps(1)
    run.command = dataclasses.replace(STAND, enabled=np.arange(29) != 13)
    with pytest.raises(LinkError, match=r"turns on waist_pitch_joint, .*`enabled` False at 14"):
        run.steps(1)
    assert run.robot.command() is None


def test_nothing_is_sent_while_the_robot_counts_ankles_by_their_actuators():
    run = Run()
    run.record["mode_pr"] = 1
    with pytest.raises(LinkError, match="mode_pr 1 .*commands are of mode_pr 0"):
        run.steps(1)
    assert run.robot.command() is None
    run.record["mode_pr"] = 0
    run.steps(1)
    assert run.robot.command().sequence == 1


def test_a_closed_link_is_silent():
    run = Run()
    run.steps(3)
    for end in (run.link, run.robot):
        end.close()
        end.close()
    for call in (run.link.state, lambda: run.link.publish(STAND), run.robot.command):
        with pytest.raises(LinkError, match="closed"):
            call()


def test_lost_states_age_and_are_counted():
    run = Run(state_faults=[Faults(lost=0.2)], seed=1)
    counts = run.steps(1000)
    lost = 1000 - counts.taken
    assert 150 < lost < 250 and counts.missed == lost - trailing(run.ages) and max(run.ages) >= 2 * DT_S


def trailing(ages):
    """States missing at the very end, which nothing that came later shows."""
    return next(i for i, age in enumerate(reversed(ages)) if age == 0.0)


def test_age_counts_from_arrival_not_from_reading():
    run = Run(state_faults=[Faults(late=1.0, late_s=0.5, from_s=2.0)])
    run.robot.publish_state(run.record)
    run.clock.sleep(1.0)
    assert run.link.state().age_s == 1.0 and run.link.state().received_s == 0.0
    run.link.publish(STAND)
    run.clock.sleep(1.0)
    assert run.robot.command().age_s == 1.0
    run.record["tick"] += 1
    run.robot.publish_state(run.record)
    run.clock.sleep(1.0)
    assert run.link.state().age_s == 0.5 and run.link.state().received_s == 2.5


def test_over_dds_age_counts_from_the_read_before():
    clock, coming = SimulatedClock(3.0), []

    class Wire:
        def take(self):
            clock.sleep(0.25)  # what comes meanwhile is found by the next take
            taken, coming[:] = coming[:], []
            return taken

    arrivals = Arrivals(clock)
    clock.sleep(1.0)
    coming += [b"a", b"b"]
    assert arrivals.take(Wire()) == [(3.0, b"a"), (3.0, b"b")]
    clock.sleep(1.0)
    coming.append(b"c")
    assert arrivals.take(Wire()) == [(4.0, b"c")] and arrivals.take(Wire()) == []


def test_silence_is_age():
    run = Run(state_faults=[Faults(lost=1.0, from_s=0.1 - 1e-9)])
    run.steps(100)
    assert run.link.state().age_s == pytest.approx(0.2 - 0.1 + DT_S) and run.link.counts().taken == 50


def test_a_frozen_tick_ages_like_silence():
    run = Run(state_faults=[Faults(frozen_tick=True, from_s=0.1 - 1e-9)])
    counts = run.steps(100)
    # the first frozen state is new, its copies are not
    assert counts.taken == 51 and counts.repeats == 49 and not counts.refused
    assert run.link.state().age_s == pytest.approx(0.1)


@pytest.mark.parametrize(("fault", "reason"), [("bad_crc", "crc"), ("nan", "number")])
def test_damaged_states_are_dropped_and_age_like_silence(fault, reason):
    run = Run(state_faults=[Faults(**{fault: 1.0}, from_s=0.1 - 1e-9)])
    counts = run.steps(100)
    assert counts.refused == {reason: 50} and counts.taken == 50
    assert run.link.state().age_s == pytest.approx(0.1 + DT_S)


def test_doubled_states_count_once():
    counts = Run(state_faults=[Faults(doubled=1.0)]).steps(50)
    assert counts.taken == 50 and counts.repeats == 50 and counts.missed == 0


def test_late_states_arrive_later_and_never_turn_time_back():
    run = Run(state_faults=[Faults(late=0.3, late_s=3 * DT_S)], seed=2)
    counts = run.steps(500)
    assert counts.backwards > 50 and counts.taken + counts.backwards >= 497
    ticks = run.link.state().tick
    run.bus.put_state(seal(LOW_STATE, low_state(np.random.default_rng(0), tick=ticks - 1)))
    assert run.link.state().tick == ticks


def test_faults_repeat_by_seed_and_do_not_touch_each_other():
    def taken_at(seed, **faults):
        run = Run(state_faults=[Faults(**faults)], seed=seed)
        run.steps(300)
        return [age == 0.0 for age in run.ages]

    assert taken_at(1, lost=0.3) == taken_at(1, lost=0.3) != taken_at(2, lost=0.3)
    assert taken_at(1, lost=0.3) == taken_at(1, lost=0.3, doubled=0.5)


def test_damaged_commands_reach_no_motor():
    run = Run(command_faults=[Faults(bad_crc=0.3), Faults(nan=0.3)], seed=3)
    run.steps(300)
    counts = run.robot.counts()
    assert counts.refused["crc"] > 50 and counts.refused["number"] > 30
    assert counts.taken + sum(counts.refused.values()) == 300


def test_a_command_for_another_machine_is_dropped():
    run = Run(machine=6, command=LOCKED)
    run.steps(1)
    run.bus.put_command(STAND.message(mode_machine=5))
    assert run.robot.command().sequence == 1 and run.robot.counts().refused == {"mode": 1}


def test_states_of_another_machine_are_dropped():
    run = Run(machine=5)
    run.steps(5)
    run.bus.put_state(seal(LOW_STATE, low_state(np.random.default_rng(0), tick=10, machine=6)))
    assert run.link.state().mode_machine == 5 and run.link.counts().refused == {"mode": 1}


def test_another_version_is_counted():
    run = Run()
    run.steps(2)
    run.record["version"] = (1, 2)
    assert run.steps(2).version_changes == 1


def test_rubbish_raises_nothing(rng):
    run = Run()
    run.steps(10)
    for _ in range(500):
        rubbish = rng.bytes(int(rng.integers(0, 3000)))
        run.bus.put_state(rubbish)
        run.bus.put_command(rubbish)
    counts = run.steps(10)
    assert counts.taken == 20 and sum(counts.refused.values()) == 500
    assert run.robot.counts().taken == 20 and sum(run.robot.counts().refused.values()) == 500


def test_alone_on_the_network():
    run = Run()
    run.steps(3)
    check_sole_publisher(run.link, run.clock)
    assert run.link.counts().foreign_commands == 0


def test_a_second_publisher_is_noticed():
    run = Run()
    other = run.bus.link()
    run.steps(3)
    other.state()
    other.publish(STAND)
    check_sole_publisher(run.link, run.clock)  # what was before does not count

    class Busy:
        def sleep(self, seconds):
            run.clock.sleep(seconds)
            other.publish(STAND)
            other.publish(STAND)

    with pytest.raises(SecondPublisher, match="at least 2 commands in 0.5 s"):
        check_sole_publisher(run.link, Busy())
    assert run.link.counts().foreign_commands == 3 and other.counts().foreign_commands == 3


@pytest.mark.parametrize(
    "wrong",
    [
        dict(lost=1.1),
        dict(nan=-0.1),
        dict(late_s=-1.0),
        dict(lost=np.nan),
        dict(from_s=np.nan),
        dict(from_s=np.inf),
        dict(until_s=np.nan),
        dict(until_s="2"),
        dict(until_s=0.0),
        dict(from_s=2.0, until_s=1.0),
        dict(frozen_tick="no"),
        dict(frozen_tick=1),
    ],
)
def test_impossible_faults_are_refused(wrong):
    with pytest.raises(InvalidConfig, match=f"faults: .*{next(iter(wrong))}"):
        Faults(**wrong)


def test_a_command_has_no_tick_to_freeze():
    with pytest.raises(InvalidConfig, match="no tick"):
        MemoryBus(SimulatedClock(), command_faults=[Faults(frozen_tick=True)])
