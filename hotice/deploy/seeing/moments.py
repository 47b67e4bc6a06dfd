"""Moments: all that is shown of one tick of the runner, as a fixed record; and the robot's pose in one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.log.kinds import ESTIMATE, READING
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.runner.estimator import Estimate
from hotice.model.frames import mat_to_quat
from hotice.policy.guidance import FieldReading
from hotice.policy.measuring import attitude
from hotice.policy.percept import NUM_SGF

Array = NDArray[np.float64]

MOMENT = np.dtype(
    [
        ("time_s", "<f8"),
        ("mode", "<u4"),
        ("cause", "<u4"),
        ("joint_pos", "<f8", 29),
        ("estimate", ESTIMATE),
        ("guided", "u1"),
        ("reading", READING),
        ("late_s", "<f8"),
        ("state_age_s", "<f8"),
    ]
)
"""Time when the tick began [s], mode and cause by number, measured joints in the order of `g1.ALL_JOINTS` [rad], what
was believed, whether fields were read and what they said, how late the tick began [s], age of the state [s]."""


def estimate_record(estimate: Estimate) -> np.ndarray:
    """An estimate as a record () of `ESTIMATE`."""
    record = np.zeros((), ESTIMATE)
    record["percept"] = np.frombuffer(estimate.percept.vector.tobytes(), ESTIMATE["percept"])[0]
    for name in ("pose_age_s", "box_age_s", "disputed", "pose_verdict", "box_verdict"):
        record[name] = getattr(estimate, name)
    return record


def moment(
    status: np.ndarray,
    estimate: Estimate | np.ndarray,
    reading: FieldReading | np.ndarray | None,
    *,
    time_s: float,
    late_s: float = 0.0,
) -> np.ndarray:
    """A moment () of `MOMENT`.

    Args:
        status: the guard's, a record () of `STATUS`
        estimate: of this tick; reading: of the fields, None where none were read
        time_s: when the tick began [s]; late_s: how late that was [s]
    """
    shown = np.zeros((), MOMENT)
    shown["time_s"], shown["late_s"] = time_s, late_s
    shown["mode"], shown["cause"] = status["mode"], status["cause"]
    shown["state_age_s"] = time_s - status["received_s"]
    shown["joint_pos"] = status["state"]["motor_state"]["q"][JOINTS]
    shown["estimate"] = estimate_record(estimate) if isinstance(estimate, Estimate) else estimate
    if reading is not None:
        shown["guided"] = 1
        vector = reading.vector if isinstance(reading, FieldReading) else reading
        shown["reading"] = np.frombuffer(vector.tobytes(), READING)[0]
    return shown


def quat_of_pelvis(shown: np.ndarray) -> Array:
    """The pelvis' attitude quat_WP (4,) wxyz in a moment (): heading and direction of gravity."""
    percept = shown["estimate"]["percept"]
    return mat_to_quat(attitude(float(percept["yaw"][0]), percept["gravity_P"]))


def state_of(shown: np.ndarray) -> Array:
    """MuJoCo's qpos (43,) of a moment (): pelvis, 29 joints, object."""
    percept = shown["estimate"]["percept"]
    return np.concatenate(
        [
            percept["p_WP"],
            quat_of_pelvis(shown),
            shown["joint_pos"],
            percept["p_WO"],
            mat_to_quat(percept["R_WO"]),
        ]
    )


def verdicts_of(shown: np.ndarray) -> tuple[str, str]:
    """What a moment () says of the newest pose of localization and of the newest look at the object."""
    pose, box = (np.asarray(shown["estimate"][name]).item() for name in ("pose_verdict", "box_verdict"))
    return pose.decode(errors="replace"), box.decode(errors="replace")


def arrows_of(shown: np.ndarray) -> tuple[Array, Array]:
    """Points (19, 3) [m] and field vectors (19, 3) there, both in W; vectors of zero where no fields were read."""
    percept = shown["estimate"]["percept"]
    return np.concatenate([percept["p_WK"], percept["p_WOK"]]), shown["reading"]["force_W"]


def is_ogf(object_field: str, count: int = 19) -> NDArray[np.bool_]:
    """(19,) which arrows are of the object's own field, if the policy reads one (`PolicyTask.object_field`)."""
    return (np.arange(count) >= NUM_SGF) & (object_field == "ogf")


def complete(moments: np.ndarray) -> NDArray[np.bool_]:
    """(T,) which moments (T,) hold a robot that can be shown: numbers that are finite."""
    percept = moments["estimate"]["percept"]
    parts = (percept["p_WP"], percept["yaw"], percept["gravity_P"], percept["p_WO"], percept["R_WO"], percept["p_WK"])
    parts = (*parts, percept["p_WOK"], moments["joint_pos"], moments["reading"]["force_W"])
    return np.all([np.isfinite(part).all(axis=tuple(range(1, part.ndim))) for part in parts], axis=0)
