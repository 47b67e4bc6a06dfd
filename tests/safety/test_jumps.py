"""Poses that jump are refused until five agree."""

import numpy as np
import pytest

from hotice.errors import InvalidConfig
from hotice.model.frames import rotation_z
from hotice.safety import JumpLimits, PoseGate
from hotice.safety.jumps import AGREED, NEAR, REFUSED, jump_limits
from hotice.safety.limits import BOX_JUMP, POSE_JUMP
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

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


def test_a_gate_says_why_it_accepts():
    gate, there = PoseGate(BOX_JUMP), HERE + [0.5, 0.0, 0.0]
    said = [gate.judge(p, np.eye(3)) for p in (HERE, HERE, there, there, there, there, there, there)]
    assert said == [NEAR, NEAR, *[REFUSED] * 4, AGREED, NEAR]


def test_noise_of_sensors_is_no_jump():
    """Two poses of the filter's first mean, or of none, are as far apart as the corners of their noise."""
    assert jump_limits(SensingConfig()) == (POSE_JUMP, BOX_JUMP)
    place, box = jump_limits(STUDENT_SENSING)
    assert place.distance_m == pytest.approx(0.15 + 2 * 0.02 * np.sqrt(3)) and box.agreeing == BOX_JUMP.agreeing
    assert place.angle_rad == pytest.approx(np.radians(10.0) + 0.06)
    assert box.distance_m == pytest.approx(0.10 + 0.05 * np.sqrt(3))
    raw = jump_limits(SensingConfig(object_pos_m=0.05, object_rot_rad=2.0, root_hz=10.0))
    assert raw[1].distance_m == pytest.approx(0.10 + 0.10 * np.sqrt(3)) and raw[1].angle_rad == np.pi
    assert raw[0].distance_m == pytest.approx(0.25) and raw[0].angle_rad == pytest.approx(np.radians(10.0) + 0.2)


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
