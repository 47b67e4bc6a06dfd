"""Messages with random but possible contents, and of a robot that is known."""

import numpy as np

from hotice.deploy.messages.hg import JOINTS, LOW_CMD, LOW_STATE
from hotice.model.frames import quat_from_yaw, quat_mul


def filled(struct, rng, *, dirty=False):
    """A record () with random contents in every field, float numbers in −1 to 1; `dirty`: its padding random too."""
    raw = rng.integers(0, 256, struct.dtype.itemsize, np.uint8) if dirty else np.zeros(struct.dtype.itemsize, np.uint8)
    for p in struct.primitives:
        value = rng.uniform(-1, 1, 1).astype("<f4").tobytes() if p.kind == "f32" else rng.bytes(p.size)
        raw[p.offset : p.offset + p.size] = np.frombuffer(value, np.uint8)
    return raw.view(struct.dtype).reshape(())


def low_state(rng, tick=1, machine=5):
    state = filled(LOW_STATE, rng)
    state["imu_state"]["quaternion"] = (1.0, 0.0, 0.0, 0.0)
    state["mode_pr"], state["mode_machine"], state["tick"] = 0, machine, tick
    state["wireless_remote"] = 0
    return state


def low_cmd(rng, machine=5):
    command = filled(LOW_CMD, rng)
    command["mode_pr"], command["mode_machine"] = 0, machine
    command["motor_cmd"]["mode"] = 1
    return command


def state_of(robot, yaw_of_imu=0.7):
    """LowState of a robot, its IMU's heading off by `yaw_of_imu`."""
    state = LOW_STATE.zeros()
    state["imu_state"]["quaternion"] = quat_mul(quat_from_yaw(yaw_of_imu), robot.quat_WP)
    state["imu_state"]["gyroscope"] = robot.w_WP_P
    motors = state["motor_state"][JOINTS]
    motors["q"], motors["dq"] = robot.joint_pos, robot.joint_vel
    return state
