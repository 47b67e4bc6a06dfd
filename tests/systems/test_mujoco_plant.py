import copy

import mujoco
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidStation, SimulationError
from hotice.model import builder
from hotice.model.motors import motor_strength, to_motors
from hotice.systems.mujoco_plant import STATE, MujocoPlant
from hotice.systems.signals import TOUCHING_BODIES


@pytest.fixture(scope="module")
def model(carry):
    return builder.build_model(carry.carried, wrist_pos=carry.wrist_pos)


def flat(model, data):
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


@pytest.mark.parametrize("hold", [1, 4])
def test_bitwise_plain_mujoco(model, carry, rng, hold):
    plant = MujocoPlant(model, carry.qpos(), carry.joint_target, hold * model.opt.timestep)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = carry.qpos(), carry.joint_target
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    for k in range(25):
        target = carry.joint_target + 0.1 * rng.standard_normal(20)
        plant.GetInputPort("actuation").FixValue(context, target)
        simulator.AdvanceTo((k + 1) * hold * model.opt.timestep - 1e-6)
        data.ctrl[:] = target
        for _ in range(hold):
            mujoco.mj_step(model, data)
        np.testing.assert_array_equal(plant.GetOutputPort("full_state").Eval(context), flat(model, data))
    state = plant.GetOutputPort("state").Eval(context)
    np.testing.assert_array_equal(state, np.concatenate([data.qpos, data.qvel]))
    assert np.abs(data.qvel).max() > 0.1


def test_a_cloned_context_replays_identically(station):
    simulator = Simulator(station)
    simulator.AdvanceTo(0.3)
    twin = Simulator(station, simulator.get_context().Clone())
    plant = station.GetSubsystemByName("plant")

    def state(sim):
        return plant.GetOutputPort("full_state").Eval(plant.GetMyContextFromRoot(sim.get_context())).copy()

    ends = []
    for sim in (simulator, twin):
        sim.AdvanceTo(0.5)
        ends.append(state(sim))
    np.testing.assert_array_equal(*ends)
    for k in range(3):  # in turns: the scratch data serves both
        for sim in (twin, simulator):
            sim.AdvanceTo(0.52 + 0.02 * k)
        np.testing.assert_array_equal(state(simulator), state(twin))
    assert not np.array_equal(ends[0], state(simulator))


def test_contact_forces(model, carry, run):
    plant = MujocoPlant(model, carry.qpos(), carry.joint_target)
    simulator = Simulator(plant)
    plant.GetInputPort("actuation").FixValue(simulator.get_mutable_context(), carry.joint_target)
    simulator.AdvanceTo(0.5)
    force = plant.GetOutputPort("contact_force").Eval(simulator.get_context()).reshape(4, 3)
    weight = 9.81 * model.body_mass.sum()
    assert force[:2, 2].sum() == pytest.approx(weight, rel=0.1)  # the floor carries robot and object
    assert force[2:, 2].sum() == pytest.approx(-9.81 * carry.carried.mass_kg, rel=0.3)  # the object hangs on the hands
    assert force[2, 1] > 5.0 and force[3, 1] < -5.0  # pressed outwards: left to +y, right to -y
    assert TOUCHING_BODIES[0].startswith("left_ankle") and TOUCHING_BODIES[3].startswith("right_wrist")


def test_motors_take_torques(model, carry):
    motors = copy.copy(model)
    to_motors(motors)
    data = mujoco.MjData(motors)
    data.qpos[:] = carry.qpos()
    data.ctrl[:] = np.linspace(-200, 200, 20)
    mujoco.mj_forward(motors, data)
    limit = model.actuator_forcerange[:, 1]
    np.testing.assert_allclose(data.actuator_force, np.clip(data.ctrl, -limit, limit))
    assert not motors.actuator_biasprm.any() and (motor_strength(motors) == 1.0).all()


