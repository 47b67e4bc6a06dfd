"""What ends an episode, each on purpose."""

import dataclasses

import numpy as np
import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.sim.rewards import TERMINATION_PENALTY
from hotice.sim.terminations import TERMINATIONS
from hotice.task.rules import OUTCOMES

STILL = torch.zeros(8, 20)


def ended(step, i=0):
    return OUTCOMES[int(step.outcome[i])]


def put(env, i, *, xyz=(0.0, 0.0, 0.0), object_xyz=None):
    """Shifts environment i, and its object by as much or by `object_xyz`."""
    shift = torch.tensor(xyz, dtype=torch.float64)
    env.physics.qpos[i, :3] += shift
    env.physics.qpos[i, 27:30] += shift if object_xyz is None else torch.tensor(object_xyz, dtype=torch.float64)
    env.physics.forward(torch.tensor([i]))


def scene_with(position, size, name="blocked"):
    return Scene(name, obstacles=(Obstacle("it", "side", BoxShape(size), position),))


def test_nothing_ends_a_robot_that_stands(env):
    for _ in range(5):
        step = env.step(STILL)
        assert (step.outcome == 0).all() and not (step.terminated | step.truncated).any()


def test_fall_by_leaning_over(env):
    half = np.deg2rad([70, 70, 30]) / 2
    for i, axis in enumerate((4, 5, 5)):
        env.physics.qpos[i, 3:7] = 0.0
        env.physics.qpos[i, 3], env.physics.qpos[i, axis] = np.cos(half[i]), np.sin(half[i])
    env.physics.forward(torch.arange(8))
    step = env.step(STILL)
    assert [ended(step, i) for i in range(2)] == ["fall", "fall"] and ended(step, 2) != "fall"
    assert step.terminated.tolist()[:2] == [True, True] and not step.terminated[3:].any() and not step.truncated.any()


def test_drop_sideways_and_to_the_floor(env):
    put(env, 0, object_xyz=(0.25, 0, 0.1))
    put(env, 1, object_xyz=(0.4, 0, -0.7))
    step = env.step(STILL)
    assert [ended(step, i) for i in range(3)] == ["drop", "drop", "running"]


@pytest.fixture(scope="module")
def blocked(make_env):
    """Scenes with one obstacle where the robot's hip, or only the object, of a robot at x = 0 can be put."""
    bank = FieldBank.build(
        [scene_with((1.0, 0.6, 0.5), (0.2, 0.3, 1.0)), scene_with((1.0, 0.0, 1.1), (0.1, 2.0, 0.6), "bar")]
    )
    return make_env(4, bank=bank)


def test_robot_and_object_collisions(blocked):
    env = blocked
    env.reset()
    env.memory.scene[:] = torch.tensor([0, 0, 1, 1])
    put(env, 0, xyz=(1.0, 0.5, 0.0))  # beside: inside the obstacle
    put(env, 1, xyz=(0.2, -0.5, 0.0))  # clear of it
    front = 1.0 - 0.05 - float(env.carry.grasp.half_extents[env.memory.model[2], 0])
    x = front + 0.03 - float(env.physics.qpos[2, 27] - env.physics.qpos[2, 0])
    env.physics.qpos[2, 27] += x - float(env.physics.qpos[2, 0])
    env.physics.qpos[2, 0] = x  # the object reaches 3 cm into the bar, the hands do not
    env.physics.forward(torch.arange(4))
    s = env.snapshot()
    assert s.robot_hit.tolist()[:2] == [True, False] and s.object_hit.tolist()[1:] == [False, True, False]
    outcome = env._outcome(
        dataclasses.replace(s, robot_hit=s.robot_hit & torch.tensor([True, True, False, True])), torch.zeros(4).bool()
    )
    assert [OUTCOMES[o] for o in outcome] == ["robot_collision", "running", "object_collision", "running"]
    assert s.clearance[0] < 0 < s.clearance[1] and s.object_clearance[2] < 0 < s.object_clearance[3]
    step = env.step(torch.zeros(4, 20))
    assert ended(step, 0) == "robot_collision" and step.terminated[0]
    assert ended(step, 2) in ("object_collision", "robot_collision") and ended(step, 1) == "running"


def test_collisions_can_be_switched_off(make_env):
    env = make_env(1, bank=FieldBank.build([scene_with((1.0, 0.6, 0.5), (0.2, 0.3, 1.0))]), collisions=False)
    env.reset()
    put(env, 0, xyz=(1.0, 0.5, 0.0))
    assert ended(env.step(torch.zeros(1, 20))) == "running"


def test_timeout_truncates_without_penalty(make_env):
    env = make_env(2, episode_s=0.06)
    env.reset()
    steps = [env.step(torch.zeros(2, 20)) for _ in range(4)]
    assert [ended(s) for s in steps] == ["running", "running", "timeout", "running"]
    assert steps[2].truncated.all() and not steps[2].terminated.any()
    assert [s.length.tolist() for s in steps] == [[1, 1], [2, 2], [3, 3], [1, 1]]
    assert (steps[2].reward > 0.5 * TERMINATION_PENALTY).all()
    assert not torch.equal(steps[2].final_critic, steps[2].critic)
    torch.testing.assert_close(steps[1].final_critic, steps[1].critic)


