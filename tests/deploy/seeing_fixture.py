"""A run of a robot that is known by heart: 2 s at 50 Hz towards +x, and its log as guard and runner write it."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.programs.prepare import Prepared, prepare
from hotice.deploy.recording.guard_log import KINDS as GUARD_KINDS
from hotice.deploy.recording.replay import digests
from hotice.deploy.recording.runner_log import ESTIMATE, kinds, width
from hotice.deploy.runner.estimator import Estimate
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.model import g1
from hotice.model.frames import quat_from_axis_angle, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.robot_state import RobotState
from hotice.policy import PerceptModel
from tests.deploy.simulated_fixture import carry as solved

BOX = (0.3, 0.3, 0.25, 1.5)
START_S, STEP_S, TICKS, BLIND = 1000.0, 0.02, 100, 10
"""Of the first `BLIND` ticks nothing is believed."""
DROPPED, LATE = 50, 70
"""Tick whose status is not in the log; tick from which on all are 5 ms later."""
EVENTS = (
    (999.5, Mode.DAMPING, Cause.OPERATOR, "start"),
    (1000.5, Mode.CARRY, Cause.OPERATOR, "carry"),
    (1001.0, Mode.CARRY, Cause.BOX_UNSEEN, "hold: the box was not seen for 2.1 s"),
    (1001.0, Mode.HOLD, Cause.BOX_UNSEEN, "the box was not seen for 2.1 s"),
    (1001.2, Mode.HOLD, Cause.OPERATOR, "lower: not now"),
    (1001.5, Mode.DAMPING, Cause.LEAN, "leans by 1.1 rad"),
)


OPTIONS = RunnerOptions(slot="none", scene="gap", policy="student", box=BOX, pose_port=1, tags_port=2, log="none")


@cache
def made() -> Prepared:
    return prepare(OPTIONS, lambda stage: None)


def time_of(i: int) -> float:
    return START_S + STEP_S * i + 0.005 * (i >= LATE)


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


def status_at(i: int) -> np.ndarray:
    t = time_of(i)
    status = np.zeros((), STATUS)
    # its cause is that of the mode
    entered = [EVENTS[0], *(event for before, event in pairwise(EVENTS) if event[1] is not before[1])]
    mode, cause = [(mode, cause) for began_s, mode, cause, _ in entered if began_s <= t][-1]
    status["mode"], status["cause"], status["sequence"], status["received_s"] = mode, cause, 10 * i + 1, t - 0.004
    status["state"]["motor_state"]["q"][JOINTS] = robot_at(i).joint_pos
    return status


def targets_at(i: int) -> np.ndarray:
    targets = np.zeros((), TARGETS)
    targets["number"], targets["stamp_s"], targets["warm"] = i + 1, time_of(i), 1
    targets["q"], targets["box_age_s"], targets["pose_age_s"] = 0.001 * i, np.inf, 0.1
    return targets


def estimate_entry(estimate: Estimate) -> np.ndarray:
    entry = np.zeros((), ESTIMATE)
    entry["percept"], entry["disputed"] = estimate.percept.vector, estimate.disputed
    entry["pose_age_s"], entry["box_age_s"] = estimate.pose_age_s, estimate.box_age_s
    return entry


def write_run(folder, guard: bool = True, blind: int = BLIND, **about):
    """The run's log in a folder; the status of tick `DROPPED` is not in it."""
    header = {"options": OPTIONS.text(), **digests(made()), **about}
    with LogWriter(folder, "runner", kinds(width(made().policy)), header) as log:
        for i in range(TICKS):
            t = time_of(i)
            if i != DROPPED:
                log.write("status", t, status_at(i))
            log.write("targets", t, targets_at(i))
            if i >= blind:
                log.write("estimate", t, estimate_entry(estimate_at(i)))
    if guard:
        with LogWriter(folder, "guard", GUARD_KINDS) as log:
            for t, mode, cause, text in EVENTS:
                said = {"mode": mode.name, "cause": cause.name, "text": text}
                log.write("event", t, json.dumps(said).encode())
    return folder
