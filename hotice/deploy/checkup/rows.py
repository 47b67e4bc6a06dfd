"""Rows of the check: a number each, what is needed, and whether it is there. Pure functions of what was observed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.checkup.watch import Observed
from hotice.deploy.command import LIMITS
from hotice.deploy.estimate.pelvis import pelvis_in_scene
from hotice.deploy.frames import WAIST
from hotice.deploy.guard.limits import GuardLimits
from hotice.deploy.messages.hg import ABSENT, JOINTS, MACHINES, PITCH_ROLL
from hotice.model import g1
from hotice.model.frames import normalize, quat_to_mat
from hotice.model.source import MapSource
from hotice.safety.limits import MeasurementLimits

Array = NDArray[np.float64]
STATE_HZ = 450.0
"""Least states a second: the maker says 500."""
POSE_HZ, TAGS_HZ = 8.0, 20.0
"""Least poses of localization and pictures of the camera a second: 10 and 30 are trained and usual."""
GRAVITY_MS2, GRAVITY_OFF_MS2, GRAVITY_OFF_RAD = 9.81, 0.5, math.radians(3.0)
"""An accelerometer at rest measures so much, upwards; deviations that are allowed (ours)."""
STILL_RAD_S, STATES_MEANT = 0.1, 50
"""Largest rate of a robot that is held still, in the mean of so many states: a gyro is noisy."""
UPRIGHT_RAD = math.radians(20.0)
"""Largest lean of one that hangs or stands."""
BEYOND_RAD = MeasurementLimits().joint_margin_rad
"""How far a joint may be measured beyond its range."""
TIMER_MS = 10.0
"""Largest lateness of the timer; a guard's command may then be as late."""
MAP_TILT_RAD, FLOOR_M = math.radians(2.0), 0.03
"""Between gravity by the map and by the IMU; between the floor by the map and under the soles."""


class Row(NamedTuple):
    """One line of the table."""

    name: str
    value: str
    needed: str
    passed: bool | None
    """None: not looked at."""


def all_rows(observed: Observed, *, source: MapSource | None = None, stands: bool = False) -> list[Row]:
    """Every row. `source`: the scene's place in the map, None: the scene is the map; `stands`: on the scene's floor."""
    return [
        *_of_states(observed),
        *_of_newest(observed),
        *_of_network(observed),
        _of_timer(observed),
        *_of_sources(observed),
        *_of_map(observed, source, stands),
    ]


def _of_states(observed: Observed) -> Iterator[Row]:
    rate = len(observed.states) / observed.seconds
    # who falls silent is so until the end
    ends_s = (observed.began_s, observed.began_s + observed.seconds)
    gaps_ms = 1e3 * np.diff([ends_s[0], *observed.state_s, ends_s[1]])
    limit_ms = 1e3 * GuardLimits().state_warn_s
    worst = float(gaps_ms.max())
    yield Row("states a second", f"{rate:.0f}", f"{STATE_HZ:.0f} at least", rate >= STATE_HZ)
    yield Row("longest gap between states", f"{worst:.1f} ms", f"{limit_ms:.0f} ms at most", worst <= limit_ms)
    yield Row("states refused", f"{observed.refused}", "none", observed.refused == 0)


def _of_newest(observed: Observed) -> Iterator[Row]:
    if not observed.states:
        return
    state, limits = observed.states[-1], GuardLimits()
    machine, motors = int(state["mode_machine"]), state["motor_state"][JOINTS]
    missing = ABSENT.get(machine)
    said = f"{machine} ({MACHINES.get(machine, 'unknown')})"
    yield Row("machine", said, "one that is commanded", missing is not None)
    yield Row("waist", "free" if not missing else "locked", "free, as the policy moves it", missing == ())
    yield Row("mode_pr", f"{state['mode_pr']}", f"{PITCH_ROLL}", int(state["mode_pr"]) == PITCH_ROLL)
    yield from _of_imu(observed)
    q = np.array([each["motor_state"]["q"][JOINTS] for each in observed.states], dtype=float)
    beyond = np.maximum(LIMITS.lower - q, q - LIMITS.upper).max(axis=0)
    worst = int(beyond.argmax())
    yield Row(
        "joint beyond its range",
        f"{g1.ALL_JOINTS[worst]} {beyond[worst]:+.3f} rad",
        f"{BEYOND_RAD:g} rad at most",
        bool(beyond[worst] <= BEYOND_RAD),
    )
    # one that comes and goes is an error too
    errors = np.bitwise_or.reduce([each["motor_state"]["motorstate"][JOINTS] for each in observed.states])
    wrong = [f"{g1.ALL_JOINTS[i]} {int(errors[i]):#x}" for i in np.flatnonzero(errors)]
    yield Row("motors' errors", ", ".join(wrong) or "none", "none", not wrong)
    casing, winding = motors["temperature"].max(axis=0).tolist()
    yield Row(
        "warmest casing, winding",
        f"{casing} °C, {winding} °C",
        f"{limits.casing_c:g} °C, {limits.winding_c:g} °C at most",
        casing <= limits.casing_c and winding <= limits.winding_c,
    )


