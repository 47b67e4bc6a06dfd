"""Poses that jump are refused until five agree."""

import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.model.frames import rotation_z
from hotice.safety import JumpLimits, PoseGate
from hotice.safety.limits import BOX_JUMP, POSE_JUMP

HERE = np.array([0.3, 0.0, 0.1])


@pytest.mark.parametrize("limits, far, turned", [(BOX_JUMP, 0.10, 20.0), (POSE_JUMP, 0.15, 10.0)])
def test_what_is_a_jump(limits, far, turned):
    for scale, good in ((0.98, True), (1.02, False)):
        gate = PoseGate(limits)
        assert gate.accepts(HERE, np.eye(3))
        assert gate.accepts(HERE + [0.0, scale * far, 0.0], np.eye(3)) is good
        gate = PoseGate(limits)
        assert gate.accepts(HERE, np.eye(3))
        assert gate.accepts(HERE, rotation_z(-scale * np.radians(turned))) is good


def test_steps_add_up():
    gate = PoseGate(BOX_JUMP)
    assert all(gate.accepts(HERE + [0.09 * k, 0.0, 0.0], np.eye(3)) for k in range(10))


def test_five_that_agree_are_believed():
    gate, there = PoseGate(BOX_JUMP), HERE + [0.5, 0.0, 0.0]
    assert gate.accepts(HERE, np.eye(3))
    assert [gate.accepts(there, np.eye(3)) for _ in range(6)] == [False] * 4 + [True] * 2
    assert not gate.accepts(HERE, np.eye(3)), "there is the truth now"


def test_what_does_not_agree_or_comes_back_is_not():
    gate = PoseGate(BOX_JUMP)
    assert gate.accepts(HERE, np.eye(3))
    assert not any(gate.accepts(HERE + [k, 0.0, 0.0], np.eye(3)) for k in range(1, 20))
    gate = PoseGate(BOX_JUMP)
    there = HERE + [0.5, 0.0, 0.0]
    assert gate.accepts(HERE, np.eye(3))
    for _ in range(5):
        assert [gate.accepts(there, np.eye(3)) for _ in range(4)] == [False] * 4
        assert gate.accepts(HERE, np.eye(3))


def test_tracking_moves_on():
    gate = PoseGate(POSE_JUMP)
    assert gate.accepts(HERE, np.eye(3))
    gate.track(HERE + [1.0, 0.0, 0.0], np.eye(3))
    assert gate.accepts(HERE + [1.1, 0.0, 0.0], np.eye(3)) and not gate.accepts(HERE, np.eye(3))


def test_limits_are_checked():
    with pytest.raises(InvalidConfig, match="agreeing is 0"):
        JumpLimits(distance_m=0.1, angle_rad=0.1, agreeing=0)
    with pytest.raises(InvalidConfig, match="distance_m is nan"):
        JumpLimits(distance_m=float("nan"), angle_rad=0.1)
