"""However a simulation is begun, begun again, stepped and looked at, a station goes the same way."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.safety import Answer, Fault
from hotice.systems import InjectedFault, StationConfig
from hotice.systems.setup.setup import StationSetup
from hotice.systems.station.make import Station
from hotice.task.sensing import STUDENT_SENSING

END_S = 0.5
KINDS = [("mujoco", "policy"), ("drake", "policy"), ("mujoco", "walk"), ("mujoco", "pickup"), ("mujoco", "hold")]


@pytest.fixture(scope="module", params=KINDS, ids=" ".join)
def station(request):
    plant, controller = request.param
    if controller in ("walk", "pickup"):
        pytest.importorskip("pinocchio")
    pushed = {"push_m_s": 0.5} if plant == "mujoco" else {}
    config = StationConfig(scene="open_floor", sensing=STUDENT_SENSING, seed=1, **pushed)
    # it comes after the end of most of these runs
    fault = InjectedFault(signal="command", from_s=0.6, until_s=0.7)
    return Station(StationSetup.decide(config, plant, controller), faults=[fault])


@pytest.fixture(scope="module")
def end(station):
    simulator = Simulator(station)
    simulator.AdvanceTo(END_S)
    return state(station, simulator)


def port(station, simulator, system, name):
    system = station.GetSubsystemByName(system)
    return system.GetOutputPort(name).Eval(system.GetMyContextFromRoot(simulator.get_context())).copy()


def state(station, simulator):
    return port(station, simulator, "state_adaptor", "robot_state")


def at_once(station, rng):
    return Simulator(station)


def in_odd_steps(station, rng):
    simulator, time_s = Simulator(station), 0.0
    while (time_s := time_s + rng.uniform(0.0, 0.013)) < END_S:
        simulator.AdvanceTo(time_s)
    return simulator


def tick_by_tick(station, rng):
    simulator = Simulator(station)
    for k in range(round(END_S / 0.02)):
        simulator.AdvanceTo(0.02 * k)
    return simulator


def initialized_again_and_again(station, rng):
    simulator = Simulator(station)
    simulator.Initialize()
    for time_s in (0.2, 0.23):
        simulator.Initialize()
        simulator.AdvanceTo(time_s)
        simulator.Initialize()
    return simulator


def looked_at_all_the_time(station, rng):
    simulator = Simulator(station)
    for k in range(round(END_S / 0.01)):
        simulator.AdvanceTo(0.01 * k)
        for system in station.GetSystems():
            context = system.GetMyContextFromRoot(simulator.get_context())
            for i in range(system.num_output_ports()):
                system.get_output_port(i).Eval(context)
    return simulator


def beside_another(station, rng):
    simulator, other = Simulator(station), Simulator(station)
    for k in range(round(END_S / 0.02)):
        simulator.AdvanceTo(0.02 * k)
        other.AdvanceTo(0.013 * k)
    return simulator


def set_back_to_its_start(station, rng):
    simulator = Simulator(station)
    simulator.AdvanceTo(0.3)
    context = simulator.get_mutable_context()
    context.SetTime(0.0)
    station.SetDefaultContext(context)
    simulator.Initialize()
    return simulator


def with_a_new_context(station, rng):
    simulator = Simulator(station)
    simulator.AdvanceTo(0.3)
    simulator.reset_context(station.CreateDefaultContext())
    simulator.Initialize()
    return simulator


def set_back_after_a_fault(station, rng):
    """Nothing is left of it: damping is final until then."""
    simulator = Simulator(station)
    simulator.AdvanceTo(0.9)
    assert port(station, simulator, "safety_monitor", "faults")[Fault.COMMAND_NOT_FINITE] == 5
    context = simulator.get_mutable_context()
    context.SetTime(0.0)
    station.SetDefaultContext(context)
    simulator.Initialize()
    return simulator


WAYS = (
    at_once,
    in_odd_steps,
    tick_by_tick,
    initialized_again_and_again,
    looked_at_all_the_time,
    beside_another,
    set_back_to_its_start,
    with_a_new_context,
    set_back_after_a_fault,
)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
def test_every_way_ends_the_same(station, end, way, rng):
    simulator = way(station, rng)
    simulator.AdvanceTo(END_S)
    np.testing.assert_array_equal(state(station, simulator), end)
    assert not port(station, simulator, "safety_monitor", "faults").any()


@pytest.mark.parametrize("begin_s", [7.0, 7.013])
def test_a_simulation_may_begin_at_any_time(station, end, begin_s):
    """The plant's own clock begins there too: nothing is late. (Times of events are rounded otherwise.)"""
    simulator = Simulator(station)
    simulator.get_mutable_context().SetTime(begin_s)
    simulator.Initialize()
    simulator.AdvanceTo(begin_s + END_S)
    assert not port(station, simulator, "safety_monitor", "faults").any()
    if begin_s == 7.0 and not station.config.push_m_s:
        np.testing.assert_allclose(state(station, simulator), end, atol=1e-6)
    assert state(station, simulator)[2] > 0.65


def test_a_clock_that_is_set_back_alone_is_no_fault_of_the_robot(station):
    """At most one check is without a new command."""
    simulator = Simulator(station)
    simulator.AdvanceTo(END_S)
    simulator.get_mutable_context().SetTime(0.0)
    simulator.Initialize()
    simulator.AdvanceTo(END_S)
    counts = port(station, simulator, "safety_monitor", "faults")
    assert counts.sum() <= 2 and counts[Fault.COMMAND_LATE] <= 1
    assert port(station, simulator, "safety_monitor", "answer")[0] == Answer.PASS
    assert state(station, simulator)[2] > 0.65
