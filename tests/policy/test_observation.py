import numpy as np
import pytest
import torch

from hotice.fields import build_hod_pf
from hotice.fields.bank import FieldBank
from hotice.fields.potential import FieldParams
from hotice.model import load_scenes
from hotice.model.robot_state import RobotState
from hotice.policy.guidance import read_fields
from hotice.policy.observation import Carrying, layout_of, observe, remember
from hotice.policy.percept import Percept, PerceptModel
from hotice.sim.observations import ObservationTable, policy_rows
from hotice.task.policy_task import PolicyTask


@pytest.fixture(scope="module")
def fields():
    return {s.name: build_hod_pf(s) for s in load_scenes(["beam", "gap", "pillars", "pipe"])}


def twin(env, states, fields, task, i, past=()):
    state = states[int(env.memory.model[i])]
    robot = RobotState.from_mujoco(
        env.physics.qpos[i].numpy(), env.physics.qvel[i].numpy(), carried=state.carried, wrist_pos=state.wrist_pos
    )
    percept = PerceptModel(state.carried)(*robot.to_mujoco(29))
    reading = read_fields(fields[env.bank.names[int(env.memory.scene[i])]], percept, task)
    action, phase = env.memory.action[i].numpy(), float(env.memory.phase[i])
    return observe(percept, reading, Carrying.of(state), action, phase, task.scan, np.asarray(past)), percept, reading


@pytest.mark.parametrize("steps", [0, 4])
@pytest.mark.parametrize("scan", [False, True])
def test_layout_is_the_environments(scan, steps):
    assert list(layout_of(PolicyTask(scan=scan, history=steps))) == ObservationTable(policy_rows(scan, steps)).layout()


@pytest.mark.parametrize(("preset", "scan"), [("dual_hodpf", False), ("dual_hodpf", True), ("dual_sgf", False)])
def test_observation_equals_the_environments(make_env, states, fields, preset, scan):
    env = make_env(preset, scan=scan)
    task = PolicyTask(object_field="ogf" if preset.endswith("hodpf") else "sgf", scan=scan)
    s = env.snapshot()
    wanted = env.policy_table(s).numpy()
    layout = layout_of(task)
    ends = np.cumsum([0, *(w for _, w in layout)])
    for i in range(env.num_envs):
        got, percept, reading = twin(env, states, fields, task, i)
        assert got.shape == wanted[i].shape and got.dtype == np.float32
        for (name, _), a, b in zip(layout, ends[:-1], ends[1:], strict=True):
            np.testing.assert_allclose(got[a:b], wanted[i, a:b], atol=1e-5, err_msg=f"{name} of environment {i}")
        np.testing.assert_allclose(percept.p_WK, s.p_WK[i, :11], atol=1e-6)
        np.testing.assert_allclose(reading.goal_distance[0], s.goal_distance[i], atol=1e-6)
        np.testing.assert_allclose(reading.speed[0], s.speed[i], atol=1e-5)


def test_observation_equals_the_environments_with_other_constants_too(make_env, states):
    """Fields of another eta, reach and margin, another walking speed and stop."""
    scenes, params = load_scenes(["beam", "gap"]), FieldParams(attraction=1.0, influence_distance_m=0.3, repulsion=2e-3)
    bank = FieldBank.build(scenes, 0.08, 0.05, params)
    constants = {"speed_m_s": 0.45, "stop_gain_hz": 1.5}
    env = make_env(bank=bank, scan=True, **constants)
    fields = {s.name: build_hod_pf(s, 0.08, 0.05, params) for s in scenes}
    s, task = env.snapshot(), PolicyTask(scan=True, **constants)
    wanted = env.policy_table(s).numpy()
    for i in range(env.num_envs):
        got, _, reading = twin(env, states, fields, task, i)
        np.testing.assert_allclose(got, wanted[i], atol=1e-5)
        np.testing.assert_allclose(reading.speed[0], s.speed[i], atol=1e-5)
    assert s.speed.max() == 0.45 and s.sgf.force_W.norm(dim=-1).min() > 0.6


def test_the_history_is_the_environments(make_env, states, fields):
    env, task = make_env(history=3), PolicyTask(history=3)
    generator = torch.Generator().manual_seed(0)
    observation, past = env.reset()[0], np.zeros((env.num_envs, 198))
    for _ in range(5):
        got = [twin(env, states, fields, task, i, past[i])[0] for i in range(env.num_envs)]
        np.testing.assert_allclose(got, observation, atol=1e-5)
        past = np.stack([remember(p, o) for p, o in zip(past, got, strict=True)])
        step = env.step(0.1 * torch.randn(env.num_envs, 20, generator=generator))
        assert not (step.outcome > 0).any()
        observation = step.policy
    assert np.ptp(past.reshape(-1, 3, 66), axis=1).max() > 0.01, "frames differ"


def test_the_two_fields_differ_near_obstacles(make_env, states, fields):
    """Otherwise the test above could not tell the presets apart."""
    env = make_env()
    both = [
        np.stack([twin(env, states, fields, PolicyTask(object_field=f), i)[0] for i in range(env.num_envs)])
        for f in ("ogf", "sgf")
    ]
    assert np.abs(both[0] - both[1]).max() > 0.1


def test_parts_are_views_of_one_vector(make_env, states, fields):
    _, percept, reading = twin(make_env(), states, fields, PolicyTask(), 0)
    for value in (percept, reading):
        kind = type(value)
        again = kind.of(**{name: getattr(value, name) for name in kind.SHAPES})
        np.testing.assert_array_equal(again.vector, value.vector)
        assert again.vector.shape == (kind.SIZE,) and np.isfinite(value.vector).all()
    percept.q[3] = 7.0
    assert 7.0 in percept.vector
    with pytest.raises(TypeError, match="exactly p_WP"):
        Percept.of(q=np.zeros(20))
