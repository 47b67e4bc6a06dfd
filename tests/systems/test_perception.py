"""Sensors, fields and policy: each system gives what its plain function gives, and that is what training gave."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from pydrake.systems.analysis import Simulator

from hotice.errors import CheckpointError
from hotice.fields.bank import FieldBank
from hotice.fields.defaults import ETA
from hotice.fields.potential import FieldParams
from hotice.model.carry import solve_carry
from hotice.model.objects import Sphere
from hotice.policy import Percept, PerceptModel, PolicyTask, open_policy
from hotice.policy.action import next_action
from hotice.policy.guidance import FieldReading, read_fields, read_standing
from hotice.policy.measuring import DRAWS, ESTIMATE, measure
from hotice.policy.observation import LAYOUT, Carrying, layout_of, observe, remember
from hotice.safety import Answer, Fault
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.carry_bank import CarryBank
from hotice.sim.sensing import Sensors
from hotice.systems.guidance_field import GuidanceFieldSystem
from hotice.systems.policy import ACTION, MEMORY, PAST, PHASE, PLACE, PolicySystem
from hotice.systems.sensor_model import SensorModel
from hotice.systems.signals import GUIDANCE
from hotice.systems.station.make import Station
from hotice.task.sensing import STUDENT_SENSING, TRACK_TILT, SensingConfig, draw_delays

NOISY = SensingConfig(joint_pos_rad=0.03, object_pos_m=0.05, root_pos_m=0.02, root_yaw_rad=0.03, root_hz=10.0)


@pytest.fixture(scope="module")
def sensed(beam, carry):
    """Environments of one robot on the way, with its carry state: a box, and a sphere, whose keypoints do not turn."""
    fields, made = FieldBank.build([beam]), {}
    for shape, state in (("box", carry), ("sphere", solve_carry(Sphere(0.14, 1.2)))):
        bank = CarryBank.of([state], 0.005, torch.device("cpu"))
        config = TaskConfig(start_noise_m=0.0, start_yaw_noise_rad=0.0)
        env = TransportEnv(1, fields, bank, seed=1, config=config, threads=1)
        env.reset()
        for _ in range(3):
            env.step(0.3 * torch.ones(1, 20))
        made[shape] = env, state
    return made


def state_of(env, carry):
    from hotice.systems.state_adaptor import robot_state_of_mujoco

    return robot_state_of_mujoco(np.concatenate([env.physics.qpos[0], env.physics.qvel[0]]), carry.wrist_pos)


OTHERS = {
    "held": replace(STUDENT_SENSING, root_tracking=False),
    "rough": SensingConfig(
        joint_pos_rad=0.07,
        joint_vel_rad_s=0.4,
        gravity=0.12,
        gyro_rad_s=0.6,
        object_pos_m=0.02,
        object_rot_rad=0.25,
        object_filter_s=0.05,
        root_pos_m=0.08,
        root_yaw_rad=0.2,
        root_hz=25.0,
        root_tracking=True,
    ),
    "plain": SensingConfig(root_pos_m=0.05, object_rot_rad=0.1, joint_pos_rad=0.02),
}


@pytest.mark.parametrize("shape", ["box", "sphere"])
@pytest.mark.parametrize("config", [STUDENT_SENSING, *OTHERS.values()], ids=["student", *OTHERS])
def test_noise_is_the_environments(sensed, monkeypatch, rng, config, shape):
    """The same uniform numbers give the same measurement, at a refresh and between, as the filters settle."""
    env, carry = sensed[shape]
    dt, ids, world_aligned = 0.02, torch.arange(1), carry.carried.keypoints_world_aligned
    sensors = Sensors(
        config,
        1,
        dt,
        4,
        torch.device("cpu"),
        env.reader.guide,
        torch.zeros(1, dtype=torch.bool),
        env.layout.chains,
    )
    state = state_of(env, carry)
    model = PerceptModel(carry.carried)
    true = model(state[:43], state[43:])
    offset = 0.01 * rng.standard_normal(20)
    estimate = np.zeros(ESTIMATE)
    hold, gain = config.hold_steps(dt), config.object_gain(dt)
    for k in range(12):
        draws = rng.uniform(-1.0, 1.0, DRAWS)
        parts = iter(np.split((draws + 1.0) / 2.0, [1, 4, 7, 10, 30, 33, 36]))
        monkeypatch.setattr(
            torch, "rand", lambda shape, p=parts, **_: torch.tensor(next(p), dtype=torch.float32).view(shape)
        )
        s = sensors.measure(env.snapshot(), ids, torch.tensor(offset[None], dtype=torch.float32), env.generator)
        percept, estimate = measure(
            true,
            estimate,
            draws,
            config,
            world_aligned,
            offset,
            keypoints=model.keypoints_at(state[:43]),
            refresh=k % hold == 0,
            gain=max(gain, 1.0 / (k + 1)),
            tilt_gain=max(TRACK_TILT, 1.0 / (k + 1)),
            hold_s=hold * dt,
            dt_s=dt if k else 0.0,
        )
        np.testing.assert_allclose(estimate[5:8], sensors.velocity[0], atol=1e-5)
        if config.gravity:
            np.testing.assert_allclose(estimate[8:11], sensors.gravity[0], atol=1e-6)
        assert config.root_tracking == bool(np.abs(estimate[5:8]).max() > 0.0) or k < hold
        for name in Percept.SHAPES:
            wanted = {"p_WK": s.p_WK[0, :11], "yaw": s.yaw}.get(name, getattr(s, name)[0] if name != "yaw" else None)
            np.testing.assert_allclose(getattr(percept, name), wanted, atol=3e-6, err_msg=name)
        assert np.abs(percept.vector - true.vector).max() > 0.02


def test_times_of_sensing_in_steps():
    config = SensingConfig(root_hz=10.0, object_filter_s=0.2, action_delay_s=0.02)
    assert (config.hold_steps(0.02), config.hold_steps(0.01), config.object_gain(0.02)) == (5, 10, pytest.approx(0.1))
    assert (config.longest_delay(0.02, 4), config.longest_delay(0.02, 10), config.longest_delay(0.01, 2)) == (4, 10, 2)
    assert (SensingConfig().hold_steps(0.02), SensingConfig().object_gain(0.02)) == (1, 1.0)


def test_sensors_without_noise_tell_the_truth(carry, robot_state, run):
    truth = PerceptModel(carry.carried)(robot_state[:43], robot_state[43:])
    got = run(SensorModel(carry.carried, SensingConfig(), 0.02), "percept", robot_state=robot_state)
    np.testing.assert_array_equal(got, truth.vector)


def sequence(sensors, robot_state, steps=12, context=None):
    """Percepts at each control step, as a policy would read them."""
    simulator = Simulator(sensors, context)
    sensors.GetInputPort("robot_state").FixValue(simulator.get_mutable_context(), robot_state)
    seen = []
    start = simulator.get_context().get_time()
    for k in range(steps):
        seen.append(sensors.GetOutputPort("percept").Eval(simulator.get_context()).copy())
        simulator.AdvanceTo(start + 0.02 * (k + 1) - 1e-9)
    return np.array(seen), simulator


def test_measurements_follow_from_the_context(carry, robot_state):
    sensors = SensorModel(carry.carried, NOISY, 0.02, seed=5)
    seen, _ = sequence(sensors, robot_state)
    again, _ = sequence(SensorModel(carry.carried, NOISY, 0.02, seed=5), robot_state)
    other, _ = sequence(SensorModel(carry.carried, NOISY, 0.02, seed=6), robot_state)
    np.testing.assert_array_equal(seen, again)
    assert (seen[0] != seen[1]).any() and (seen[0] != other[0]).any()
    _, simulator = sequence(sensors, robot_state, steps=4)
    rest, _ = sequence(sensors, robot_state, steps=8, context=simulator.get_context().Clone())
    np.testing.assert_array_equal(rest, seen[4:])
    root = Percept.PARTS["p_WP"]
    assert (seen[:5, root] == seen[0, root]).all() and (seen[5, root] != seen[0, root])[:2].all()  # refreshed at 10 Hz


def test_half_widths(carry, robot_state):
    seen, _ = sequence(SensorModel(carry.carried, NOISY, 0.02), robot_state, steps=200)
    truth = PerceptModel(carry.carried)(robot_state[:43], robot_state[43:])
    error = seen[:, Percept.PARTS["q"]] - truth.q
    assert 0.0295 < np.abs(error).max() <= 0.03 and abs(error.mean()) < 1e-3
    np.testing.assert_array_equal(seen[:, Percept.PARTS["gravity_P"]], np.tile(truth.gravity_P, (200, 1)))


def test_late_sensors(carry, robot_state):
    prompt, _ = sequence(SensorModel(carry.carried, NOISY, 0.02, late=False), robot_state)
    late, _ = sequence(SensorModel(carry.carried, NOISY, 0.02, late=True), robot_state)
    np.testing.assert_array_equal(late[0], prompt[0])
    np.testing.assert_array_equal(late[1:], prompt[:-1])
    drawn = [draw_delays(STUDENT_SENSING, 0.02, 4, seed) for seed in range(200)]
    assert 60 < sum(late for late, _ in drawn) < 140
    assert {round(delay, 3) for _, delay in drawn} == {0.0, 0.005, 0.01, 0.015, 0.02}
    assert draw_delays(SensingConfig(), 0.02, 4, 3) == (False, 0.0)


def test_fields(station, robot_state, run, carry):
    percept = PerceptModel(carry.carried)(robot_state[:43], robot_state[43:])
    got = run(GuidanceFieldSystem(station.pf, station.task), "guidance", percept=percept.vector)
    np.testing.assert_array_equal(got, read_fields(station.pf, percept, station.task).vector)


def policy_inputs(station, carry, robot_state):
    percept = PerceptModel(carry.carried)(robot_state[:43], robot_state[43:])
    return percept, read_fields(station.pf, percept, station.task)


def stepped(system, **inputs):
    """A Simulator of the system alone, after its first update."""
    simulator = Simulator(system)
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(simulator.get_mutable_context(), np.asarray(value, dtype=float))
    simulator.AdvanceTo(0.001)
    return simulator


def test_policy(station, carry, robot_state):
    percept, reading = policy_inputs(station, carry, robot_state)
    session = open_policy("carry")
    system = PolicySystem(session, carry)
    simulator = stepped(system, percept=percept.vector, guidance=reading.vector)
    action = np.zeros(20)
    for k in range(3):
        observation = observe(
            percept, reading, Carrying.of(carry), action, k * 2 * np.pi * 1.4 * 0.02, False, np.zeros(0)
        )
        action = next_action(session.run(observation[None])[0].astype(float), 4.0)
        context = simulator.get_context()
        np.testing.assert_allclose(system.GetOutputPort("action").Eval(context), action, atol=1e-6)
        target = carry.joint_target + np.repeat([0.3, 0.12], [12, 8]) * action
        np.testing.assert_allclose(system.GetOutputPort("joint_target").Eval(context), target, atol=1e-6)
        simulator.AdvanceTo(0.02 * (k + 1) + 0.001)
    assert np.abs(action).max() > 0.1


def test_a_policy_with_a_history(station, carry, robot_state, rng):
    """It reads the steps before, the newest first, and forgets them while it rests."""
    percept, reading = policy_inputs(station, carry, robot_state)
    shipped = open_policy("carry")
    meta = shipped.meta | {"task": shipped.meta["task"] | {"history": 3}}
    layout = layout_of(PolicyTask.from_meta(meta))
    weights = 0.05 * rng.standard_normal((sum(width for _, width in layout), 20))
    session = SimpleNamespace(name="past", meta=meta, layout=layout, run=lambda observations: observations @ weights)
    system = PolicySystem(session, carry)
    simulator = stepped(system, percept=percept.vector, guidance=reading.vector, active=[1.0])
    action, past = np.zeros(20), np.zeros(198)
    for k in range(5):
        observation = observe(percept, reading, Carrying.of(carry), action, k * 2 * np.pi * 1.4 * 0.02, False, past)
        action, past = next_action(session.run(observation), 4.0), remember(past, observation)
        context = simulator.get_mutable_context()
        np.testing.assert_allclose(system.GetOutputPort("action").Eval(context), action, atol=1e-5)
        np.testing.assert_allclose(context.get_discrete_state(MEMORY).value()[PAST], past, atol=1e-5)
        percept.q[:] += 0.1
        system.GetInputPort("percept").FixValue(context, percept.vector)
        simulator.AdvanceTo(0.02 * (k + 1) + 0.001)
    assert len(np.unique(past.reshape(3, 66)[:, 6])) == 3
    system.GetInputPort("active").FixValue(simulator.get_mutable_context(), [0.0])
    simulator.AdvanceTo(0.121)
    assert not simulator.get_context().get_discrete_state(MEMORY).value()[PAST].any()


def test_policy_rests_until_it_is_active(station, carry, robot_state):
    percept, reading = policy_inputs(station, carry, robot_state)
    system = PolicySystem(open_policy("carry"), carry)
    simulator = stepped(system, percept=percept.vector, guidance=reading.vector, active=[0.0])
    np.testing.assert_array_equal(
        system.GetOutputPort("joint_target").Eval(simulator.get_context()), carry.joint_target
    )
    system.GetInputPort("active").FixValue(simulator.get_mutable_context(), [1.0])
    simulator.AdvanceTo(0.021)
    assert (system.GetOutputPort("joint_target").Eval(simulator.get_context()) != carry.joint_target).all()


def test_latency_of_the_motors(station, carry, robot_state):
    percept, reading = policy_inputs(station, carry, robot_state)
    system = PolicySystem(open_policy("carry"), carry, latency_s=0.01)
    simulator = stepped(system, percept=percept.vector, guidance=reading.vector)
    targets = []
    for time_s in (0.005, 0.0101, 0.025, 0.0301):
        simulator.AdvanceTo(time_s)
        targets.append(system.GetOutputPort("joint_target").Eval(simulator.get_context()).copy())
    np.testing.assert_array_equal(targets[0], carry.joint_target)
    np.testing.assert_array_equal(targets[1], targets[2])
    assert (targets[1] != targets[0]).any() and (targets[3] != targets[2]).any()


def test_actions_are_bounded():
    np.testing.assert_array_equal(next_action(np.array([9.0, -9.0, -0.5]), 4.0), [4.0, -4.0, -0.5])


class Failing:
    """The shipped policy, which then gives up."""

    def __init__(self, answer):
        self.shipped, self.answer = open_policy("carry"), answer
        self.name, self.meta, self.layout = "failing", self.shipped.meta, self.shipped.layout

    def run(self, observation):
        if isinstance(self.answer, Exception):
            raise self.answer
        actions = self.shipped.run(observation)
        if self.answer is not None:
            actions[0, 7] = self.answer
        return actions


@pytest.mark.parametrize(
    "answer, fault, message",
    [
        (np.nan, Fault.ACTION_INVALID, "the action is not finite"),
        (np.inf, Fault.ACTION_INVALID, "the action is not finite"),
        (CheckpointError("no\nmore"), Fault.CONTROLLER_ERROR, "CheckpointError: no more"),
        (ZeroDivisionError("by 0"), Fault.CONTROLLER_ERROR, "ZeroDivisionError: by 0"),
        (np.linalg.LinAlgError("singular"), Fault.CONTROLLER_ERROR, "LinAlgError: singular"),
        (IndexError("out"), Fault.CONTROLLER_ERROR, "IndexError: out"),
        (RuntimeError("gave up"), Fault.CONTROLLER_ERROR, "RuntimeError: gave up"),
        ("percept", Fault.OBSERVATION_INVALID, "the observation is not finite"),
    ],
)
def test_a_policy_that_fails_keeps_its_target_and_says_why(station, carry, robot_state, answer, fault, message):
    percept, reading = policy_inputs(station, carry, robot_state)
    policy = Failing(None)
    system = PolicySystem(policy, carry)
    simulator = stepped(system, percept=percept.vector, guidance=reading.vector)
    context = simulator.get_mutable_context()
    good = [system.GetOutputPort(name).Eval(context).copy() for name in ("joint_target", "action")]
    np.testing.assert_array_equal(system.GetOutputPort("status").Eval(context), [0.0, 0.0])
    assert system.message(context) == ""
    if answer == "percept":
        bad = percept.vector.copy()
        bad[9] = np.nan
        system.GetInputPort("percept").FixValue(context, bad)
    else:
        policy.answer = answer
    simulator.AdvanceTo(0.021)
    np.testing.assert_array_equal(system.GetOutputPort("status").Eval(context), [0.02, fault])
    assert system.message(context) == message
    for name, value in zip(("joint_target", "action"), good, strict=True):
        np.testing.assert_array_equal(system.GetOutputPort(name).Eval(context), value)
    policy.answer = None
    system.GetInputPort("percept").FixValue(context, percept.vector)
    simulator.AdvanceTo(0.041)
    np.testing.assert_array_equal(system.GetOutputPort("status").Eval(context), [0.04, 0.0])
    assert (system.GetOutputPort("joint_target").Eval(context) != good[0]).any()


def test_a_defect_of_a_policy_is_no_fault(station, carry, robot_state):
    percept, reading = policy_inputs(station, carry, robot_state)
    with pytest.raises(TypeError, match="a defect"):
        stepped(PolicySystem(Failing(TypeError("a defect")), carry), percept=percept.vector, guidance=reading.vector)


@pytest.mark.parametrize("eta", [ETA, 1.0])
def test_a_policy_told_to_stand_reads_a_goal_where_it_is(station, carry, robot_state, eta):
    percept, reading = policy_inputs(station, carry, robot_state)
    reading.force_W[3], reading.distance[4] = np.nan, np.nan
    system = PolicySystem(open_policy("carry"), carry, attraction=eta)
    simulator = stepped(
        system, percept=percept.vector, guidance=reading.vector, answer=[float(Answer.STOP_WALKING), 1.0]
    )
    context = simulator.get_mutable_context()
    place = context.get_discrete_state(PLACE).value().copy()
    np.testing.assert_array_equal(place, [*percept.p_WP[:2], 0.75])
    moved = Percept(percept.vector.copy())
    for name in ("p_WP", "p_WK", "p_WO", "p_WOK"):
        getattr(moved, name)[..., 0] += 0.2
    system.GetInputPort("percept").FixValue(context, moved.vector)
    simulator.AdvanceTo(0.021)
    np.testing.assert_array_equal(context.get_discrete_state(PLACE).value(), place)
    still = read_standing(reading, moved, place, system.task, eta)
    assert np.isfinite(still.vector).all() and still.distance[4] == 2.0
    np.testing.assert_array_equal(np.delete(still.distance, 4), np.delete(reading.distance, 4))
    np.testing.assert_allclose(np.linalg.norm(still.force_W, axis=1), eta, rtol=1e-6)
    np.testing.assert_allclose(still.force_W[0], eta * (place - moved.p_WK[0]) / np.linalg.norm(place - moved.p_WK[0]))
    assert still.goal_distance[0] == pytest.approx(0.2) and still.c_W[0] < -0.3 and abs(still.c_W[1]) < 0.1
    memory = context.get_discrete_state(MEMORY).value()
    expected = observe(moved, still, Carrying.of(carry), memory[ACTION], memory[PHASE], False, memory[PAST])
    np.testing.assert_array_equal(system.observation(context), expected)
    system.GetInputPort("answer").FixValue(context, [0.0, 0.0])
    simulator.AdvanceTo(0.041)
    np.testing.assert_array_equal(context.get_discrete_state(PLACE).value(), place)  # there is no other guidance
    system.GetInputPort("guidance").FixValue(context, np.nan_to_num(reading.vector))
    simulator.AdvanceTo(0.061)
    assert np.isnan(context.get_discrete_state(PLACE).value()).all()


def test_the_policy_of_a_station_stands_by_the_eta_of_its_fields(station, robot_state):
    for eta in (0.6, 1.0):
        pf = replace(station.pf, params=FieldParams(attraction=eta))
        policy = Station(replace(station.setup, pf=pf)).GetSubsystemByName("policy")
        context = policy.CreateDefaultContext()
        percept, reading = policy_inputs(station, station.carry, robot_state)
        for name, value in (("percept", percept.vector), ("guidance", np.full(GUIDANCE, np.nan))):
            policy.GetInputPort(name).FixValue(context, value)
        here = np.array([*percept.p_WP[:2], 0.75])
        still = read_standing(FieldReading(np.full(GUIDANCE, np.nan)), percept, here, policy.task, eta)
        rows = context.get_discrete_state(MEMORY).value()
        expected = observe(
            percept, still, Carrying.of(station.carry), rows[ACTION], rows[PHASE], policy.task.scan, rows[PAST]
        )
        np.testing.assert_array_equal(policy.observation(context), expected)


def test_a_policy_of_another_layout_is_refused(carry):
    shipped = open_policy("carry")
    layout = [(name, width + (name == "clock")) for name, width in LAYOUT]
    other = SimpleNamespace(name="other", meta=shipped.meta, layout=layout, run=shipped.run)
    with pytest.raises(CheckpointError, match="other: observation layout differs"):
        PolicySystem(other, carry)


def test_the_first_step_feels_the_first_action(station):
    """Event order: an action of this instant's state moves the plant in this instant's step."""
    simulator = Simulator(station)
    simulator.AdvanceTo(0.001)
    plant, policy = (station.GetSubsystemByName(name) for name in ("plant", "policy"))
    context = plant.GetMyContextFromRoot(simulator.get_context())
    state = plant.GetOutputPort("full_state").Eval(context)
    target = policy.GetOutputPort("joint_target").Eval(policy.GetMyContextFromRoot(simulator.get_context()))
    start = 1 + 34 + 32 + 0 + 32  # time, qpos, qvel, activations (none), warm start
    np.testing.assert_array_equal(state[start : start + 20], target)
    action = policy.GetMyContextFromRoot(simulator.get_context()).get_discrete_state(MEMORY).value()[ACTION]
    assert np.abs(action).max() > 0.0


def test_station_equals_training(station, beam, carry):
    """Policy, fields, clock, servos and physics: half a second as the environment makes it."""
    from hotice.learn.policy import load_policy

    bank = CarryBank.of([carry], 0.005, torch.device("cpu"), scene=beam)
    policy = load_policy("student")
    own = ("scan", "history", "speed_m_s", "stop_gain_hz")
    reads = {name: policy.meta["task"][name] for name in own}
    quiet = TaskConfig(start_noise_m=0.0, start_yaw_noise_rad=0.0, joint_noise_rad=0.0, **reads)
    env = TransportEnv(1, FieldBank.build([beam]), bank, seed=2, config=quiet, threads=1)
    obs, _ = env.reset()
    simulator = Simulator(station)
    root = simulator.get_mutable_context()
    plant, acting = (station.GetSubsystemByName(name) for name in ("plant", "policy"))
    plant.set_state(plant.GetMyMutableContextFromRoot(root), env.physics.qpos[0].numpy())
    acting.GetMyMutableContextFromRoot(root).get_mutable_discrete_state(MEMORY)[PHASE] = float(env.memory.phase[0])
    for k in range(25):
        obs = env.step(policy.act(obs)).policy
        simulator.AdvanceTo(0.02 * k + 0.001)
        qpos = plant.GetOutputPort("state").Eval(plant.GetMyContextFromRoot(root))[:34]
        np.testing.assert_allclose(qpos, env.physics.qpos[0], atol=2e-4, err_msg=f"step {k}")
    assert qpos[0] > 0.1
