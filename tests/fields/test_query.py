"""Guidance from Pinocchio against what the training environment computes from MuJoCo at the same states."""

import numpy as np
import pytest
import torch

from hotice.errors import InvalidState
from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.fields.guidance import NUM_SGF, SPEED_M_S, STOP_GAIN_HZ, query
from hotice.fields.potential import FieldParams
from hotice.model import Box, g1, load_scenes
from hotice.model.carry import solve_carry
from hotice.model.frames import normalize
from hotice.model.objects import Cylinder, Sphere
from hotice.model.robot_state import RobotState
from hotice.sim import TaskConfig, TransportEnv
from hotice.sim.carry_bank import CarryBank

pytest.importorskip("pinocchio")
PER_SCENE = 500
SCENES = ("pillars", "pipe")


@pytest.fixture(scope="module")
def carries():
    return [solve_carry(o) for o in (Box((0.3, 0.3, 0.3), 1.0), Cylinder(0.13, 0.3, 1.5), Sphere(0.14, 1.2))]


@pytest.fixture(scope="module")
def both(carries):
    """Snapshots of the environment and guidance of the same 1,000 states in two scenes."""
    rng = np.random.default_rng(0)
    scenes = load_scenes(SCENES)
    bank = FieldBank.build(scenes)
    env = TransportEnv(2 * PER_SCENE, bank, CarryBank.of(carries, 0.005, torch.device("cpu")), threads=1)
    env.memory.scene[:] = torch.arange(2 * PER_SCENE) // PER_SCENE
    env.physics.set_models(torch.arange(2 * PER_SCENE), env.memory.model)
    model = env.memory.model.numpy()
    qpos = np.array([carries[i].qpos() for i in model])
    n = len(qpos)
    place = np.column_stack([rng.uniform(-0.3, 2.3, n), rng.uniform(-0.8, 0.8, n), rng.uniform(-0.1, 0.1, n)])
    qpos[:, 7:27] += rng.uniform(-0.4, 0.4, (n, 20))
    for start in (0, 27):
        qpos[:, start : start + 3] += place
        qpos[:, start + 3 : start + 7] = normalize(rng.normal(size=(n, 4)) * 0.3 + [1.0, 0, 0, 0])
    qvel = rng.normal(size=(n, 32))
    env.physics.qpos[:], env.physics.qvel[:] = torch.from_numpy(qpos), torch.from_numpy(qvel)
    env.physics.forward(torch.arange(n))
    pf = [build_hod_pf(s) for s in scenes]
    guidance = []
    for i in range(n):
        carry = carries[model[i]]
        state = RobotState.from_mujoco(qpos[i], qvel[i], carried=carry.carried, wrist_pos=carry.wrist_pos)
        guidance.append(query(pf[i // PER_SCENE], state))
    return env.snapshot(), guidance


def stacked(guidance, name):
    return np.stack([getattr(g, name) for g in guidance])


def from_env(robot, carried):
    return torch.cat([robot, carried], dim=1).double().numpy()


def test_positions_and_velocities(both):
    s, guidance = both
    hands = slice(NUM_SGF, NUM_SGF + 2)
    p = from_env(s.p_WK[:, :NUM_SGF], torch.cat([s.p_WK[:, hands], s.p_WOK], dim=1))
    v = from_env(s.v_WK[:, :NUM_SGF], torch.cat([s.v_WK[:, hands], s.v_WOK], dim=1))
    np.testing.assert_allclose(stacked(guidance, "p_WK"), p, atol=1e-5)
    np.testing.assert_allclose(stacked(guidance, "v_WK"), v, atol=1e-5)


def test_field_vectors(both):
    """The environment samples at float32 positions, so what the field changes over that counts as equal."""
    s, guidance = both
    force, distance = stacked(guidance, "force_W"), stacked(guidance, "signed_distance")
    np.testing.assert_allclose(distance, from_env(s.sgf.signed_distance, s.ogf.signed_distance), atol=1e-5)
    np.testing.assert_allclose(stacked(guidance, "geodesic"), from_env(s.sgf.geodesic, s.ogf.geodesic), atol=1e-5)
    error = np.abs(force - from_env(s.sgf.force_W, s.ogf.force_W)).max(axis=-1)
    away = distance > FieldParams().influence_distance_m
    assert away.mean() > 0.2 and error[away].max() < 1e-5
    size = np.linalg.norm(force, axis=-1)
    assert (error / (1.0 + size)).max() < 1e-3
    assert np.quantile(error / (1.0 + size), 0.99) < 1e-5


def test_navigation_command(both):
    s, guidance = both
    np.testing.assert_allclose(stacked(guidance, "c_W"), s.c_W.double().numpy(), atol=2e-5)
    assert s.speed.min() < 0.5 * SPEED_M_S < s.speed.max()


def test_defaults_are_those_of_the_task():
    assert (SPEED_M_S, STOP_GAIN_HZ) == (TaskConfig().speed_m_s, TaskConfig().stop_gain_hz)


def test_without_object_only_the_robot_is_asked(both):
    _, guidance = both
    pf = build_hod_pf(load_scenes(["open_floor"])[0], 0.1)
    alone = query(pf, RobotState(p_WP=np.array([0.0, 0.0, 0.74]), joint_pos=np.zeros(29)))
    assert alone.names == g1.SGF_KEYPOINTS + g1.OGF_KEYPOINTS and alone.jacobian.shape == (11, 3, 35)
    assert guidance[0].names[-1] == "object_7" and guidance[0].jacobian.shape == (19, 3, 41)
    assert np.linalg.norm(alone.c_W[:2]) == pytest.approx(SPEED_M_S)


def test_states_translate_both_ways(carries):
    rng = np.random.default_rng(1)
    qpos, qvel = carries[0].qpos(), rng.normal(size=32)
    state = RobotState.from_mujoco(qpos, qvel, carried=carries[0].carried, wrist_pos=carries[0].wrist_pos)
    for joints, nq in ((20, 34), (29, 43)):
        q, v = state.to_mujoco(joints)
        again = RobotState.from_mujoco(q, v, carried=state.carried, wrist_pos=carries[0].wrist_pos)
        assert len(q) == nq
        np.testing.assert_allclose(again.joint_pos, state.joint_pos)
        np.testing.assert_allclose(again.w_WO_O, qvel[-3:])
    np.testing.assert_array_equal(RobotState.from_carry(carries[0]).to_mujoco()[0], qpos)


def test_impossible_states_are_refused():
    with pytest.raises(InvalidState, match=r"qpos without object has shape \(34,\): 27 or 36"):
        RobotState.from_mujoco(np.zeros(34))
    with pytest.raises(InvalidState, match=r"qvel has shape \(27,\): 26 numbers"):
        RobotState.from_mujoco(np.r_[0, 0, 0, 1, np.zeros(23)], np.zeros(27))
    with pytest.raises(InvalidState, match="joint_pos has shape"):
        RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(20))
    with pytest.raises(InvalidState, match="finite"):
        RobotState(p_WP=np.array([0, 0, np.nan]), joint_pos=np.zeros(29))
    with pytest.raises(InvalidState, match="12 joints"):
        RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29)).to_mujoco(12)
