"""A run of a robot that is known by heart: 2 s at 50 Hz towards +x, and its log as guard and runner write it."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.kinds import GUARD_KINDS, RUNNER_KINDS, about_run, encode_event
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.runner.estimator import Estimate
from hotice.deploy.seeing.moments import estimate_record
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.model import g1, load_scene
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.robot_state import RobotState
from hotice.policy import PerceptModel, open_policy
from hotice.policy.guidance import FieldReading
from tests.deploy.simulated_fixture import carry as solved

BOX = (0.3, 0.3, 0.25, 1.5)
START_S, STEP_S, TICKS, BLIND = 1000.0, 0.02, 100, 10
"""Of the first `BLIND` ticks nothing is believed."""
EVENTS = (
    (999.5, Mode.DAMPING, Cause.OPERATOR, "start"),
    (1000.5, Mode.CARRY, Cause.OPERATOR, "carry"),
    (1001.0, Mode.CARRY, Cause.BOX_UNSEEN, "hold: the box was not seen for 2.1 s"),
    (1001.0, Mode.HOLD, Cause.BOX_UNSEEN, "the box was not seen for 2.1 s"),
    (1001.2, Mode.HOLD, Cause.OPERATOR, "lower: not now"),
    (1001.5, Mode.DAMPING, Cause.LEAN, "leans by 1.1 rad"),
)


@cache
def policy():
    session = open_policy("student")
    return SimpleNamespace(name="student", meta=session.meta)


def robot_at(i: int) -> RobotState:
    """The robot at tick `i`: 1 cm further each time, turned and tilted, the left knee bending."""
    carry = solved(BOX)
    held = RobotState.from_carry(carry)
    quat_WP = quat_mul(quat_from_yaw(0.5), quat_from_axis_angle(np.array([0.6, -0.8, 0.0]), 0.1))
    p_WP, joint_pos = np.array([0.01 * i, -0.2, 0.75]), held.joint_pos.copy()
    joint_pos[g1.ALL_JOINTS.index("left_knee_joint")] += 0.001 * i
    return RobotState(
        p_WP=p_WP,
        quat_WP=quat_WP,
        joint_pos=joint_pos,
        carried=carry.carried,
        p_WO=p_WP + quat_rotate(quat_WP, [0.3, 0.02, 0.1]),
        quat_WO=quat_mul(quat_WP, quat_from_yaw(0.05)),
    )


@cache
def _percepts():
    return PerceptModel(solved(BOX).carried)


def estimate_at(i: int) -> Estimate:
    percept = _percepts()(*robot_at(i).to_mujoco(29))
    return Estimate(percept=percept, pose_age_s=0.1, box_age_s=0.02 * i, box_verdict="hidden")


def reading_at(i: int) -> FieldReading:
    """Every field vector is (1, 0, i / 100)."""
    reading = FieldReading(np.zeros(FieldReading.SIZE))
    reading.force_W[:] = (1.0, 0.0, 0.01 * i)
    reading.c_W[:], reading.speed[0], reading.goal_distance[0] = (0.4, 0.0, 0.0), 0.4, 2.5 - 0.01 * i
    return reading


def status_at(i: int) -> np.ndarray:
    t = START_S + STEP_S * i
    status = np.zeros((), STATUS)
    # its cause is that of the mode
    entered = [EVENTS[0], *(event for before, event in pairwise(EVENTS) if event[1] is not before[1])]
    mode, cause = [(mode, cause) for began_s, mode, cause, _ in entered if began_s <= t][-1]
    status["mode"], status["cause"], status["sequence"], status["received_s"] = mode, cause, 10 * i + 1, t - 0.004
    status["state"]["motor_state"]["q"][JOINTS] = robot_at(i).joint_pos
    return status


def targets_at(i: int) -> np.ndarray:
    targets = np.zeros((), TARGETS)
    targets["number"], targets["stamp_s"], targets["warm"] = i + 1, START_S + STEP_S * i, 1
    targets["q"], targets["box_age_s"], targets["pose_age_s"] = 0.001 * i, np.inf, 0.1
    return targets


def write_run(folder, guard: bool = True, blind: int = BLIND, **about):
    """The run's log in a folder."""
    header = {**about_run(load_scene("gap"), solved(BOX).carried, policy()), **about}
    with LogWriter(folder, "runner", RUNNER_KINDS, header) as log:
        for i in range(TICKS):
            t = START_S + STEP_S * i
            log.write("status", t, status_at(i))
            log.write("targets", t, targets_at(i))
            log.write("lateness", t, np.array((0.0001 * i, 0.003), RUNNER_KINDS["lateness"]))
            if i >= blind:
                log.write("estimate", t, estimate_record(estimate_at(i)))
            if i >= 30:
                log.write("reading", t, reading_at(i).vector.tobytes())
    if guard:
        with LogWriter(folder, "guard", GUARD_KINDS) as log:
            for t, mode, cause, text in EVENTS:
                log.write("event", t, encode_event(mode, cause, text))
    return folder
