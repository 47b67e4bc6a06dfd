"""The pick-up task: its rule at the limit, labels that are the plan's, noise that is what was drawn, equal resumption.

`data/picks.npz` holds two boxes, a cylinder and a sphere, made by `draw_books` of `hotice.control.playback.draw`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.model import g1
from hotice.model.dynamics import ROBOT_NOMINAL
from hotice.model.picks.book import (
    FELT_M,
    LEAN_HZ,
    STIFFER,
    TRACK_PLACE,
    TRACK_RATE,
    PickBook,
    balance,
    hold_up,
)
from hotice.sim.observations import mirror_action
from hotice.sim.pickup import standing
from hotice.sim.pickup.env import PickUpEnv
from hotice.sim.pickup.snapshot import half_span
from hotice.sim.pickup.tables import POLICY
from hotice.task import rules
from hotice.task.config import TaskConfig
from hotice.task.pickup import LOST_S, perturbed, pickup_task
from hotice.task.rules import OUTCOMES
from hotice.task.sensing import SensingConfig

BOOK = Path(__file__).parent / "data" / "picks.npz"


@pytest.fixture
def by_the_plan(monkeypatch):
    """Knees may come as near to the support as the plan has them, so that a teacher has nothing to change."""
    monkeypatch.setattr(standing, "CLEAR_M", 0.0)


@pytest.fixture(scope="module")
def book():
    return PickBook.load(BOOK)


def make(book, n=4, **task):
    return PickUpEnv(n, book, config=replace(pickup_task(TaskConfig()), **task), threads=1)


def put(env, rows):
    """Starts environment i before pick rows[i]."""
    env.reset()
    env.memory.model[:] = torch.tensor(rows)
    env.starter.write(env, env.everyone, env.memory.model, env.generator)
    env.held[:] = env.carry.course_target[env.memory.model, 0]


def test_the_rule_holds_at_its_limits_and_not_just_beyond():
    at = (rules.IN_CARRY_M, rules.IN_CARRY_RAD, rules.LIFTED_M)
    assert rules.in_carry(*at)
    for i, step in enumerate((1e-6, 1e-6, -1e-6)):
        assert not rules.in_carry(*(v + step * (i == j) for j, v in enumerate(at)))
    assert rules.picked(250 * 0.02) and not rules.picked(249 * 0.02)
    assert rules.picked(torch.tensor([4.99, 5.0])).tolist() == [False, True]


def test_success_is_five_seconds_without_a_break(book):
    """The counter is cut to nothing by one step outside; success comes with the 250th step inside, not before."""
    env = make(book, 2)
    env.reset()
    s, no = env.snapshot(), torch.zeros(2, dtype=torch.bool)
    inside = replace(s, away=s.away * 0 + 0.08, turned=s.turned * 0, above=s.above * 0 + 0.02)
    outside = replace(inside, away=torch.tensor([0.08, 0.0801]))
    for _ in range(100):
        env._outcome(inside, no)
    env._outcome(outside, no)
    codes = [env._outcome(inside, no).tolist() for _ in range(149)]
    assert codes[-2] == [0, 0] and codes[-1] == [OUTCOMES.index("success"), 0]
    codes = [env._outcome(inside, no).tolist() for _ in range(101)]
    assert codes[-2][1] == 0 and codes[-1][1] == OUTCOMES.index("success")


def test_labels_are_the_books_targets_where_robot_and_plan_agree(book, by_the_plan):
    env = make(book, joint_noise_rad=0.0)
    put(env, [0, 1, 2, 3])
    for k in (0, 100, 300, book.steps - 1, book.steps + 50):
        env.memory.step[:] = k
        s = env.snapshot()
        course = torch.tensor(book.joint_pos[:, min(k, book.steps - 1)])
        zero = torch.zeros(4, 2)
        target = env.targets(env.label(replace(s, q=course, offset=zero, rate=zero)))
        np.testing.assert_allclose(target, book.target[:, min(k, book.steps - 1)], atol=1e-5)


def test_labels_add_balance_stiffness_and_the_true_gains(book, by_the_plan):
    env = make(book, joint_noise_rad=0.0)
    put(env, [0, 1, 2, 3])
    env.memory.step[:] = 200
    env.carry.kp[:] = env._kp * 1.25
    env.carry.joint_offset[:] = 0.01
    env.memory.leaning[:] = torch.tensor([0.01, 0.0])
    course = torch.tensor(book.joint_pos[:, 200])
    offset, rate = torch.tensor([[0.02, -0.01]] * 4), torch.tensor([[0.1, 0.05]] * 4)
    s = replace(env.snapshot(), q=course - 0.03, offset=offset, rate=rate)
    got = env.targets(env.label(s))
    wanted = course + (torch.tensor(book.target[:, 200]) - course) / 1.25 + 0.01
    wanted[:, g1.LOWER] += STIFFER * 0.03
    wanted = wanted + torch.tensor(balance(offset.numpy() + [0.01 * LEAN_HZ, 0.0], rate.numpy()))
    np.testing.assert_allclose(got, wanted, atol=1e-5)


def test_the_law_is_that_of_the_book_from_what_actors_read(book):
    """Torch and NumPy twins, also where both are clipped; whatever the action, the same is added."""
    env = make(book)
    env.reset()
    offset = torch.tensor([[0.05, -0.02], [FELT_M + 0.1, 0.0], [-0.1, 0.01], [0.0, -1.0]])
    rate = torch.tensor([[0.2, 0.1], [0.0, 2.0], [-3.0, 0.0], [0.1, 0.1]])
    env.read[:, env.policy_table.columns(["felt"])] = torch.cat([10.0 * offset, rate], dim=1)
    action = torch.rand(4, 20, generator=torch.Generator().manual_seed(0))
    alone = env.carry.target[env.memory.model] + env.action_scale * action
    np.testing.assert_allclose(env.targets(action) - alone, hold_up(offset.numpy(), rate.numpy()), atol=1e-6)
    env.step(action)
    kept = alone + torch.tensor(hold_up(offset.numpy(), rate.numpy()))
    np.testing.assert_allclose(env.physics.ctrl, kept, atol=1e-5)


def test_the_last_action_at_the_start_is_what_holds_the_start(book):
    env = make(book, joint_noise_rad=0.0)
    env.reset()
    target = env.targets(env.memory.action)
    np.testing.assert_allclose(target, env.carry.course_target[env.memory.model, 0], atol=1e-5)
    assert float(env.snapshot().above.abs().max()) < 0.01


@pytest.mark.slow
def test_the_teacher_picks_up_and_holds(book):
    """Robot and physics as in the protocol `robot`, nominal: a box, a cylinder and a sphere are held for 5 s."""
    env = PickUpEnv(4, book, config=replace(pickup_task(TaskConfig()), dynamics=ROBOT_NOMINAL), threads=1)
    env.restarts = False
    put(env, [0, 1, 2, 3])
    first = [0] * 4
    for _ in range(env.config.max_steps):
        code = env.step(env.label()).outcome.tolist()
        first = [a or b for a, b in zip(first, code, strict=True)]
        if all(first):
            break
    assert [OUTCOMES[c] for c in first] == ["success"] * 4


def test_the_objects_pose_is_off_by_what_was_drawn_and_rests_while_it_is_lost(book):
    """The first reading is off by at most 5 cm along each axis, and by the tilt; the filter brings it to the truth."""
    task = replace(pickup_task(TaskConfig()), joint_noise_rad=0.0)
    env = PickUpEnv(64, book, config=perturbed(task), threads=1, seed=3)
    env.reset()
    at = env.policy_table.columns(["object_pose"])

    def off():
        s = env.snapshot()
        true = s.to_yaw_frame(s.p_WO - s.p_WP)
        return (env.read[:, at][:, :3] - true).abs()

    first = off()
    assert 0.03 < float(first.max()) < 0.08
    losses = torch.zeros(64)
    for _ in range(50):
        before = env.sensors.object.clone()
        lost_before = env.sensors.lost.clone()
        env.step(env.label())
        still = (env.sensors.object - before).abs().amax(dim=(1, 2)) == 0.0
        assert torch.equal(still, env.sensors.lost > 0)
        assert (env.sensors.lost <= torch.where(lost_before > 0, lost_before - 1, 1 + int(LOST_S / 0.02))).all()
        losses += (env.sensors.lost > 0).float()
    assert 0.02 < float(losses.mean()) / 50 < 0.25
    assert float(off().mean()) < 0.6 * float(first.mean())


def test_the_felt_offset_is_that_of_encoders_and_tilt(book):
    """Without noise the truth, filtered by hand; an encoder that is off moves it by the lever of its joint."""
    sensing = SensingConfig(action_delay_s=0.005)
    env = PickUpEnv(2, book, config=replace(pickup_task(TaskConfig()), sensing=sensing), threads=1)
    env.reset()
    place, rate = env.snapshot().felt[:, :2], torch.zeros(2, 2)
    for _ in range(20):
        env.step(env.label())
        foreseen = place + 0.02 * rate
        off = env.snapshot().felt[:, :2] - foreseen
        place, rate = foreseen + TRACK_PLACE * off, rate + TRACK_RATE / 0.02 * off
        np.testing.assert_allclose(env.sensors.felt, torch.cat([place, rate], dim=1), atol=2e-4)
    s, ids = env.snapshot(), env.everyone
    env.sensors.age[:] = 0
    moved = {}
    for joint in ("hip_pitch", "ankle_pitch"):
        wrong = torch.zeros(2, 20)
        wrong[:, [g1.ACTION_JOINTS.index(f"{side}_{joint}_joint") for side in g1.SIDES]] = 0.02
        env.sensors.age[:] = 0
        moved[joint] = float((env.sensors.measure(s, ids, wrong, env.generator).felt - s.felt)[:, 0].abs().max())
    # the hip moves both feet by its lever, the ankle no more than the sole's own point
    assert 0.009 < moved["hip_pitch"] < 0.016 and moved["ankle_pitch"] < 0.003


def test_what_no_robot_knows_is_not_in_the_observation(book):
    """True mass, forces, the plan's joints and the true pose change critics' rows alone."""
    env = make(book)
    env.reset()
    s = env.snapshot()
    changed = replace(
        s,
        grasp=replace(s.grasp, mass=s.grasp.mass + 1.0),
        course_q=s.course_q + 1.0,
        offset=s.offset + 1.0,
        torque=s.torque + 9.0,
        away=s.away + 1.0,
        touch=~s.touch,
    )
    size = env.policy_table.size
    np.testing.assert_array_equal(env.policy_table(s), env.policy_table(changed))
    felt = s.felt
    env.carry.true_pelvis[:] += 0.1
    env.carry.true_rate[:] += 0.1
    np.testing.assert_array_equal(env.snapshot().felt, felt)
    assert (env.snapshot().offset != s.offset).all()
    assert (env.critic_table(s)[:, size:] != env.critic_table(changed)[:, size:]).any()
    assert {"gyro", "gravity", "object_pose", "object_mass", "support"} <= {row.name for row in POLICY}


def test_the_span_of_turned_objects():
    """Lowest points by hand: a box on its edge, a cylinder lying and leaning, a sphere."""
    cos, sin = np.cos(np.pi / 4), np.sin(np.pi / 4)
    lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    leaning = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    R = torch.tensor(np.stack([leaning, lying, leaning, leaning]), dtype=torch.float32)
    half = torch.tensor([[0.1, 0.2, 0.3], [0.1, 0.1, 0.3], [0.1, 0.1, 0.3], [0.2, 0.2, 0.2]])
    span = half_span(R, half, torch.tensor([0, 1, 1, 2]))
    np.testing.assert_allclose(span[:, 2], [0.4 * cos, 0.1, 0.4 * cos, 0.2], atol=1e-6)
    np.testing.assert_allclose(span[1], [0.3, 0.1, 0.1], atol=1e-6)


def test_observation_and_action_mirror_back(book):
    env = make(book)
    policy, critic = env.reset()
    for table, value in ((env.policy_table, policy), (env.critic_table, critic)):
        np.testing.assert_array_equal(table.mirror(table.mirror(value)), value)
    action = torch.randn(3, 20, generator=torch.Generator().manual_seed(0))
    np.testing.assert_array_equal(mirror_action(mirror_action(action)), action)


def test_a_restored_environment_goes_on_bit_for_bit(book):
    task = perturbed(pickup_task(TaskConfig()))
    one, other = (PickUpEnv(3, book, config=task, threads=1, seed=5) for _ in range(2))
    one.reset()
    for _ in range(5):
        one.step(one.label())
    state = one.state()
    other.reset()
    other.load_state(state)
    a, b = (env.step(env.label()) for env in (one, other))
    assert torch.equal(a.policy, b.policy) and torch.equal(a.critic, b.critic) and torch.equal(a.reward, b.reward)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"episode_s": 12.0}, "to succeed"),
        ({"substeps": 5}, "control period"),
        ({"physics": "warp"}, "needs? 'mujoco'|need"),
    ],
)
def test_what_cannot_be_is_refused(book, change, message):
    physics = change.pop("physics", "mujoco")
    with pytest.raises(InvalidConfig, match=message):
        PickUpEnv(2, book, physics=physics, config=replace(pickup_task(TaskConfig()), **change))
