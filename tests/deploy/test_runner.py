"""The runner: what it gives the guard in each mode, and a carry from the gantry to the goal."""

from dataclasses import replace

import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.estimate import TrackingEstimator
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.guard import Guard
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.runner import CarryPolicy, Estimate, RobotRunner
from hotice.deploy.slot.records import STATUS
from hotice.fields import build_hod_pf
from hotice.fields.potential import FieldParams
from hotice.model import g1, load_scene
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.robot_state import RobotState
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.policy import PerceptModel, open_policy, read_fields
from hotice.policy.guidance import read_standing
from tests.deploy.messages_fixture import state_of
from tests.deploy.simulated_fixture import Lab
from tests.deploy.simulated_fixture import carry as solved

BOX = (0.3, 0.3, 0.25, 1.5)
STEP_S = 0.002


@pytest.fixture(scope="module")
def carry():
    return solved(BOX)


@pytest.fixture(scope="module")
def policy():
    return open_policy("student")


@pytest.fixture(scope="module")
def pf(policy, carry):
    task = CarryPolicy(policy, carry).task
    return build_hod_pf(load_scene("gap"), task.resolution_m, task.margin_m)


def a_robot(carry, rng):
    held = RobotState.from_carry(carry)
    tilt = quat_from_axis_angle(np.array([0.6, -0.8, 0.0]), 0.1)
    quat_WP = quat_mul(quat_from_yaw(-2.0), tilt)
    return RobotState(
        p_WP=np.array([1.0, -0.5, 0.72]),
        quat_WP=quat_WP,
        w_WP_P=rng.normal(size=3),
        joint_pos=held.joint_pos + 0.05 * rng.normal(size=29),
        joint_vel=rng.normal(size=29),
        carried=carry.carried,
        p_WO=np.array([1.0, -0.5, 0.72]) + quat_rotate(quat_WP, [0.3, 0.02, 0.1]),
        quat_WO=quat_mul(quat_WP, quat_from_yaw(0.05)),
    )


class Known:
    """An estimator that knows the truth, or nothing."""

    def __init__(self, robot):
        self.robot, self.disputed = robot, False

    def update(self, state, now_s, state_s=None):
        if self.robot is None:
            return None
        percept = PerceptModel(self.robot.carried)(*self.robot.to_mujoco(29))
        return Estimate(percept=percept, pose_age_s=0.1, box_age_s=0.2, disputed=self.disputed)

    def acknowledge(self):
        self.disputed = False

    def settle(self):
        self.disputed = False


class Desk:
    """A runner whose guard is a status written by hand."""

    def __init__(self, policy, pf, carry, robot):
        self.clock, self.status, self.put = SimulatedClock(1.0), np.zeros((), STATUS), []
        self.known = Known(robot)
        self.runner = RobotRunner(
            policy,
            pf,
            carry,
            self.known,
            lambda: self.status,
            lambda t: self.put.append(t.copy()),
            self.clock,
        )

    def tick(self, mode, robot):
        self.status["mode"], self.status["sequence"], self.status["state"] = mode, 7, state_of(robot)
        before = len(self.put)
        self.runner.tick()
        self.clock.sleep(0.02)
        return self.put[-1] if len(self.put) > before else None


def test_targets_by_mode(policy, pf, carry, rng):
    robot = a_robot(carry, rng)
    desk = Desk(policy, pf, carry, robot)
    rest = desk.runner.all_joints(carry.joint_target)
    assert not desk.tick(Mode.OFF, robot)["warm"]
    desk.runner.warm()
    for mode in (Mode.OFF, Mode.DAMPING, Mode.POSTURE, Mode.READY):
        targets = desk.tick(mode, robot)
        assert (targets["q"] == rest).all() and targets["warm"] and not targets["done"]
    assert targets["number"] == 5 and targets["stamp_s"] == pytest.approx(1.08) and targets["state_sequence"] == 7
    percept = PerceptModel(carry.carried)(*robot.to_mujoco(29))
    for mode in (Mode.CARRY, Mode.HOLD, Mode.LOWER, Mode.PICK_UP):
        desk.tick(Mode.READY, robot)  # forgets the action before
        ours = CarryPolicy(policy, carry)
        reading = read_fields(pf, percept, ours.task)
        here = np.array([*percept.p_WP[:2], GOAL_HEIGHT_M])
        expected = ours.act(
            percept,
            reading if mode is Mode.CARRY else read_standing(reading, percept, here, ours.task, pf.params.attraction),
        )
        targets = desk.tick(mode, robot)
        np.testing.assert_allclose(targets["q"], desk.runner.all_joints(expected), atol=1e-4)
        assert np.abs(targets["q"] - rest).max() > 0.01


