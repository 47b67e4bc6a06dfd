import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator

from hotice.errors import InvalidConfig, InvalidStation, NotAvailable
from hotice.model.dynamics import STUDENT_DYNAMICS, DynamicsConfig, joint_offset
from hotice.systems import StationConfig, make_station
from hotice.systems.joint_pd import JointPd, JointServo
from hotice.systems.pushes import Pushes, draw_push
from hotice.systems.sensor_model import _SEED

YAML = {"sensing": "student", "dynamics": "student", "push_m_s": 1.0, "push_interval_s": 0.2}


def config(seed=3, **changes):
    return StationConfig.from_dict({**YAML, "seed": seed, **changes})


def state(station, simulator):
    plant = station.GetSubsystemByName("plant")
    return plant.GetOutputPort("full_state").Eval(plant.GetMyContextFromRoot(simulator.get_context())).copy()


@pytest.fixture(scope="module")
def perturbed():
    return make_station(config())


def test_pushes_are_the_evaluations():
    pushes = np.array([draw_push(0.5, 0.1, 7, k) for k in range(20_000)])
    size = np.linalg.norm(pushes, axis=1)
    assert (size > 0).mean() == pytest.approx(0.1, abs=0.01) and size.max() <= 0.5
    assert (
        size[size > 0].min() >= 0.05
        and size[size > 0].mean() == pytest.approx(0.275, abs=0.01)
        and np.abs(pushes.mean(axis=0)).max() < 0.003
    )
    np.testing.assert_array_equal(draw_push(0.5, 1.0, 7, 3), draw_push(0.5, 1.0, 7, 3))
    assert (draw_push(0.5, 1.0, 7, 3) != draw_push(0.5, 1.0, 8, 3)).all()
    with pytest.raises(InvalidStation, match="interval_s is 0.01: .* of at least 0.02 s is needed .the control period"):
        Pushes(1.0, 0.01, 0.02)


def test_the_pelvis_feels_each_push_once():
    """Velocity at the start of a control step, with and without its push, under motors' servos and under torques."""
    for servo in ("motor", "pd"):
        values = []
        for push in (0.0, 1.0):
            station = make_station(
                StationConfig(push_m_s=push, push_interval_s=0.1, seed=1, servo=servo), controller="hold"
            )
            simulator = Simulator(station)
            first = next(k for k in range(100) if draw_push(1.0, 0.2, 1, k).any())
            simulator.AdvanceTo(0.02 * (first + 1) - 1e-6)
            plant = station.GetSubsystemByName("plant")
            values.append(plant.GetOutputPort("state").Eval(plant.GetMyContextFromRoot(simulator.get_context()))[34:36])
        change, wanted = values[1] - values[0], draw_push(1.0, 0.2, 1, first)
        assert change @ wanted > 0.2 * wanted @ wanted  # feet and legs take their share within the step
        assert np.linalg.norm(change) < 1.1 * np.linalg.norm(wanted)


def test_a_seed_and_a_cloned_context_replay_identically(perturbed):
    first, again = Simulator(perturbed), Simulator(make_station(config()))
    for simulator in (first, again):
        simulator.AdvanceTo(0.3)
    clone = Simulator(perturbed, first.get_context().Clone())
    for simulator in (first, again, clone):
        simulator.AdvanceTo(0.5)
    ends = [state(perturbed, s) for s in (first, clone)] + [state(again.get_system(), again)]
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[2])
    other = make_station(config(seed=4))
    simulator = Simulator(other)
    simulator.AdvanceTo(0.3)
    assert (state(other, simulator)[1:4] != state(perturbed, first)[1:4]).all()


