"""Stations with the controllers of `hotice.control`: steps of the whole, not the quality of a gait or a grasp."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.errors import CarryInfeasible, PickInfeasible
from hotice.model import Box
from hotice.systems import StationConfig, make_station, open_meshcat, read_logs
from hotice.systems.record.picture import wires

pytest.importorskip("pinocchio")
pytest.importorskip("hotice.control.pickup")
pytest.importorskip("hotice.control.walk")


def advance(station, seconds):
    simulator = Simulator(station)
    simulator.AdvanceTo(seconds)
    return read_logs(station, simulator.get_context())


def test_walk():
    meshcat = open_meshcat()
    station = make_station(StationConfig(log_hz=50.0), controller="walk", meshcat=meshcat)
    assert station.torques and station.physics_dt_s == 0.005
    assert meshcat.HasPath("station/footsteps/3")
    logs = advance(station, 2.0)
    state = logs["state_adaptor.robot_state"].value
    assert state[-1, 0] > 0.2 and state[:, 2].min() > 0.6 and state[-1, 38] > 0.6
    assert not logs["safety_monitor.faults"].value.any() and set(logs["walk.phase"].value[2:, 0]) <= {0.0, 1.0, 2.0}
    assert np.abs(logs["walk.torque"].value).max() > 20.0


@pytest.fixture(scope="module")
def picking():
    config = StationConfig(log_hz=50.0, pick_bearing_rad=1.2, carried=Box((0.28, 0.3, 0.28), 1.2))
    return make_station(config, controller="pickup_then_policy")


def test_pickup_before_it_begins(picking):
    """The robot stands before the table at its bearing, and nothing moves while it settles."""
    logs = advance(picking, 0.4)
    state = logs["state_adaptor.robot_state"].value
    table = picking.world.obstacles[-1]
    ahead = np.array([np.cos(1.2), np.sin(1.2)])
    assert table.name == "support" and (np.array(table.position_m[:2]) @ ahead) > 0.3
    assert state[0, 36:38] @ ahead > 0.3 and state[0, 38] == pytest.approx(0.6 + 0.14)
    np.testing.assert_allclose(state[-1, 36:39], state[0, 36:39], atol=5e-3)
    assert (logs["mode_selector.mode"].value == 0.0).all() and (logs["pickup.phase"].value[2:] == 0.0).all()
    np.testing.assert_array_equal(logs["mode_selector.torque"].value, logs["pickup.torque"].value)
    assert (logs["policy.action"].value == 0.0).all()  # rests until the object is held
    assert picking.scene.obstacles == () and len(picking.world.obstacles) == 1


def test_wiring_of_the_hand_over(picking):
    found = wires(picking)
    for wire in (
        ("pickup", "torque", "mode_selector", "pickup_torque"),
        ("joint_pd", "torque", "mode_selector", "carry_torque"),
        ("mode_selector", "carry_active", "policy", "active"),
        ("mode_selector", "walk_active", "walk", "active"),
        ("walk", "torque", "mode_selector", "walk_torque"),
        ("mode_selector", "torque", "safety_monitor", "command"),
    ):
        assert wire in found


@pytest.mark.parametrize("controller", ["pickup", "pickup_then_policy"])
@pytest.mark.parametrize(
    "change, error, message",
    [
        ({"support_height_m": 0.39}, PickInfeasible, "support_height_m 0.39 .* 0.39 m: allowed are 0.40 to 0.85 m"),
        ({"support_height_m": 0.86}, PickInfeasible, "support_height_m 0.86 .* 0.86 m: allowed are 0.40 to 0.85 m"),
        ({"support_near_m": 0.61}, PickInfeasible, "support_near_m 0.61: .* 0.15 to 0.60 m, stand nearer"),
        (
            {"support_near_m": 0.6, "carried": Box((0.4, 0.3, 0.3), 1.0)},
            PickInfeasible,
            "support_near_m 0.6: .* is violated",
        ),
        ({"carried": Box((0.3, 0.3, 0.3), 30.0)}, CarryInfeasible, "too heavy"),
    ],
)
def test_what_cannot_be_picked_up(change, error, message, controller):
    """Is told when the station is made: too low, too high, too far, out of reach within what is allowed, too heavy."""
    with pytest.raises(error, match=message):
        make_station(StationConfig(**change), controller=controller)
