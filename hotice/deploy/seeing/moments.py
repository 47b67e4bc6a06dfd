"""Moments: all that is shown of one tick of the runner, as a fixed record; and the robot's pose in one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.modes import Mode
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.runner.around import Around
from hotice.deploy.runner.estimator import Estimate
from hotice.model import g1
from hotice.model.frames import mat_to_quat
from hotice.model.scene import MAX_MOVING
from hotice.policy.guidance import FieldReading
from hotice.policy.measuring import attitude
from hotice.policy.percept import NUM_SGF, Percept

Array = NDArray[np.float64]


MOMENT = np.dtype(
    [
        ("time_s", "<f8"),
        ("late_s", "<f8"),
        ("mode", "<u4"),
        ("cause", "<u4"),
        ("state_age_s", "<f8"),
        ("known", "u1"),
        ("joint_pos", "<f8", len(g1.ALL_JOINTS)),
        ("percept", [(name, "<f8", shape) for name, shape in Percept.SHAPES.items()]),
        ("pose_age_s", "<f8"),
        ("box_age_s", "<f8"),
        ("disputed", "u1"),
        ("pose_verdict", "S40"),
        ("box_verdict", "S40"),
        ("movers", "<u4"),
        ("movers_age_s", "<f8"),
        ("movers_pose", "<f8", (MAX_MOVING, 7)),
    ]
)
"""When the tick began, and how much later than a period after the one before [s] (live: the worst since the moment
before); mode and cause by number; age of the state, inf before the first [s]; whether anything is believed yet;
measured joints in the order of `g1.ALL_JOINTS` [rad]; what was believed, with its ages [s] and verdicts; of how many
obstacles that move it is known where they are, since when, and where: position [m] and quaternion wxyz in W."""


def moment(
    status: np.ndarray,
    estimate: Estimate | None,
    *,
    time_s: float,
    late_s: float = 0.0,
    around: Around | None = None,
) -> np.ndarray:
    """A moment () of `MOMENT`.

    Args:
        status: the guard's, a record () of `STATUS`
        estimate: of this tick, None while nothing is believed
        time_s: when the tick began [s]; late_s: how much later than a period after the one before [s]
        around: what moves, after this tick
    """
    shown = np.zeros((), MOMENT)
    shown["time_s"], shown["late_s"] = time_s, late_s
    shown["mode"], shown["cause"] = status["mode"], status["cause"]
    shown["state_age_s"] = time_s - status["received_s"] if status["sequence"] else np.inf
    shown["joint_pos"] = status["state"]["motor_state"]["q"][JOINTS]
    if around is not None and around.poses is not None:
        shown["movers"], shown["movers_age_s"] = len(around.poses), around.age_s
        shown["movers_pose"][: len(around.poses)] = around.poses
    if estimate is None:
        return shown
    shown["known"] = 1
    shown["percept"] = np.frombuffer(estimate.percept.vector.tobytes(), MOMENT["percept"])[0]
    for name in ("pose_age_s", "box_age_s", "disputed", "pose_verdict", "box_verdict"):
        shown[name] = getattr(estimate, name)
    return shown


def quat_of_pelvis(shown: np.ndarray) -> Array:
    """The pelvis' attitude quat_WP (4,) wxyz in a moment (): heading and direction of gravity."""
    percept = shown["percept"]
    return mat_to_quat(attitude(float(percept["yaw"][0]), percept["gravity_P"]))


def state_of(shown: np.ndarray) -> Array:
    """MuJoCo's qpos (43,) of a moment (): pelvis, 29 joints, object."""
    percept = shown["percept"]
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
    pose, box = (np.asarray(shown[name]).item() for name in ("pose_verdict", "box_verdict"))
    return pose.decode(errors="replace"), box.decode(errors="replace")


def percept_of(shown: np.ndarray) -> Percept:
    """What was believed in a moment ()."""
    return Percept(np.frombuffer(shown["percept"].tobytes(), np.float64))


def arrows_of(percept: Percept, reading: FieldReading) -> tuple[Array, Array]:
    """Points (19, 3) [m] and field vectors (19, 3) there, both in W; vectors of zero where they are not finite."""
    points = np.concatenate([percept.p_WK, percept.p_WOK])
    return points, np.where(np.isfinite(reading.force_W), reading.force_W, 0.0)


def is_ogf(object_field: str, count: int = 19) -> NDArray[np.bool_]:
    """(19,) which arrows are of the object's own field, if the policy reads one (`PolicyTask.object_field`)."""
    return (np.arange(count) >= NUM_SGF) & (object_field == "ogf")


def complete(moments: np.ndarray) -> NDArray[np.bool_]:
    """(T,) which moments (T,) hold a robot that can be shown: one that is known, by numbers that are finite."""
    percept = moments["percept"]
    parts = (percept["p_WP"], percept["yaw"], percept["gravity_P"], percept["p_WO"], percept["R_WO"], percept["p_WK"])
    parts = (*parts, percept["p_WOK"], moments["joint_pos"])
    return (moments["known"] == 1) & np.all(
        [np.isfinite(part).all(axis=tuple(range(1, part.ndim))) for part in parts], axis=0
    )


def named(kind: type[Mode] | type[Cause], number: int) -> str:
    """Name of a mode or cause as it is shown; that of a later version by its number."""
    return spoken(kind(number).name) if number in set(kind) else f"{kind.__name__.lower()} {number}"


def spoken(name: str) -> str:
    """Name of a mode or cause as it is shown."""
    return name.lower().replace("_", " ")


CALM = frozenset(spoken(cause.name) for cause in (Cause.NONE, Cause.OPERATOR, Cause.DONE))
"""Causes, as they are shown, that are no faults."""