def test_a_random_context_draws_noise_and_pushes_from_the_generator(perturbed):
    """At the station's start, with the robot of its own seed; equal generators replay identically."""

    def run(number, begin_s=0.0):
        simulator = Simulator(perturbed)
        simulator.AdvanceTo(begin_s)
        context = simulator.get_mutable_context()
        perturbed.SetRandomContext(context, RandomGenerator(number))
        start = state(perturbed, simulator)
        context.SetTime(0.0)
        simulator.Initialize()
        simulator.AdvanceTo(0.3)
        return start, state(perturbed, simulator), context

    (start, one, context), (again, same, _), (_, other, _) = run(1), run(1, begin_s=0.1), run(2)
    plain = Simulator(perturbed)
    np.testing.assert_array_equal(start, state(perturbed, plain))
    np.testing.assert_array_equal(start, again)
    np.testing.assert_array_equal(one, same)
    plain.AdvanceTo(0.3)
    assert (one[1:4] != other[1:4]).all() and (one[1:4] != state(perturbed, plain)[1:4]).all()
    generator = RandomGenerator(1)
    drawn = {generator() % 2**31 for _ in range(2)}
    seen, pushes = (perturbed.GetSubsystemByName(name) for name in ("sensor_model", "pushes"))
    seeds = {
        int(seen.GetMyContextFromRoot(context).get_discrete_state_vector().value()[_SEED]),
        int(pushes.GetMyContextFromRoot(context).get_discrete_state(1).value()[1]),
    }
    assert seeds == drawn


def test_a_station_without_draws_has_a_random_context_too():
    station = make_station(StationConfig(), controller="hold")
    plant, contexts = station.GetSubsystemByName("plant"), [station.CreateDefaultContext() for _ in range(2)]
    station.SetRandomContext(contexts[0], RandomGenerator(1))
    ends = [plant.GetMyContextFromRoot(context).get_discrete_state_vector().value() for context in contexts]
    np.testing.assert_array_equal(*ends)


def test_the_robot_is_drawn(perturbed):
    nominal = make_station(StationConfig(), controller="hold")
    assert perturbed.robot.body_mass.sum() != nominal.robot.body_mass.sum()
    assert np.abs(joint_offset(perturbed.robot)).max() > 0.001
    seen = perturbed.GetSubsystemByName("sensor_model")
    np.testing.assert_array_equal(seen._offset, joint_offset(perturbed.robot))
    servo, plain = JointServo.of_model(perturbed.robot), JointServo.of_g1()
    assert (servo.kp != plain.kp).all() and np.abs(servo.kp / plain.kp - 1).max() < 0.4
    for name, values in vars(plain).items():
        np.testing.assert_array_equal(getattr(JointServo.of_model(nominal.robot), name), values)
    torques = make_station(StationConfig(dynamics=DynamicsConfig(motor_strength=0.1)), controller="pickup")
    strength = torques.setup.model().actuator_gainprm[:, 0]
    assert 0.9 < strength.min() < strength.max() < 1.1 and strength.std() > 0.01


def test_encoders_that_err_are_read_so(carry, robot_state, run):
    from hotice.policy.percept import Percept, PerceptModel
    from hotice.systems.sensor_model import SensorModel
    from hotice.task.sensing import SensingConfig

    offset = np.linspace(-0.01, 0.01, 20)
    true = Percept(run(SensorModel(carry.carried, SensingConfig(), 0.02), "percept", robot_state=robot_state))
    seen = Percept(
        run(SensorModel(carry.carried, SensingConfig(), 0.02, joint_offset=offset), "percept", robot_state=robot_state)
    )
    np.testing.assert_allclose(seen.q - true.q, offset, atol=1e-12)
    keypoints = PerceptModel(carry.carried).keypoints_at(robot_state[:43])
    np.testing.assert_allclose(seen.p_WK, keypoints(true.q + offset), atol=1e-9)
    seen.q[:], seen.p_WK[:] = true.q, true.p_WK
    np.testing.assert_allclose(seen.vector, true.vector, atol=1e-9)


