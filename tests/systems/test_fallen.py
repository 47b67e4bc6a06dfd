"""A robot that is pushed over in a station lies on the floor, in either plant."""

import mujoco
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.model import builder
from hotice.systems import StationConfig, make_station

PUSHES = ((3.0, 0.0), (-3.0, 0.0), (1.0, 3.0))


def lowest(qpos):
    """Lowest point of the robot of 20 joints at a configuration (34,) over the floor [m], and where it is."""
    model = builder.robot_spec(20).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = qpos[:27]
    mujoco.mj_kinematics(model, data)
    low, where = np.inf, ""
    for i in range(model.ngeom):
        up, size = data.geom_xmat[i].reshape(3, 3)[2], model.geom_size[i]
        if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_BOX:
            reach = np.abs(up) @ size
        else:
            along = size[1] if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
            reach = size[0] + abs(up[2]) * along
        if data.geom_xpos[i, 2] - reach < low:
            low, where = data.geom_xpos[i, 2] - reach, model.geom(i).name
    return low, where


@pytest.mark.parametrize("push", PUSHES)
def test_it_lies_on_the_floor(push):
    station = make_station(StationConfig(servo="pd"), controller="hold")
    simulator = Simulator(station)
    plant = station.GetSubsystemByName("plant")
    context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    qvel = np.zeros(plant.nv)
    qvel[:2] = push
    plant.set_state(context, station.start_qpos, qvel)
    simulator.AdvanceTo(4.0)
    qpos = plant.GetOutputPort("state").Eval(context)[: plant.nq]
    assert qpos[2] < 0.45, "it is down"
    low, where = lowest(qpos)
    # a damped robot leans on its ankle, deeper than a stiff one
    assert low > -0.025, where


@pytest.mark.slow
def test_it_lies_on_the_floor_of_drake():
    station = make_station(StationConfig(servo="pd"), plant="drake", controller="hold")
    simulator = Simulator(station)
    plant = station.GetSubsystemByName("plant")
    root = simulator.get_mutable_context()
    context = plant.plant.GetMyMutableContextFromRoot(root)
    v = plant.plant.GetVelocities(context)
    body = plant.plant.GetBodyByName("pelvis")
    v[body.floating_velocities_start_in_v() + 3] = -3.0  # world x, after the angular part
    plant.plant.SetVelocities(context, v)
    simulator.AdvanceTo(3.0)
    adaptor = station.GetSubsystemByName("state_adaptor")
    state = adaptor.GetOutputPort("robot_state").Eval(adaptor.GetMyContextFromRoot(root))
    legs, arms = state[7:19], np.concatenate([state[22:26], state[29:33]])
    assert state[2] < 0.45, "it is down"
    low, where = lowest(np.concatenate([state[:7], legs, arms]))
    assert low > -0.02, where
