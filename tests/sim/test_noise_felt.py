"""Noise, delays, pushes, starts and objects: what arrives at actors, motors and bodies is uniform in what is
configured."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

from hotice.model.dynamics import LEAST_PUSH, ROBOT_DYNAMICS
from hotice.model.object_range import ObjectRange
from hotice.sim import TaskConfig
from hotice.sim.carry_bank import CarryBank
from hotice.sim.events import push
from hotice.task.protocols import get_protocol
from hotice.task.sensing import STUDENT_SENSING

CPU = torch.device("cpu")
AT_ONCE = replace(
    STUDENT_SENSING, action_delay_s=0.0, sensor_delay_steps=0, object_filter_s=0.0, root_hz=0.0, root_tracking=False
)
"""Every noise, without delays and filters, which have tests of their own in `test_sensing.py`."""


def assert_uniform(values, half, mid=0.0):
    """Mean, spread and range, to four standard errors, of `mid` ± `half`."""
    values = (np.asarray(values, dtype=float).ravel() - mid) / half
    n = len(values)
    assert np.abs(values).max() <= 1.0 + 1e-3 and values.min() < -0.93 and values.max() > 0.93
    assert abs(values.mean()) < 4 / np.sqrt(3 * n)
    assert values.std() == pytest.approx(1 / np.sqrt(3), rel=4 / np.sqrt(2.5 * n))


def rows(env, observation):
    """An observation by row."""
    names, sizes = zip(*env.policy_table.layout(), strict=True)
    return dict(zip(names, torch.split(observation, sizes, dim=1), strict=True))


def test_actors_read_what_is_configured(make_env, states):
    bank = CarryBank.of(states * 20, 0.005, CPU, dynamics=ROBOT_DYNAMICS)
    env = make_env(80, carry=bank, sensing=AT_ONCE, dynamics=ROBOT_DYNAMICS)
    env.reset()
    read, cfg = [], env.config.sensing
    offset = bank.joint_offset[env.memory.model]
    for _ in range(3):
        policy, true = env.step(torch.zeros(80, 20)).policy, env.policy_table(env.snapshot())
        read.append({name: value - rows(env, true)[name] for name, value in rows(env, policy).items()})
    error = {name: torch.stack([r[name] for r in read]) for name in read[0]}
    assert_uniform(error["joint_pos"] - offset, cfg.joint_pos_rad)
    assert_uniform(error["joint_vel"], 0.1 * cfg.joint_vel_rad_s)
    assert_uniform(error["gravity"], cfg.gravity)
    assert_uniform(error["gyro"], 0.25 * cfg.gyro_rad_s)
    assert_uniform(offset, ROBOT_DYNAMICS.joint_offset_rad)
    for name in ("carry_pos", "last_action", "clock", "object_size"):
        assert (error[name] == 0).all(), name


def test_the_estimate_of_root_and_object_errs_as_configured(make_env):
    env = make_env(256, sensing=replace(AT_ONCE, gravity=0.0, gyro_rad_s=0.0))
    env.reset()
    s, cfg = env.snapshot(), env.config.sensing
    m = env.sensors.measure(s, env.everyone, torch.zeros(256, 20), env.generator)
    assert_uniform(m.p_WP - s.p_WP, cfg.root_pos_m)
    turned = m.yaw - s.yaw
    assert_uniform(torch.atan2(turned.sin(), turned.cos()), cfg.root_yaw_rad)
    R_WE = s.R_WP @ m.R_WP.transpose(1, 2)  # back from the estimated world
    seen = (R_WE @ (m.p_WO - m.p_WP)[:, :, None])[:, :, 0]
    assert_uniform(seen - (s.p_WO - s.p_WP), cfg.object_pos_m)
    turn = (R_WE @ m.R_WO @ s.R_WO.transpose(1, 2)).double()
    vector = 0.5 * torch.stack([turn[:, k, j] - turn[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], dim=1)
    sine = vector.norm(dim=1, keepdim=True)
    assert_uniform(vector * torch.asin(sine) / sine, cfg.object_rot_rad)


@pytest.mark.parametrize("substeps, step_s", [(4, 0.005), (2, 0.010), (10, 0.002)])
def test_delays_are_drawn_in_whole_steps_up_to_the_longest(make_env, substeps, step_s):
    env = make_env(400, sensing=STUDENT_SENSING, substeps=substeps, physics_dt_s=step_s)
    env.sensors.restart(env.everyone, env.generator)
    share = np.bincount(env.sensors.action_delay, minlength=substeps + 1) / 400
    assert len(share) == substeps + 1 and np.abs(share - 1 / (substeps + 1)).max() < 4 * np.sqrt(share.max() / 400)
    assert float(env.sensors.late.float().mean()) == pytest.approx(0.5, abs=0.1)


def test_the_protocols_perturb_alike_but_in_what_they_name():
    robot, paper = (get_protocol(name).task(TaskConfig()) for name in ("robot", "paper"))
    assert robot.sensing == paper.sensing == STUDENT_SENSING and robot.push_m_s == paper.push_m_s == 1.0
    assert robot.control_dt_s == pytest.approx(paper.control_dt_s) and (robot.substeps, paper.substeps) == (10, 4)


def test_pushes_have_any_direction_and_the_sizes_and_times_configured(make_env):
    env = make_env(64, push_m_s=0.8, push_interval_s=0.1)
    env.reset()
    felt = []
    for _ in range(100):
        env.physics.qvel.zero_()
        push(env.physics, env.config, env.generator)
        felt.append(env.physics.qvel.clone())
    felt = torch.cat(felt)
    assert (felt[:, 2:] == 0).all()
    hit = felt[:, :2].norm(dim=1) > 0
    chance = env.config.control_dt_s / env.config.push_interval_s
    assert float(hit.float().mean()) == pytest.approx(chance, abs=4 * np.sqrt(chance / len(felt)))
    x, y = felt[hit, 0], felt[hit, 1]
    least = LEAST_PUSH * 0.8
    assert_uniform(torch.hypot(x, y), (0.8 - least) / 2, (0.8 + least) / 2)
    assert_uniform(torch.atan2(y, x), np.pi)


def test_starts_are_uniform_in_what_is_configured(make_env):
    env = make_env(400, start_noise_m=0.05, start_yaw_noise_rad=0.15, joint_noise_rad=0.02)
    env.reset()
    place, carry = env.bank.start[env.memory.scene], env.carry.qpos[env.memory.model]
    q = env.physics.qpos
    assert_uniform(q[:, :2] - place[:, :2], 0.05)
    assert_uniform(2.0 * torch.atan2(q[:, 6], q[:, 3]) - place[:, 2], 0.15)
    assert_uniform((q - carry)[:, 7:19], 0.02)
    assert ((q - carry)[:, 19:27] == 0).all()


def test_critics_know_the_weight_that_hands_feel(make_env, states):
    bank = CarryBank.of(states, 0.005, CPU, dynamics=ROBOT_DYNAMICS)
    env = make_env(8, carry=bank, dynamics=ROBOT_DYNAMICS)
    env.reset()
    env.physics.batch.forward(stage=mujoco.mjtStage.mjSTAGE_ACC)
    felt = torch.tensor(env.physics.batch.bind("qfrc_bias")[:, 28] / 9.81)
    told = env.snapshot().grasp.mass[:, 0]
    torch.testing.assert_close(told.double(), felt, rtol=1e-6, atol=0)
    named = torch.tensor([bank.states[i].carried.mass_kg for i in env.memory.model.tolist()])
    assert 0.01 < (told / named - 1).abs().max() <= ROBOT_DYNAMICS.payload


def test_objects_are_uniform_in_their_range():
    objects, rng = ObjectRange(), np.random.default_rng(0)
    drawn = [objects.sample(rng) for _ in range(500)]
    assert_uniform([o.mass_kg for o in drawn], 1.5, 2.0)
    assert_uniform([2.0 * o.half_extents_m for o in drawn], 0.1, 0.3)