def test_drawn_motors_keep_their_strength(model):
    """Unless another is asked for; limits stay those of the drawn motors."""
    drawn = copy.copy(model)
    drawn.actuator_forcerange[:] *= np.linspace(0.8, 1.2, 20)[:, None]
    np.testing.assert_allclose(motor_strength(drawn), np.linspace(0.8, 1.2, 20))
    for strength, gain in ((None, motor_strength(drawn)), (1.0, 1.0)):
        motors = copy.copy(drawn)
        to_motors(motors, strength)
        assert (motors.actuator_gainprm[:, 0] == gain).all()
        np.testing.assert_array_equal(motors.actuator_forcerange, drawn.actuator_forcerange)


def test_setting_a_state(model, carry, rng):
    plant = MujocoPlant(model, carry.qpos(), carry.joint_target)
    context = plant.CreateDefaultContext()
    qvel = rng.standard_normal(model.nv)
    plant.set_state(context, carry.qpos(), qvel)
    np.testing.assert_array_equal(plant.GetOutputPort("state").Eval(context)[model.nq :], qvel)
    with pytest.raises(InvalidStation, match=r"qvel has shape \(3,\): this model needs \(32,\)"):
        plant.set_state(context, carry.qpos(), np.zeros(3))
    with pytest.raises(InvalidStation, match="period_s"):
        MujocoPlant(model, carry.qpos(), carry.joint_target, 0.0001)


def test_diverged_physics_is_reported(model, carry):
    plant = MujocoPlant(model, carry.qpos(), carry.joint_target)
    simulator = Simulator(plant)
    plant.GetInputPort("actuation").FixValue(simulator.get_mutable_context(), np.full(20, np.nan))
    with pytest.raises(SimulationError, match="physics diverged at 0.000 s"):
        simulator.AdvanceTo(0.1)


def test_a_servo_in_the_plant_is_one_around_it(model, carry, rng):
    """Bit for bit, over several time steps of one actuation; and a station with it holds the object."""
    from hotice.systems.joint_pd import JointServo, pd_torque

    motors, servo = copy.copy(model), JointServo.of_g1()
    to_motors(motors)
    plant = MujocoPlant(motors, carry.qpos(), np.zeros(20), 4 * model.opt.timestep, servo)
    simulator, data = Simulator(plant), mujoco.MjData(motors)
    data.qpos[:] = carry.qpos()
    context = simulator.get_mutable_context()
    for k in range(10):
        target = carry.joint_target + 0.05 * rng.standard_normal(20)
        plant.GetInputPort("actuation").FixValue(context, target)
        simulator.AdvanceTo((k + 1) * 4 * model.opt.timestep - 1e-6)
        for _ in range(4):
            torque = pd_torque(target, data.qpos[7:27], data.qvel[6:26], servo.kp, servo.kd, servo.limit)
            data.ctrl[:] = torque
            mujoco.mj_step(motors, data)
        np.testing.assert_array_equal(plant.GetOutputPort("full_state").Eval(context), flat(motors, data))
    assert np.abs(data.qvel).max() > 0.1


def test_contexts_of_one_plant_do_not_damp_each_other(model, carry):
    """Also where the input is open: the model, which holds the motors, is shared."""
    plant = MujocoPlant(copy.copy(model), carry.qpos(), carry.joint_target)
    free, damped = Simulator(plant), Simulator(plant)
    for simulator in (free, damped):
        plant.GetInputPort("actuation").FixValue(simulator.get_mutable_context(), carry.joint_target)
        simulator.AdvanceTo(0.3)

    def force(simulator):
        context = simulator.get_context().Clone()  # nothing cached
        return plant.GetOutputPort("contact_force").Eval(context).copy()

    expected = force(free)
    plant.GetInputPort("damped").FixValue(damped.get_mutable_context(), np.ones(plant.nu))
    damped.AdvanceTo(0.301)
    limp = force(damped)
    np.testing.assert_array_equal(force(free), expected)
    assert np.abs(limp - expected).max() > 1.0
    twin = Simulator(MujocoPlant(copy.copy(model), carry.qpos(), carry.joint_target))
    twin.get_system().GetInputPort("actuation").FixValue(twin.get_mutable_context(), carry.joint_target)
    for simulator in (twin, free):
        simulator.AdvanceTo(0.31)
    states = [s.get_context().get_discrete_state_vector().value() for s in (free, twin)]
    np.testing.assert_array_equal(*states)
