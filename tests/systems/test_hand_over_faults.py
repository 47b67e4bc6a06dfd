"""Faults at the moment of a hand-over: it waits until all is well, or what follows is answered as any fault is."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

pytest.importorskip("pinocchio")

from hotice.model.robot_state import RobotState
from hotice.safety import Answer, Fault
from hotice.systems import InjectedFault, StationConfig, lost_box
from hotice.systems.hand_over.mode_selector import CARRY, HOLD, PICKUP, WALK, HandOver, ModeSelector
from hotice.systems.hand_over.rehearsal import Rehearsal
from hotice.systems.hand_over.sound import sound
from hotice.systems.hand_over.stage import VERDICTS
from hotice.systems.hand_over.walk_rehearsal import WalkRehearsal
from hotice.systems.setup.setup import StationSetup
from hotice.systems.signals import JOINT_POS, JOINT_VEL, OBJECT_POS, OBJECT_QUAT, ROOT_VEL
from hotice.systems.station.make import Station

IN_HANDS = np.array([0.0, 0, 180, 0, 0, 180, 0, 40, 0, 0, -40, 0])
ELSEWHERE = ("percept", "stamps", "robot_state", "tick", "command")


@pytest.fixture
def standing(carry):
    qpos, qvel = RobotState.from_carry(carry).to_mujoco(29)
    return np.concatenate([qpos, qvel])


def changed(state, index, value):
    out = state.copy()
    out[index] = value
    return out


class Selected:
    """A selector of a robot that holds its object, and whose rehearsals say what they are told."""

    def __init__(self, state, rehearse, rehearse_walk=None):
        rule = HandOver(ready_phase=8, settle_s=0.1, blend_s=0.0)
        self.system = ModeSelector(rule, 0.02, rehearse, rehearse_walk)
        self.simulator, self.k = Simulator(self.system), 0
        for name in ("pickup", "carry", "walk"):
            self.set(f"{name}_torque", np.zeros(20))
        self.set("phase", [8.0])
        self.set("contact_force", IN_HANDS)
        self.set("robot_state", state)

    def set(self, name, value):
        self.system.GetInputPort(name).FixValue(self.simulator.get_mutable_context(), value)

    def go(self, steps, **inputs):
        for name, value in inputs.items():
            self.set(name, value)
        self.k += steps
        self.simulator.AdvanceTo(0.02 * self.k - 0.01)
        return self.system.GetOutputPort("mode").Eval(self.simulator.get_context())[0]


def test_a_sound_state(standing):
    assert sound(standing)


@pytest.mark.parametrize(
    "index, value",
    [
        (JOINT_POS[3], np.nan),
        (JOINT_POS[3], 6.0),
        (JOINT_VEL[3], 1e6),
        (ROOT_VEL.start, 1e6),
        (slice(3, 7), 0.0),
        (2, -0.3),
        (2, 0.2),
        (OBJECT_POS, np.nan),
        (OBJECT_POS.start, 1e6),
        (OBJECT_QUAT, 0.0),
    ],
)
def test_nothing_is_handed_over_in_a_state_that_cannot_be(standing, index, value):
    """One such sample would decide for good; the robot is ready anew when it has been well for a while."""
    bad, tried = changed(standing, index, value), []
    assert not sound(bad)
    selected = Selected(standing, lambda state: tried.append(state.copy()) or 0)
    assert selected.go(5) == PICKUP
    assert selected.go(3, robot_state=bad) == PICKUP and not tried
    assert selected.go(5, robot_state=standing) == PICKUP and not tried
    assert selected.go(2) == CARRY and len(tried) == 1 and (tried[0] == standing).all()


@pytest.mark.parametrize("answer", [Answer.PASS, Answer.STOP_WALKING, Answer.DAMP])
def test_nothing_is_handed_over_while_there_is_a_fault(standing, answer):
    selected = Selected(standing, lambda state: 0)
    assert selected.go(20, answer=[float(answer), float(Fault.BOX_LATE)]) == PICKUP
    assert selected.go(5, answer=[0.0, 0.0]) == PICKUP and selected.go(3) == CARRY


@pytest.mark.parametrize("error", [RuntimeError("no\nmemory"), ValueError("singular"), ZeroDivisionError("by zero")])
def test_a_rehearsal_that_gives_up_is_a_verdict(standing, error):
    def gives_up(state):
        raise error

    for rehearse_walk, mode in ((lambda state: 0, WALK), (gives_up, HOLD)):
        selected = Selected(standing, gives_up, rehearse_walk)
        assert selected.go(10) == mode
        context = selected.simulator.get_context()
        assert VERDICTS[int(selected.system.GetOutputPort("verdict").Eval(context)[0])] == "gave_up"
        assert selected.system.message(context) == f"{type(error).__name__}: {' '.join(str(error).split())}"


def test_a_defect_in_a_rehearsal_ends_the_simulation(standing):
    with pytest.raises(TypeError):
        Selected(standing, lambda state: len(3)).go(10)


class Ready:
    """A pick-up shortly before its hand-over, from where stations with faults go on."""

    def __init__(self):
        config = StationConfig(scene="open_floor")
        self.setup = StationSetup.decide(config, "mujoco", "pickup_then_policy")
        station = Station(self.setup, faults=self.every())
        simulator, last = Simulator(station), []
        while not last or not value(station, simulator, "mode_selector", "mode")[0]:
            last = [*last[-20:], simulator.get_context().Clone()]
            simulator.AdvanceTo(0.02 * round(last[-1].get_time() / 0.02 + 1))
            assert simulator.get_context().get_time() < 40.0
        self.before, self.at_s = last[0], last[-1].get_time()
        assert not value(station, simulator, "safety_monitor", "faults").any()

    def every(self, faults=()):
        """One fault of each signal: then all of these stations have the same state."""
        given = {fault.signal: fault for fault in faults}
        return [given.get(signal, InjectedFault(signal=signal, from_s=1e3)) for signal in ELSEWHERE]

    def go_on(self, faults, seconds):
        station = Station(self.setup, faults=self.every(faults))
        simulator = Simulator(station)
        simulator.get_mutable_context().SetTimeStateAndParametersFrom(self.before)
        simulator.Initialize()
        simulator.AdvanceTo(self.at_s + seconds)
        return station, simulator


def value(station, simulator, system, port):
    system = station.GetSubsystemByName(system)
    return system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(simulator.get_context())).copy()


@pytest.fixture(scope="module")
def ready():
    return Ready()


def upright(state):
    return 1.0 - 2.0 * (state[4] ** 2 + state[5] ** 2) > 0.9 and state[2] > 0.65 and state[38] > 0.6


CASES = {
    "nothing": (lambda at: [], 0.3, CARRY),
    "a NaN joint for a moment": (lambda at: [of("robot_state", (10,), at - 0.03, at + 0.01)], 1.0, CARRY),
    "an encoder off by 3 rad": (lambda at: [of("robot_state", (10,), at - 0.03, at + 0.01, "add", 3.0)], 1.0, CARRY),
    "the object nowhere": (lambda at: [of("robot_state", (36, 37, 38), at - 0.05, at + 0.03)], 1.0, CARRY),
    "a lost box": (lambda at: lost_box(at - 0.3), 1.0, PICKUP),
    "a box lost for a second": (lambda at: lost_box(at - 0.3, at + 0.7), 1.6, CARRY),
    "a box lost as it is handed over": (lambda at: lost_box(at), 1.5, CARRY),
    "a heading that jumps": (lambda at: [of("percept", (3,), at - 0.1, np.inf, "add", 3.0)], 1.0, PICKUP),
    "NaN percepts from the hand-over on": (lambda at: [of("percept", None, at + 0.01, np.inf)], 0.6, CARRY),
    "a NaN command in the blend": (lambda at: [of("command", None, at + 0.03, at + 0.07)], 1.0, CARRY),
}


def of(signal, index, from_s, until_s, kind="value", amount=np.nan):
    return InjectedFault(signal=signal, index=index, kind=kind, value=amount, from_s=from_s, until_s=until_s)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_a_fault_at_the_hand_over(ready, name):
    """The object stays in the hands of a robot that stands or walks upright."""
    faults, seconds, mode = CASES[name]
    station, simulator = ready.go_on(faults(ready.at_s), seconds)
    assert value(station, simulator, "mode_selector", "mode")[0] == mode
    assert value(station, simulator, "safety_monitor", "faults").any() == (name != "nothing")
    assert value(station, simulator, "safety_monitor", "answer")[0] < Answer.DAMP
    assert upright(value(station, simulator, "state_adaptor", "robot_state"))


@pytest.mark.slow
def test_old_states_at_the_hand_over_are_damped_and_nothing_flies(ready):
    """Arms that hold by torques of a state 60 ms old swung until the physics diverged."""
    late = [of(s, None, ready.at_s - 0.1, np.inf, "late", 0.06) for s in ("robot_state", "tick")]
    station, simulator = ready.go_on(late, 1.0)
    assert value(station, simulator, "mode_selector", "mode")[0] == PICKUP
    assert value(station, simulator, "safety_monitor", "answer").tolist() == [Answer.DAMP, Fault.STATE_LATE]
    assert np.abs(value(station, simulator, "state_adaptor", "robot_state")[JOINT_VEL]).max() < 40.0


@pytest.mark.slow
def test_a_policy_that_fails_in_its_rehearsal_does_not_take_over(ready, monkeypatch):
    def raises(self, state):
        raise RuntimeError("out of memory")

    monkeypatch.setattr(Rehearsal, "__call__", raises)
    monkeypatch.setattr(WalkRehearsal, "__call__", lambda self, state: 0)
    station, simulator = ready.go_on([], 0.5)
    assert value(station, simulator, "mode_selector", "mode")[0] == WALK
    assert VERDICTS[int(value(station, simulator, "mode_selector", "verdict")[0])] == "gave_up"
    assert upright(value(station, simulator, "state_adaptor", "robot_state"))