@pytest.mark.parametrize("eta", [0.6, 1.0])
def test_who_stands_is_drawn_back_to_where_standing_began(policy, pf, carry, rng, eta):
    """As strongly as the fields draw it elsewhere."""
    pf = replace(pf, params=FieldParams(attraction=eta))
    robot = a_robot(carry, rng)
    desk = Desk(policy, pf, carry, robot)
    ours = CarryPolicy(policy, carry)
    place = np.array([*robot.p_WP[:2], GOAL_HEIGHT_M])
    for i, mode in enumerate((Mode.CARRY, Mode.HOLD, Mode.HOLD, Mode.LOWER)):
        p_WP = robot.p_WP + [0.02 * max(i - 1, 0), 0.0, 0.0]
        desk.known.robot = moved = replace(robot, p_WP=p_WP, p_WO=robot.p_WO + p_WP - robot.p_WP)
        percept = PerceptModel(carry.carried)(*moved.to_mujoco(29))
        reading = read_fields(pf, percept, ours.task)
        if mode is not Mode.CARRY:
            reading = read_standing(reading, percept, place, ours.task, eta)
        expected = ours.act(percept, reading)
        np.testing.assert_allclose(desk.tick(mode, robot)["q"], desk.runner.all_joints(expected), atol=1e-4)
    walked = ours.task.speed_m_s
    assert reading.goal_distance[0] == pytest.approx(0.04) and 0.0 < reading.speed[0] < walked
    # who walked on in between stands where it stops next
    desk.tick(Mode.CARRY, robot)
    desk.tick(Mode.HOLD, robot)
    np.testing.assert_allclose(desk.runner._place_W, [*p_WP[:2], GOAL_HEIGHT_M])


def test_joints_that_the_policy_does_not_move(policy, pf, carry, rng):
    runner = Desk(policy, pf, carry, a_robot(carry, rng)).runner
    q = dict(zip(g1.ALL_JOINTS, runner.all_joints(np.arange(1.0, 21.0)), strict=True))
    assert [q[joint] for joint in g1.ACTION_JOINTS] == list(range(1, 21))
    assert [q[joint] for joint in g1.WAIST_JOINTS] == [0.0] * 3
    assert [q[joint] for joint in g1.WRIST_JOINTS] == carry.wrist_pos.tolist()


def test_who_does_not_know_where_it_is_gives_no_targets_for_walking(policy, pf, carry, rng):
    robot = a_robot(carry, rng)
    desk = Desk(policy, pf, carry, None)
    assert desk.tick(Mode.READY, robot)["pose_age_s"] == np.inf
    assert desk.tick(Mode.CARRY, robot) is None


@pytest.mark.parametrize("mode", Mode)
def test_a_dispute_is_told_and_ends_where_a_key_goes_on(policy, pf, carry, rng, mode):
    """Before a carry too: localization that was set right on the gantry would refuse every carry otherwise."""
    robot = a_robot(carry, rng)
    desk = Desk(policy, pf, carry, robot)
    desk.known.disputed = True
    assert desk.tick(mode, robot)["pose_disputed"] == 1
    ends = mode not in (Mode.PICK_UP, Mode.CARRY, Mode.LOWER)
    assert desk.tick(mode, robot)["pose_disputed"] == (not ends)


def test_a_place_that_is_disputed_is_not_gone_by(policy, pf, carry, rng):
    """From the first tick on, before the guard holds: the policy reads a goal where it is."""
    robot = a_robot(carry, rng)
    percept, ours = PerceptModel(carry.carried)(*robot.to_mujoco(29)), CarryPolicy(policy, carry)
    desk = Desk(policy, pf, carry, robot)
    desk.known.disputed = True
    here = np.array([*percept.p_WP[:2], GOAL_HEIGHT_M])
    reading = read_standing(read_fields(pf, percept, ours.task), percept, here, ours.task, pf.params.attraction)
    expected = desk.runner.all_joints(ours.act(percept, reading))
    np.testing.assert_allclose(desk.tick(Mode.CARRY, robot)["q"], expected, atol=1e-4)


def test_a_policy_that_answers_nonsense_gives_no_targets(policy, pf, carry, rng):
    robot = a_robot(carry, rng)
    ours = CarryPolicy(policy, carry)
    percept = PerceptModel(carry.carried)(*robot.to_mujoco(29))
    reading = read_fields(pf, percept, ours.task)
    good = CarryPolicy(policy, carry).act(percept, reading)
    percept.q[3] = np.nan
    assert ours.act(percept, reading) is None
    percept.q[3] = robot.joint_pos[3]
    np.testing.assert_array_equal(ours.act(percept, reading), good)


def test_the_goal_is_told(policy, pf, carry, rng):
    robot = a_robot(carry, rng)
    goal = np.array([*load_scene("gap").goal, 0.72])
    desk = Desk(policy, pf, carry, replace(robot, p_WP=goal + [0.11, 0.0, 0.0]))
    assert not desk.tick(Mode.CARRY, robot)["done"]
    desk.known.robot = replace(robot, p_WP=goal + [0.09, 0.0, 0.0])
    assert desk.tick(Mode.CARRY, robot)["done"] and not desk.tick(Mode.HOLD, robot)["done"]
    # it stands at the goal, not where it was near enough
    np.testing.assert_array_equal(desk.runner._place_W, [*load_scene("gap").goal, GOAL_HEIGHT_M])


