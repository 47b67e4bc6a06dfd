"""Fields, navigation command and goal as a percept shows them: the guidance part of the policy's input.

The numpy twin of `hotice.sim.reader.Reader.guide`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hotice.fields.command import heading_error, navigation_command
from hotice.fields.hod_pf import HodPf
from hotice.fields.moving.momentary import MomentaryPf
from hotice.model import g1
from hotice.policy.percept import NUM_POINTS, NUM_SGF, Percept
from hotice.policy.vectors import NamedVector
from hotice.task.policy_task import PolicyTask
from hotice.task.scan import NUM_SCAN, scan_points

Array = NDArray[np.float64]
NUM_FIELD = NUM_POINTS + 8
"""Points that read a field: 9 keypoints the SGF; hands and 8 object keypoints the object's field."""
FAR_M = 2.0
"""What is read for the distance to an obstacle where none is known [m]."""
_FEET = [g1.SGF_KEYPOINTS.index(name) for name in ("left_foot", "right_foot")]
_STEERED = [g1.SGF_KEYPOINTS.index(name) for name in g1.STEERED_KEYPOINTS]


class FieldReading(NamedVector):
    """Guidance at one instant, all in W.

    Attributes:
        force_W: (19, 3) field vectors at nine keypoints, two hands, eight object keypoints [m/s].
        distance: (19,) to the obstacles of the field that is read [m].
        c_W: (3,) navigation command [m/s]; speed: (1,) commanded speed [m/s].
        heading_error: (1,) from heading to command, fading out with the speed [rad].
        goal_distance: (1,) root to goal, horizontally [m].
        scan: (40,) signed distances at the points of `hotice.task.scan` [m]; zero for a task without the scan.
    """

    force_W: Array
    distance: Array
    c_W: Array
    speed: Array
    heading_error: Array
    goal_distance: Array
    scan: Array

    SHAPES = {
        "force_W": (NUM_FIELD, 3),
        "distance": (NUM_FIELD,),
        "c_W": (3,),
        "speed": (1,),
        "heading_error": (1,),
        "goal_distance": (1,),
        "scan": (NUM_SCAN,),
    }


def read_fields(pf: HodPf | MomentaryPf, percept: Percept, task: PolicyTask) -> FieldReading:
    """Fields at the keypoints of a percept, and the command that they make."""
    # the environment samples in single precision
    p_WK, p_WP, yaw = percept.p_WK, percept.p_WP, percept.yaw[0]
    # one query for both costs less than two
    around = (p_WK[:NUM_SGF], scan_points(p_WK.take(_FEET, 0), p_WP, yaw)) if task.scan else (p_WK[:NUM_SGF],)
    around = np.concatenate(around, dtype=np.float32, casting="same_kind")
    carried = np.concatenate((p_WK[NUM_SGF:], percept.p_WOK), dtype=np.float32, casting="same_kind")
    sgf, sgf_distance, _ = pf.sgf.query(around)
    ogf, ogf_distance, _ = (pf.ogf if task.object_field == "ogf" else pf.sgf).query(carried)
    offset_W = pf.scene.goal - p_WP[:2]
    c_W, speed = navigation_command(
        sgf.take(_STEERED, 0).astype(np.float64), offset_W, pf.params.attraction, task.speed_m_s, task.stop_gain_hz
    )
    reading = FieldReading(np.empty(FieldReading.SIZE))
    force_W, distance = reading.force_W, reading.distance
    force_W[:NUM_SGF], force_W[NUM_SGF:] = sgf[:NUM_SGF], ogf
    distance[:NUM_SGF], distance[NUM_SGF:] = sgf_distance[:NUM_SGF], ogf_distance
    reading.c_W[:], reading.speed[0] = c_W, speed
    reading.heading_error[0] = heading_error(c_W, speed, float(yaw), task.speed_m_s)
    reading.goal_distance[0] = math.hypot(*offset_W.tolist())
    reading.scan[:] = sgf_distance[NUM_SGF:] if task.scan else 0.0
    return reading


def read_standing(
    reading: FieldReading, percept: Percept, place_W: Array, task: PolicyTask, attraction: float
) -> FieldReading:
    """The reading of a robot whose goal is where it stands: how a policy that only knows goals is told to stop.

    With a command of zero alone it follows the fields on to their goal, and without fields, which it never saw, it
    falls; so the fields lead to `place_W` (3,) [m], at the height of goals, over a free floor. Distances to obstacles
    stay; what is not finite of them counts as far. `attraction`: eta of the fields that the robot walks by [m/s].
    """
    points = np.concatenate([percept.p_WK, percept.p_WOK])
    to_place = place_W - points
    apart = np.maximum(np.linalg.norm(to_place, axis=1, keepdims=True), 1e-6)
    offset_W = place_W[:2] - percept.p_WP[:2]
    force_W = attraction * to_place / apart
    c_W, speed = navigation_command(force_W[_STEERED], offset_W, attraction, task.speed_m_s, task.stop_gain_hz)
    return FieldReading.of(
        force_W=force_W,
        distance=np.where(np.isfinite(reading.distance), reading.distance, FAR_M),
        c_W=c_W,
        speed=speed,
        heading_error=heading_error(c_W, speed, float(percept.yaw[0]), task.speed_m_s),
        goal_distance=math.hypot(*offset_W.tolist()),
        scan=np.where(np.isfinite(reading.scan), reading.scan, FAR_M if task.scan else 0.0),
    )