def _of_imu(observed: Observed) -> Iterator[Row]:
    imu = [each["imu_state"] for each in observed.states]
    up = up_of(observed)
    a = np.mean([each["accelerometer"] for each in imu], axis=0, dtype=float)
    gyro = np.array([each["gyroscope"] for each in imu], dtype=float)
    parts = np.array_split(gyro, max(1, round(len(gyro) / STATES_MEANT)))
    fastest = float(np.abs([part.mean(axis=0) for part in parts]).max())
    strength = float(np.linalg.norm(a))
    apart = math.acos(float(np.clip(a @ up / max(strength, 1e-9), -1.0, 1.0)))
    lean = math.acos(float(np.clip(up[2], -1.0, 1.0)))
    yield Row(
        "accelerometer at rest",
        f"{strength:.2f} m/s²",
        f"{GRAVITY_MS2} ± {GRAVITY_OFF_MS2} m/s²",
        abs(strength - GRAVITY_MS2) <= GRAVITY_OFF_MS2,
    )
    yield _angle("accelerometer against attitude (upwards)", apart, GRAVITY_OFF_RAD)
    yield _angle("lean", lean, UPRIGHT_RAD)
    yield Row("gyro at rest", f"{fastest:.3f} rad/s", f"{STILL_RAD_S:g} rad/s at most", fastest <= STILL_RAD_S)


def _of_network(observed: Observed) -> Iterator[Row]:
    least, charge = GuardLimits().battery_start_percent, observed.charge
    yield Row("gamepad", "there" if observed.gamepad else "none", "there", observed.gamepad)
    full = charge is not None and charge >= least
    yield Row("battery", "unknown" if charge is None else f"{charge:g} %", f"{least:g} % at least", full)
    others = observed.foreign_commands
    yield Row("commands of somebody else", f"{others}", "none", others == 0)


def _of_timer(observed: Observed) -> Row:
    worst = 1e3 * observed.lateness.worst_late_s
    said = f"{worst:.2f} ms late at most, {observed.lateness.skipped} of {observed.lateness.ticks} left out"
    return Row("this machine's timer at 500 Hz", said, f"{TIMER_MS:g} ms at most", worst <= TIMER_MS)


def _of_sources(observed: Observed) -> Iterator[Row]:
    for name, came, least in (
        ("poses of localization a second", observed.pose_s, POSE_HZ),
        ("pictures of the camera a second", observed.tag_s, TAGS_HZ),
    ):
        rate = len(came) / observed.seconds
        yield Row(name, f"{rate:.1f}", f"{least:g} at least", rate >= least)
    seen = sorted({int(tag) for sample in observed.tags for tag in sample.ids})
    yield Row("tags seen", ", ".join(map(str, seen)) or "none", "those of the box, once it is held", None)


def _of_map(observed: Observed, source: MapSource | None, stands: bool) -> Iterator[Row]:
    if not observed.poses or not observed.states:
        for name in ("gravity by the map against the IMU", "floor by the map against the soles"):
            yield Row(name, "no localization, or no state", "both", False)
        return
    q = observed.states[-1]["motor_state"]["q"][JOINTS].astype(float)
    X_WP = pelvis_in_scene(observed.poses[-1], source, q[list(WAIST)])
    up = up_of(observed)
    tilt = math.acos(float(np.clip(X_WP.R[2] @ up, -1.0, 1.0)))
    yield _angle("gravity by the map against the IMU", tilt, MAP_TILT_RAD)
    # MuJoCo, which the command's options, that import this module, do without
    from hotice.deploy.checkup.floor import lowest_sole

    height = float(X_WP.p[2]) + lowest_sole(q, up)
    yield Row(
        "floor by the map against the soles",
        f"{100 * height:+.1f} cm",
        f"± {100 * FLOOR_M:g} cm, of a robot that stands",
        abs(height) <= FLOOR_M if stands else None,
    )


def up_of(observed: Observed) -> Array:
    """Upwards in the pelvis by the newest attitude, (3,)."""
    return quat_to_mat(normalize(observed.states[-1]["imu_state"]["quaternion"].astype(float)))[2]


def _angle(name: str, angle: float, most: float) -> Row:
    return Row(name, f"{math.degrees(angle):.1f}°", f"{math.degrees(most):g}° at most", angle <= most)