def test_what_goes_wrong():
    for changes, message in (
        ({"push_m_s": -1.0}, "push_m_s is -1.0"),
        ({"push_interval_s": 0.0}, "push_interval_s is 0.0"),
        (
            {"dynamics": "wild"},
            "dynamics is 'wild': known are nominal, student, robot, robot_nominal, paper, or a mapping",
        ),
        ({"dynamics": {"gain": 2.0}}, "dynamics.gain is 2.0: a finite number from 0 to below 1"),
        ({"dynamics": {"mas": 0.1}}, "unknown key 'mas'"),
    ):
        with pytest.raises(InvalidConfig, match=message):
            config(**changes)
    assert config().dynamics == STUDENT_DYNAMICS
    for changes in ({"push_m_s": 0.5}, {"dynamics": STUDENT_DYNAMICS}):
        with pytest.raises(NotAvailable, match='plant="mujoco" alone'):
            make_station(StationConfig(**changes), plant="drake")


def at_once(model, qpos, qvel, ctrl):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(model, data)
    return data


def test_whichever_servo_holds_the_joints_the_drawn_robot_is_felt(carry, run, monkeypatch):
    """Torques, friction, inertia and weight: the motors' own servos, the plant's, the diagram's, and motors of a
    walk."""
    from hotice.control.plant import TorquePlant

    made = {
        kind: make_station(StationConfig(dynamics=STUDENT_DYNAMICS, seed=5, servo=kind), controller="hold")
        for kind in ("motor", "pd")
    }
    robot, rng = made["motor"].robot, np.random.default_rng(0)
    qpos, qvel = carry.qpos(), np.zeros(32)
    qpos[2], qpos[29], qvel[6:26] = 3.0, 9.0, rng.choice([-1.0, 1.0], 20) * rng.uniform(0.5, 1.0, 20)
    for size in (0.05, 100.0):
        target = carry.joint_pos + size * rng.uniform(-1.0, 1.0, 20)
        own = at_once(robot, qpos, qvel, target)
        plant = made["pd"].GetSubsystemByName("plant")
        context = plant.CreateDefaultContext()
        plant.set_state(context, qpos, qvel)
        plant.GetInputPort("actuation").FixValue(context, target)
        monkeypatch.setattr(plant, "_steps", 1)
        plant.EvalUniquePeriodicDiscreteUpdate(context)
        by_plant = at_once(made["pd"].setup.model(), qpos, qvel, plant._data.ctrl)
        np.testing.assert_allclose(by_plant.actuator_force, own.actuator_force, atol=1e-9)
        torques = replace(made["motor"].setup, motors=True, torques=True).model()
        joint_state = np.append(qpos[7:27], qvel[6:26])
        command = run(JointPd(made["motor"].setup.servo()), "torque", joint_target=target, joint_state=joint_state)
        np.testing.assert_array_less(
            np.abs(command), JointServo.of_g1().limit * (1 + 1e-9), "commands know no strength"
        )
        for model in (torques, TorquePlant(copy.copy(robot)).model):
            of_motors = at_once(model, qpos, qvel, command)
            np.testing.assert_allclose(of_motors.actuator_force, own.actuator_force, atol=1e-9)
            np.testing.assert_array_equal(of_motors.M, own.M)
            np.testing.assert_array_equal(of_motors.qfrc_bias, own.qfrc_bias)
            friction = at_once(model, qpos, 3.0 * qvel, np.zeros(20)).qfrc_constraint[6:26]
            np.testing.assert_allclose(friction, -np.sign(qvel[6:26]) * robot.dof_frictionloss[6:26], atol=1e-9)


def test_delays_of_a_station_are_whole_physics_steps():
    """What is drawn arrives in the step drawn, whatever the servo's step is."""
    for servo, step in (("motor", 0.005), ("pd", 0.002)):
        lags = set()
        for seed in range(4):
            station = make_station(config(seed=seed, servo=servo))
            lags.add(station.GetSubsystemByName("policy")._latency)
            assert station.physics_dt_s == step
        assert all(abs(lag / step - round(lag / step)) < 1e-9 for lag in lags) and len(lags) > 1
