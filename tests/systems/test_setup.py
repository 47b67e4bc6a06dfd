"""What is decided about a station before its diagram: all of it, once, and the station shows the same."""

from dataclasses import FrozenInstanceError, fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from hotice.control.pickup.footwork import Departure
from hotice.errors import InvalidConfig, MissingExtra
from hotice.model import Scene
from hotice.systems import Station, StationConfig, make_station
from hotice.systems.setup.setup import CONTROLLERS, PICKING, StationSetup

ATTRIBUTES = (
    *(
        "config",
        "plant_name",
        "controller_name",
        "motors",
        "torques",
        "scene",
        "world",
        "policy",
        "task",
        "physics_dt_s",
    ),
    *("carry", "pf", "pick", "put", "robot", "start_qpos"),
)
"""Names of the station that are used from outside; `walk_plan` beside."""


def test_a_station_shows_its_setup(station):
    assert {field.name for field in fields(StationSetup)} <= set(ATTRIBUTES)
    for name in ATTRIBUTES:
        assert np.all(getattr(station, name) == getattr(station.setup, name)), name
    assert station.robot is station.setup.robot and station.pick is None and station.world is station.scene
    setup = replace(station.setup)
    setup.__dict__["walk_plan"] = plan = object()
    assert Station(setup).walk_plan is plan


def test_a_setup_is_decided_once():
    setup = StationSetup.decide(StationConfig(scene="beam"))
    with pytest.raises(FrozenInstanceError):
        setup.torques = True
    torques = replace(setup, motors=True, torques=True)
    assert setup.robot is setup.robot and torques.robot is not setup.robot
    assert setup.model() is not setup.robot and (setup.model().actuator_biasprm == setup.robot.actuator_biasprm).all()
    assert not torques.model().actuator_biasprm.any() and (torques.model().actuator_gainprm[:, 0] == 1.0).all()


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("plant", ["mujoco", "drake"])
def test_who_commands_torques(plant, controller, monkeypatch):
    """Model-based controllers always; the policy's servo only in the Drake plant, and only where it is one."""
    monkeypatch.setattr("hotice.systems.setup.pick.plan_pick", lambda *_: PICKED)
    monkeypatch.setattr("hotice.systems.setup.departure.plan_departure", lambda *_: Departure())
    monkeypatch.setattr("hotice.systems.setup.put.plan_put", lambda *_: PICKED)
    picks, job = controller in PICKING, controller == "job"
    for servo in ("pd", "motor"):
        setup = StationSetup.decide(StationConfig(servo=servo), plant, controller)
        based = controller not in ("policy", "hold")
        assert setup.motors == (based or servo == "pd")
        assert setup.torques == (based or (servo == "pd" and plant == "drake"))
        assert [o.name for o in setup.world.obstacles] == ["support"] * picks + ["goal_support"] * job
        assert setup.pick is (PICKED if picks else None) and setup.put is (PICKED if job else None)
        trained = (plant, controller, servo) == ("mujoco", "policy", "motor")
        assert setup.physics_dt_s == (0.005 if based or trained else 0.002)


class Picked:
    carry = "the carry state at the end"
    controller = SimpleNamespace(planner=SimpleNamespace(above_m=0.05))
    qpos = np.arange(34.0)


PICKED = Picked()


def test_a_pick_up_starts_and_ends_the_setup(monkeypatch):
    monkeypatch.setattr("hotice.systems.setup.pick.plan_pick", lambda *_: PICKED)
    setup = StationSetup.decide(StationConfig(), controller="pickup")
    assert setup.carry is PICKED.carry and setup.start_qpos is PICKED.qpos
    plain = StationSetup.decide(StationConfig(scene=Scene("there", start=(0.5, -0.2, 1.0))))
    assert plain.start_qpos[:2] == pytest.approx([0.5, -0.2]) and plain.start_qpos[2] == plain.carry.root_pos_W[2]
    ahead = plain.start_qpos[27:29] - plain.start_qpos[:2]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(1.0, abs=1e-9)


def test_not_a_config():
    with pytest.raises(InvalidConfig, match="a StationConfig is needed"):
        StationSetup.decide("station.yaml")


@pytest.mark.parametrize("controller", ["walk", "pickup"])
def test_controllers_say_which_package_they_miss(controller, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pinocchio", None)
    with pytest.raises(MissingExtra, match=r"Pinocchio, which is not installed: pip install 'hotice\[drake\]'"):
        make_station(controller=controller)
