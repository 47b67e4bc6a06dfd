"""Faults by name, and answers to them, each in the order of severity: the larger number wins."""

from __future__ import annotations

from enum import IntEnum


class Fault(IntEnum):
    """Why the robot does not go on as before; `NONE`: it does."""

    NONE = 0
    # where to go and what is held is not known
    BOX_LATE = 1
    """No pose of the object for longer than `AgeLimits.box_s`."""
    BOX_INVALID = 2
    """A pose of the object that is not finite, no pose, or too far from the pelvis."""
    BOX_JUMP = 3
    """A pose of the object too far from the one before."""
    POSE_LATE = 4
    """No pose of the pelvis for longer than `AgeLimits.pose_s`."""
    POSE_INVALID = 5
    """A pose of the pelvis that is not finite, under the floor or above `MeasurementLimits.highest_pelvis_m`."""
    POSE_JUMP = 6
    """A pose of the pelvis too far from the tracked one."""
    GUIDANCE_INVALID = 7
    """Fields or command of the way that are not finite."""
    # the controller fails
    JOINT_LIMIT = 8
    """A joint is beyond its range."""
    COMMAND_LATE = 9
    """No new command for longer than `AgeLimits.command_s`."""
    OBSERVATION_INVALID = 10
    """What the policy reads is not finite; it was not asked."""
    ACTION_INVALID = 11
    """What the policy answered is not finite."""
    CONTROLLER_ERROR = 12
    """The controller gave up; its message is kept."""
    COMMAND_STEP = 13
    """A joint target too far from the one before."""
    COMMAND_RANGE = 14
    """A joint target beyond the joint's range, or a torque beyond the motor's."""
    COMMAND_NOT_FINITE = 15
    """A command that is not finite."""
    # the robot's own state is not known
    STATE_LATE = 16
    """States come, but old ones."""
    STATE_FROZEN = 17
    """The tick stands still, or a moving robot's numbers do."""
    STATE_MISSING = 18
    """No state ever came."""
    STATE_IMPOSSIBLE = 19
    """A joint angle or a speed that no robot can have."""
    QUATERNION = 20
    """The pelvis' quaternion is far from unit length."""
    STATE_NOT_FINITE = 21
    """A number of the measured state is not finite."""
    # it falls
    FALLING = 22
    """The pelvis leans, and goes on leaning so fast that it will soon lean too far."""
    JOINT_SPEED = 23
    """A joint is faster than in any trained motion."""
    GYRO = 24
    """The pelvis turns too fast."""
    PELVIS_LOW = 25
    """The pelvis is too low."""
    TILT = 26
    """The pelvis leans too far."""


class Answer(IntEnum):
    """What is done about a fault."""

    PASS = 0
    """The command passes; the fault is counted. What was lost is held: an object's pose in the pelvis frame."""
    STOP_WALKING = 1
    """The controller is told to stand where it is, upright and balancing."""
    REPEAT = 2
    """The last valid command is given again."""
    HOLD = 3
    """Joints stay where they were at the last valid command; nobody balances, and the robot topples within seconds."""
    DAMP = 4
    """Joints only damp, the arms after a second in which they keep what they hold; final."""
