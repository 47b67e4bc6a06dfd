"""The fields' own eta, default and another: the environment commands and rewards what a station reads in them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.fields.potential import FieldParams
from hotice.model import load_scenes
from hotice.model.robot_state import RobotState
from hotice.model.scene import Scene
from hotice.policy.guidance import read_fields
from hotice.policy.percept import PerceptModel
from hotice.sim import terms
from hotice.sim.sensing import SensingConfig
from hotice.task.policy_task import PolicyTask

ETAS = (0.6, 1.0)
FAR = Scene("far", ((-1.0, -1.0, 0.0), (9.0, 1.0, 1.5)), (0.0, 0.0, 0.0), (8.0, 0.0), ())


@pytest.fixture(scope="module")
def gap():
    return load_scenes(["gap"])[0]


@pytest.fixture(scope="module")
def start(make_env, gap):
    """Function: an environment of each carried object in fields of an eta, in scene gap or in free space."""
    banks = [FieldBank.build([gap], 0.08), FieldBank.build([FAR], 0.1)]

    def started(eta, free=False, **config):
        solved = banks[free]
        bank = FieldBank(solved.scenes, solved.volumes, solved.margin_m, FieldParams(attraction=eta))
        env = make_env(4, bank=bank, **config)
        env.reset()
        return env

    return started


@pytest.mark.parametrize("eta", ETAS)
@pytest.mark.parametrize("task", [PolicyTask(), PolicyTask(speed_m_s=0.5, stop_gain_hz=1.5)])
def test_environment_station_and_query_command_alike(start, gap, states, eta, task):
    query = pytest.importorskip("hotice.fields.guidance").query
    constants = {"speed_m_s": task.speed_m_s, "stop_gain_hz": task.stop_gain_hz}
    env = start(eta, start_noise_m=0.2, **constants)
    s, pf = env.snapshot(), build_hod_pf(gap, 0.08, params=FieldParams(attraction=eta))
    for i, carry in enumerate(states):
        qpos, qvel = env.physics.qpos[i].numpy(), env.physics.qvel[i].numpy()
        state = RobotState.from_mujoco(qpos, qvel, carried=carry.carried, wrist_pos=carry.wrist_pos)
        reading = read_fields(pf, PerceptModel(carry.carried)(*state.to_mujoco(29)), task)
        np.testing.assert_allclose(reading.c_W, s.c_W[i], atol=2e-5)
        np.testing.assert_allclose(reading.speed[0], s.speed[i], atol=1e-5)
        np.testing.assert_allclose(reading.heading_error[0], s.heading_error[i], atol=1e-4)
        np.testing.assert_allclose(query(pf, state, **constants).c_W, s.c_W[i], atol=2e-5)


def test_the_command_knows_eta(start):
    """Where nothing is near, its vertical part grows with eta; otherwise the test above could not fail."""
    one, other = (start(eta, free=True).snapshot().c_W for eta in ETAS)
    torch.testing.assert_close(other, one / torch.tensor([1.0, 1.0, 0.6]), rtol=1e-4, atol=1e-6)
    assert one[:, 2].abs().min() > 1e-3


@pytest.mark.parametrize("eta", ETAS)
def test_in_free_space_the_residual_vanishes(start, eta):
    """Far from the goal of a scene without obstacles, hands and object are asked for nothing beyond the command."""
    s = start(eta, free=True).snapshot()
    assert s.eta == eta
    assert (terms._at_command(s) - s.c_W[:, None]).norm(dim=-1).max() < 0.06
    assert (s.ogf.force_W - s.c_W[:, None]).norm(dim=-1).min() > 0.09, "unscaled, the field asks for another speed"


@pytest.mark.parametrize("eta", ETAS)
def test_progress_counts_in_units_of_eta(start, eta):
    s = start(eta, free=True).snapshot()
    torch.testing.assert_close(eta * terms.progress(replace(s, v_WP=s.c_W)), s.speed)


def test_what_is_measured_is_guided_by_the_same_fields(start):
    env = start(1.0, sensing=SensingConfig(root_yaw_rad=0.3))
    s = env.snapshot()
    measured = env.sensors.measure(s, env.everyone, torch.zeros(4, 20), env.generator)
    assert measured.eta == 1.0 and (measured.c_W != s.c_W).any()


@pytest.mark.parametrize("eta", ETAS)
def test_the_object_reward_is_what_the_notation_page_writes(start, eta):
    """[F·speed/eta − c] against [v − c], softened by 0.1 m/s, times the distance to go over half a metre."""
    s = start(eta).snapshot()
    lifting = s.c_W[:, None] + torch.tensor([0.05, 0.0, 0.2])
    for distance_m in (2.0, 0.2):
        at = replace(s, v_WOK=lifting.expand_as(s.v_WOK), goal_distance=torch.full((4,), distance_m))
        a = s.ogf.force_W[:, 2:].double() * s.speed[:, None, None] / eta - s.c_W[:, None]
        b = lifting - s.c_W[:, None].double()
        cosine = (a * b).sum(-1) / ((a.norm(dim=-1) + 0.1) * (b.norm(dim=-1) + 0.1))
        wanted = cosine.mean(dim=1) * min(distance_m / 0.5, 1.0)
        torch.testing.assert_close(terms.ogf_object(at).double(), wanted, atol=1e-5, rtol=0)
        assert wanted.abs().max() > 0.01