def test_the_same_actions_as_in_a_diagram(policy, pf, carry, rng):
    pytest.importorskip("pydrake")
    from pydrake.systems.analysis import Simulator

    from hotice.systems.policy import PolicySystem

    robot = a_robot(carry, rng)
    percept = PerceptModel(carry.carried)(*robot.to_mujoco(29))
    system, ours = PolicySystem(policy, carry), CarryPolicy(policy, carry)
    reading = read_fields(pf, percept, ours.task)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    system.GetInputPort("percept").FixValue(context, percept.vector)
    system.GetInputPort("guidance").FixValue(context, reading.vector)
    for step in range(5):
        simulator.AdvanceTo(step * ours.task.control_dt_s + 1e-6)
        np.testing.assert_array_equal(system.GetOutputPort("joint_target").Eval(context), ours.act(percept, reading))


class Chain:
    """Robot, guard and runner in lock step; localization and the box's pose are the truth."""

    def __init__(self, policy, pf, **config):
        self.lab = Lab(start="held", scene=pf.scene, **config)
        self.slot = self.status = None
        self.wishes, self.events, self.count = set(), [], 0
        world = self.lab.world
        estimator = TrackingEstimator(world.carry.carried, self.lab.pelvis, self.lab.box)
        self.runner = RobotRunner(policy, pf, world.carry, estimator, lambda: self.status, self._put, self.lab.clock)
        self.runner.warm()
        self.guard = Guard(
            self.lab.link,
            lambda: self.slot,
            self._tell,
            self.lab.clock,
            GuardConfig(posture_s=2.0),
            wishes=self._asked,
            charge=lambda: 80.0,
            on_event=self.events.append,
        )

    def go(self, seconds, until=lambda: False):
        for _ in range(round(seconds / STEP_S)):
            if self.count % 10 == 0:
                self.runner.tick()
            self.guard.tick()
            self.lab.clock.sleep(STEP_S)
            self.count += 1
            if until():
                return

    def ask(self, request):
        self.wishes = {Request(request)}
        self.go(STEP_S)

    def _asked(self):
        asked, self.wishes = self.wishes, set()
        return asked

    def _put(self, targets):
        self.slot = targets.copy()

    def _tell(self, status):
        self.status = status.copy()


def to_the_carry(chain):
    """Hanging, brakes, posture, the box handed over, lowered."""
    robot, guard = chain.lab.robot, chain.guard
    chain.go(0.6)
    chain.ask("start")
    chain.go(0.2)
    chain.ask("posture")
    chain.go(2.1)
    assert guard.mode is Mode.READY
    robot.press("F1")
    chain.go(3.0, lambda: robot.handing.stage == "held")
    chain.go(0.5)
    robot.press("F1")
    chain.go(1.0)
    robot.press("F2")
    chain.go(6.0, lambda: robot.gantry._slack)
    chain.ask("carry")


@pytest.mark.slow
@pytest.mark.parametrize("what", ["turned", "silent"])
def test_who_is_not_sure_of_its_place_stands(policy, pf, what):
    """Localization is turned by 3 rad in mid-walk, or falls silent: the robot holds, by legs and gyro, where it is."""
    chain = Chain(policy, pf)
    true, wrong, last = chain.lab.pelvis, False, None

    def look(*_):
        nonlocal last
        if wrong and what == "turned":
            return true()._replace(quat=quat_mul(quat_from_yaw(3.0), true().quat))
        last = last if wrong else true()
        return last

    chain.runner._estimator._pelvis = look
    to_the_carry(chain)
    chain.go(1.5)
    assert chain.guard.mode is Mode.CARRY
    wrong = True
    chain.go(0.3 if what == "turned" else 1.1)
    cause = "POSE_DISPUTED" if what == "turned" else "POSE_AGE"
    assert chain.guard.mode is Mode.HOLD and chain.guard.cause.name == cause, chain.events
    pelvis = chain.lab.world.data.body(g1.ROOT_BODY)
    place = pelvis.xpos.copy()
    chain.go(5.0)
    print(np.linalg.norm(pelvis.xpos - place))
    assert chain.guard.mode is Mode.HOLD and pelvis.xmat[8] > 0.9 and np.linalg.norm(pelvis.xpos - place) < 0.3
    chain.ask("carry")
    chain.go(0.1)
    assert (chain.guard.mode is Mode.CARRY) is (what == "turned"), "who goes on by key takes what it insists on"


@pytest.mark.slow
def test_from_the_gantry_to_the_goal(policy, pf):
    """The whole way: to the carry, carried through the gap, held there, stopped."""
    chain = Chain(policy, pf)
    guard = chain.guard
    to_the_carry(chain)
    chain.go(10.0, lambda: guard.mode is not Mode.CARRY)
    assert guard.mode is Mode.HOLD and guard.cause.name == "DONE", chain.events
    chain.go(2.0)
    place = chain.lab.world.data.body(g1.ROOT_BODY).xpos
    assert np.hypot(*(place[:2] - pf.scene.goal)) < 0.15 and place[2] > 0.6 and guard.mode is Mode.HOLD
    assert chain.lab.box().p[2] > 0.0 and guard.targets.refused == 0
    chain.ask("stop")
    assert guard.mode is Mode.DAMPING