def test_failure_costs_each_agent_the_penalty_once(env):
    saved = env.state()
    fine = env.step(STILL)
    env.load_state(saved)
    put(env, 0, object_xyz=(0.0, 0.0, 0.16))
    step = env.step(STILL)
    assert ended(step) == "drop"
    streams = step.terms[0] @ env.rewards.weight
    torch.testing.assert_close(step.reward[0], streams + TERMINATION_PENALTY)
    torch.testing.assert_close(step.reward[1:], fine.reward[1:])


def snapshot_where(s, **flags):
    """Rows of a quiet snapshot with the given conditions made true."""
    p_WP, p_WO = s.p_WP.clone(), s.p_WO.clone()
    if flags.get("fall"):
        p_WP[:, 2] = 0.2
    if flags.get("drop"):
        p_WO[:, 2] = 0.1
    yes, no = torch.ones(8, dtype=torch.bool), torch.zeros(8, dtype=torch.bool)
    return dataclasses.replace(
        s,
        p_WP=p_WP,
        p_WO=p_WO,
        robot_hit=yes if flags.get("robot") else no,
        object_hit=yes if flags.get("object") else no,
        goal_distance=torch.full((8,), 0.05 if flags.get("goal") else 1.0),
    )


@pytest.mark.parametrize(
    "flags, expected",
    [
        (dict(), "running"),
        (dict(goal=True), "success"),
        (dict(goal=True, late=True), "success"),
        (dict(goal=True, robot=True), "robot_collision"),
        (dict(goal=True, object=True), "object_collision"),
        (dict(goal=True, drop=True), "drop"),
        (dict(late=True), "timeout"),
        (dict(late=True, object=True), "object_collision"),
        (dict(robot=True, object=True), "robot_collision"),
        (dict(drop=True, robot=True, object=True), "drop"),
        (dict(fall=True, drop=True, robot=True, object=True, goal=True, late=True), "fall"),
        (dict(fall=True, broken=True), "unstable"),
    ],
)
def test_priority(make_env, env, flags, expected):
    """A failure wins over success in the same step, success over the time limit."""
    s = snapshot_where(env.snapshot(), **flags)
    object.__setattr__(env, "config", dataclasses.replace(env.config, end_at_goal=True))
    env.memory.step[:] = env.config.max_steps if flags.get("late") else 3
    broken = torch.full((8,), bool(flags.get("broken")))
    outcome = env._outcome(s, broken)
    env.config = dataclasses.replace(env.config, end_at_goal=False)
    assert [OUTCOMES[o] for o in outcome] == [expected] * 8


def test_without_end_at_goal_the_episode_goes_on(env):
    s = snapshot_where(env.snapshot(), goal=True)
    assert (env._outcome(s, torch.zeros(8).bool()) == 0).all()


def test_a_stay_at_the_goal_is_cut_short_after_its_mean_time(make_env):
    """Drawn in every step, so the mean of 1,600 draws a step apart is the time asked for; away from the goal nothing is
    cut."""
    env = make_env(8, goal_stay_s=0.1)
    env.reset()
    running = torch.zeros(8).bool()
    there, away = snapshot_where(env.snapshot(), goal=True), snapshot_where(env.snapshot())
    cut = torch.stack([env._outcome(there, running) for _ in range(200)])
    assert set(cut.unique().tolist()) == {0, OUTCOMES.index("timeout")}
    share = float((cut > 0).float().mean())
    assert env.config.control_dt_s / share == pytest.approx(0.1, rel=0.15)
    assert all((env._outcome(away, running) == 0).all() for _ in range(200))


def test_reaching_the_goal_ends_a_trial_with_success(make_env):
    env = make_env(2, end_at_goal=True)
    env.reset()
    goal = env.bank.goal_W[env.memory.scene[0]]
    shift = (goal - env.snapshot().p_WP[0]).double()
    put(env, 0, xyz=(float(shift[0]) + 0.06, float(shift[1]), 0.0))
    step = env.step(torch.zeros(2, 20))
    assert ended(step) == "success" and step.terminated[0] and step.reached[0]
    assert 0.0 < float(step.goal_distance[0]) < 0.1
    torch.testing.assert_close(step.reward[0], step.terms[0] @ env.rewards.weight)


def test_exact_geometry_scores_where_the_models_hold_obstacles(make_env, states):
    """The simulator's own contacts decide, in whichever substep they happen."""
    from hotice.sim.carry_bank import CarryBank

    scene = scene_with((1.0, 0.0, 1.1), (0.1, 2.0, 0.6))
    carry = CarryBank.of(states[:1], 0.005, torch.device("cpu"), scene=scene)
    env = make_env(2, carry=carry, bank=FieldBank.build([scene]))
    env.reset()
    put(env, 0, xyz=(float(0.95 - env.physics.qpos[0, 27] - 0.15 - 0.002), 0.0, 0.0))  # 2 mm before the bar
    env.physics.qvel[0, [0, 26]] = 0.5
    outcomes = [ended(env.step(torch.zeros(2, 20))) for _ in range(3)]
    assert "object_collision" in outcomes
    assert int(env.memory.step[1]) == 3


def test_outcomes_are_known():
    assert OUTCOMES[0] == "running" and {t.name for t in TERMINATIONS} < set(OUTCOMES)
    assert [t.name for t in TERMINATIONS if t.collision] == ["robot_collision", "object_collision"]
