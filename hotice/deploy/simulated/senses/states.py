"""States of a simulated robot as LowState records: what its encoders, IMU, motors and battery say, with noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.messages.hg import BMS_STATE, JOINTS, LOW_STATE, PITCH_ROLL
from hotice.deploy.simulated.senses.inertial import UP, Imu, conjugate, product, roll_pitch_yaw, rotated, tilted
from hotice.deploy.simulated.world import STEP_S, World
from hotice.model import g1
from hotice.model.frames import quat_from_yaw, yaw_from_quat
from hotice.model.joint_limits import torque_limits
from hotice.task.sensing import SensingConfig

Array = NDArray[np.float64]
KNEE = g1.ALL_JOINTS.index("left_knee_joint")
KNEES = KNEE, g1.ALL_JOINTS.index("right_knee_joint")
TICKS = round(1e3 * STEP_S)
"""Ticks from state to state: milliseconds, as the vendor's examples count; not known of the robot."""
AMBIENT_C, FULL_LOAD_C = 30.0, 90.0
"""Temperature of a motor at rest, and by how much it would rise at its torque limit for ever (ours)."""
WINDING_S, CASING_S, CASING_SHARE = 60.0, 300.0, 0.6
"""Time constants of winding and casing, and how much of the rise the casing takes over (ours)."""
RUNTIME_S = 7200.0
"""From full to empty (the maker says about two hours)."""
CELLS, FULL_CELL_MV, EMPTY_CELL_MV = 13, 4150, 3300


class StateWriter:
    """Writes one state after each physics step of a world; every state draws as many random numbers."""

    def __init__(
        self, world: World, sensing: SensingConfig, machine: int, battery_percent: float, rng: np.random.Generator
    ) -> None:
        self._world, self._sensing, self._rng = world, sensing, rng
        self._imu = Imu(world.model)
        self._record = LOW_STATE.zeros()
        self._record["mode_pr"], self._record["mode_machine"] = PITCH_ROLL, machine
        # the IMU counts its heading from where it was switched on
        self._turn = quat_from_yaw(-yaw_from_quat(world.data.qpos[g1.ROOT_QUAT]))
        self._limit = torque_limits()
        self._winding, self._casing = np.full(29, AMBIENT_C), np.full(29, AMBIENT_C)
        self._speed_before = world.joint_vel.copy()
        self._charge = battery_percent
        self.extra_heat, self.knee_error, self.knee_offset_rad = 0.0, 0, 0.0
        self.swapped = False
        """For mishaps: added to every winding's temperature [°C]; bits of the left knee's error; what its encoder reads
        beside the truth [rad]; whether both knees are swapped."""

    def write(self, remote: np.ndarray, on: np.ndarray) -> np.ndarray:
        """A new LowState () without checksum. `remote`: bytes of the gamepad (40,); `on`: which motors are, (29,)."""
        world, sensing, record = self._world, self._sensing, self._record
        data = world.data
        draws = self._rng.uniform(-1.0, 1.0, 64)
        torque = np.where(on, data.actuator_force, 0.0)
        self._warm(torque)
        record["tick"] = (int(record["tick"]) + TICKS) % (1 << 32)
        record["wireless_remote"] = remote
        motors = record["motor_state"]
        motors["mode"][JOINTS] = on
        motors["q"][JOINTS] = world.joint_pos + world.motors.offset + sensing.joint_pos_rad * draws[:29]
        motors["dq"][JOINTS] = world.joint_vel + sensing.joint_vel_rad_s * draws[29:58]
        motors["ddq"][JOINTS] = (world.joint_vel - self._speed_before) / STEP_S
        motors["tau_est"][JOINTS] = torque
        motors["temperature"][JOINTS, 0] = np.round(self._casing)
        motors["temperature"][JOINTS, 1] = np.round(self._winding + self.extra_heat)
        motors["motorstate"][KNEE] = self.knee_error
        motors["q"][KNEE] += self.knee_offset_rad
        if self.swapped:
            motors[list(KNEES)] = motors[list(KNEES[::-1])]
        motors["vol"][JOINTS] = 1e-3 * CELLS * self._cell_mv
        self._speed_before = world.joint_vel.copy()
        self._write_imu(draws[58:61], draws[61:])
        return record.copy()

    def battery(self) -> np.ndarray:
        """The battery now, BmsState ()."""
        record = BMS_STATE.zeros()
        record["soc"], record["soh"] = round(self._charge), 100
        record["cell_vol"][:CELLS] = round(self._cell_mv)
        record["bmsvoltage"][0] = round(CELLS * self._cell_mv)
        record["temperature"] = round(AMBIENT_C)
        return record

    def set_charge(self, percent: float) -> None:
        """Sets the battery's charge [percent]."""
        self._charge = percent

    @property
    def _cell_mv(self) -> float:
        return EMPTY_CELL_MV + (FULL_CELL_MV - EMPTY_CELL_MV) * 0.01 * self._charge

    def _warm(self, torque: Array) -> None:
        rise = FULL_LOAD_C * np.square(torque / self._limit)
        self._winding += STEP_S / WINDING_S * (AMBIENT_C + rise - self._winding)
        self._casing += STEP_S / CASING_S * (AMBIENT_C + CASING_SHARE * rise - self._casing)
        self._charge = max(0.0, self._charge - 100.0 * STEP_S / RUNTIME_S)

    def _write_imu(self, u_gyro: Array, u_gravity: Array) -> None:
        imu, sensing = self._record["imu_state"], self._sensing
        true = self._imu.read(self._world.data.qpos, self._world.data.qvel)
        quat = product(self._turn, true.quaternion)
        if sensing.gravity:
            quat = tilted(quat, rotated(conjugate(quat), -UP) + sensing.gravity * u_gravity)
        imu["quaternion"], imu["rpy"] = quat, roll_pitch_yaw(quat)
        imu["gyroscope"] = true.gyroscope + sensing.gyro_rad_s * u_gyro
        imu["accelerometer"] = true.accelerometer
        imu["temperature"] = round(AMBIENT_C)
