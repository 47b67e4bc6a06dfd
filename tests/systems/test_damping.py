"""Motors that only damp, in either plant: kp 0, kd 8, implicitly, whatever they are told; no others."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.model import g1
from hotice.safety import DAMPING_KD
from hotice.systems import StationConfig
from hotice.systems.drake_plant import DrakePlant
from hotice.systems.mujoco_plant import MujocoPlant
from hotice.systems.setup.setup import StationSetup

HIGH_M = 2.0
"""Nothing is touched up there."""
SPEED_RAD_S = 2.0
LEGS = np.arange(g1.ACTIONS) < 12


def flying(plant, servo, damped, seconds=0.06, stop_s=np.inf):
    """Joint speeds (T, 20) every 10 ms of a robot in the air whose joints turn at 2 rad/s, and the last net torques.

    Commands are 100 N m, or targets a radian away. From `stop_s` on no joint is damped.
    """
    setup = StationSetup.decide(StationConfig(servo="motor" if servo else "pd"), plant, "hold")
    qpos = setup.start_qpos.copy()
    qpos[[2, 29]] += HIGH_M
    if plant == "drake":
        system = DrakePlant(setup.world, setup.carry.carried, setup.carry.wrist_pos, qpos, 0.002, servo)
    else:
        model = setup.model()
        system = MujocoPlant(model, qpos, np.zeros(model.nu))
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    if plant == "drake":
        mine = system.plant.GetMyMutableContextFromRoot(context)
        v = system.plant.GetVelocities(mine)
        places = system.index[40:60] - system.plant.num_positions()
        v[places] = SPEED_RAD_S
        system.plant.SetVelocities(mine, v)
    else:
        qvel = np.zeros(system.nv)
        qvel[g1.JOINT_VEL] = SPEED_RAD_S
        system.set_state(context, qpos, qvel)
    target = qpos[g1.JOINT_POS] + 1.0 if servo else np.full(20, 100.0)
    system.GetInputPort("actuation").FixValue(context, target)
    system.GetInputPort("damped").FixValue(context, damped.astype(float))
    speeds, time_s = [], 0.0
    while time_s < seconds - 1e-9:
        if time_s >= stop_s - 1e-9:
            system.GetInputPort("damped").FixValue(context, np.zeros(20))
        time_s += 0.01
        simulator.AdvanceTo(time_s)
        if plant == "drake":
            speeds.append(system.plant.GetVelocities(mine)[places])
        else:
            speeds.append(system.GetOutputPort("state").Eval(context)[system.nq :][g1.JOINT_VEL])
    return np.abs(np.array(speeds)), system, simulator


@pytest.mark.parametrize("plant, servo", [("mujoco", True), ("drake", True), ("drake", False)])
def test_joint_speeds_fall_whatever_is_commanded(plant, servo):
    speeds, *_ = flying(plant, servo, np.ones(20))
    assert (np.diff(speeds.max(axis=1)) < 1e-3).all() and speeds[-1].max() < 0.5 * SPEED_RAD_S
    commanded, *_ = flying(plant, servo, np.zeros(20))
    assert commanded.max() > 2.0 * SPEED_RAD_S


def test_dampers_of_drake_are_those_of_mujoco():
    one, other = (flying(plant, True, np.ones(20))[0] for plant in ("mujoco", "drake"))
    np.testing.assert_allclose(one[:, LEGS], other[:, LEGS], atol=0.15)


@pytest.mark.parametrize("servo", [True, False])
def test_only_some_joints_damp_and_gains_come_back(servo):
    speeds, system, simulator = flying("drake", servo, LEGS)
    assert speeds[-1, LEGS].max() < 0.5 * speeds[-1, ~LEGS].max() and speeds[:, ~LEGS].max() > 2.0 * SPEED_RAD_S
    plant = system.plant
    actuators = [plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()]
    gains = [a.get_controller_gains() if a.has_controller() else None for a in actuators]
    assert all(g.p == 0.0 and g.d == DAMPING_KD for g in gains[:12])
    _, system, _ = flying("drake", servo, LEGS, stop_s=0.03)
    actuators = [system.plant.get_joint_actuator(i) for i in system.plant.GetJointActuatorIndices()]
    if servo:
        expected = list(zip(*g1.gains(), strict=True))
        assert [(a.get_controller_gains().p, a.get_controller_gains().d) for a in actuators] == expected
    else:
        assert not any(a.has_controller() for a in actuators)


def test_two_robots_of_one_drake_plant_are_damped_apart():
    """Gains lie in the plant, which contexts share: each step has those of its own context."""
    _, system, simulator = flying("drake", True, np.ones(20), 0.01)
    damped = simulator.get_context().Clone()
    free = damped.Clone()
    system.GetInputPort("damped").FixValue(free, np.zeros(20))
    alone = {}
    for name, context in (("damped", damped), ("free", free)):
        own = Simulator(system, context.Clone())
        own.AdvanceTo(0.05)
        alone[name] = system.GetOutputPort("state").Eval(own.get_context()).copy()
    both = {name: Simulator(system, c) for name, c in (("damped", damped), ("free", free))}
    for k in range(2, 6):
        for simulator in both.values():
            simulator.AdvanceTo(0.01 * k)
            system.GetOutputPort("contact_force").Eval(simulator.get_context())
    for name, simulator in both.items():
        np.testing.assert_array_equal(system.GetOutputPort("state").Eval(simulator.get_context()), alone[name])
    assert np.abs(alone["damped"] - alone["free"]).max() > 0.1
