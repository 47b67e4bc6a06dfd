"""The messages of Unitree's humanoids (`unitree_hg`): LowCmd, LowState, IMU and battery, field by field.

Names, order and types: the vendor's published definitions (unitree_sdk2, unitree_sdk2_python; BSD-3-Clause). Units:
rad, rad/s, N m, m/s² and percent. Joints: slot i is `g1.ALL_JOINTS[i]`, slots 29 to 34 are not used.
"""

from hotice.deploy.messages.structs import Field, Struct

NAMESPACE = "unitree_hg.msg.dds_"
SLOTS = 35
JOINTS = slice(0, 29)
"""The slots of the 29 joints, in the order of `g1.ALL_JOINTS`."""

MOTOR_CMD = Struct(
    "MotorCmd_",
    (
        Field("mode", "u8"),
        Field("q", "f32"),
        Field("dq", "f32"),
        Field("tau", "f32"),
        Field("kp", "f32"),
        Field("kd", "f32"),
        Field("reserve", "u32"),
    ),
)
"""tau_motor = tau + kp (q − q_measured) + kd (dq − dq_measured); `mode` 1 enables the motor, 0 disables it."""

LOW_CMD = Struct(
    "LowCmd_",
    (
        Field("mode_pr", "u8"),
        Field("mode_machine", "u8"),
        Field("motor_cmd", MOTOR_CMD, SLOTS),
        Field("reserve", "u32", 4),
        Field("crc", "u32"),
    ),
)

IMU_STATE = Struct(
    "IMUState_",
    (
        Field("quaternion", "f32", 4),
        Field("gyroscope", "f32", 3),
        Field("accelerometer", "f32", 3),
        Field("rpy", "f32", 3),
        Field("temperature", "i16"),
    ),
)
"""quaternion w, x, y, z of the IMU in a level frame; in LowState the pelvis', on `rt/secondary_imu` the torso's."""

MOTOR_STATE = Struct(
    "MotorState_",
    (
        Field("mode", "u8"),
        Field("q", "f32"),
        Field("dq", "f32"),
        Field("ddq", "f32"),
        Field("tau_est", "f32"),
        Field("temperature", "i16", 2),
        Field("vol", "f32"),
        Field("sensor", "u32", 2),
        Field("motorstate", "u32"),
        Field("reserve", "u32", 4),
    ),
)
"""temperature: casing, winding [°C]; `motorstate` 0 is fine, else bits of errors."""

LOW_STATE = Struct(
    "LowState_",
    (
        Field("version", "u32", 2),
        Field("mode_pr", "u8"),
        Field("mode_machine", "u8"),
        Field("tick", "u32"),
        Field("imu_state", IMU_STATE),
        Field("motor_state", MOTOR_STATE, SLOTS),
        Field("wireless_remote", "u8", 40),
        Field("reserve", "u32", 4),
        Field("crc", "u32"),
    ),
)

BMS_STATE = Struct(
    "BmsState_",
    (
        Field("version_high", "u8"),
        Field("version_low", "u8"),
        Field("fn", "u8"),
        Field("cell_vol", "u16", 40),
        Field("bmsvoltage", "u32", 3),
        Field("current", "i32"),
        Field("soc", "u8"),
        Field("soh", "u8"),
        Field("temperature", "i16", 12),
        Field("cycle", "u16"),
        Field("manufacturer_date", "u16"),
        Field("bmsstate", "u32", 5),
        Field("reserve", "u32", 3),
    ),
)
"""`soc`: charge [percent]."""

PITCH_ROLL, ANKLES_AB = 0, 1
"""`mode_pr`: pitch and roll of ankles and waist (ours), or their two parallel actuators."""

MACHINES = {
    1: "deprecated",
    2: "deprecated",
    3: "deprecated",
    4: "23 joints",
    5: "29 joints",
    6: "29 joints, waist locked",
    9: "arms only",
    10: "23 joints, hip gears 22.5",
    11: "29 joints, hip gears 22.5",
    12: "29 joints, waist locked, hip gears 22.5",
    13: "29 joints, new wrist motor",
    14: "29 joints, waist locked, new wrist motor",
    15: "29 joints, new wrist motor",
    16: "29 joints, waist locked, new wrist motor",
}
"""`mode_machine`: the robot says which machine it is, and a command echoes it (unitree_ros, g1_description)."""

_WAIST_ROLL_PITCH = (13, 14)
ABSENT: dict[int, tuple[int, ...]] = {
    5: (),
    6: _WAIST_ROLL_PITCH,
    11: (),
    12: _WAIST_ROLL_PITCH,
    13: (),
    14: _WAIST_ROLL_PITCH,
    15: (),
    16: _WAIST_ROLL_PITCH,
}
"""Of each machine that may be commanded, the joints (indices into `g1.ALL_JOINTS`) that have no motor on it."""
