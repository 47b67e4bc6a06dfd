"""Fields, navigation command and goal as a percept shows them: the guidance part of the policy's input.

The numpy twin of `TransportEnv._guide`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hotice.fields.command import heading_error, navigation_command
from hotice.fields.hod_pf import HodPf
from hotice.model import g1
from hotice.policies.percept import NUM_POINTS, NUM_SGF, Percept
from hotice.policies.policy_task import PolicyTask

Array = NDArray[np.float64]
NUM_FIELD = NUM_POINTS + 8
"""Points that read a field: 9 keypoints the SGF; hands and 8 object keypoints the object's field."""
_STEERED = [g1.SGF_KEYPOINTS.index(name) for name in g1.STEERED_KEYPOINTS]


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldReading:
    """What guides at one instant, all in W.

    Attributes:
        force_W: (19, 3) field vectors at nine keypoints, two hands, eight object keypoints [m/s].
        distance: (19,) to the obstacles of the field that is read [m].
        c_W: (3,) navigation command [m/s]; speed: (1,) commanded speed [m/s].
        heading_error: (1,) from heading to command, fading out with the speed [rad].
        goal_distance: (1,) root to goal, horizontally [m].
    """

    force_W: Array
    distance: Array
    c_W: Array
    speed: Array
    heading_error: Array
    goal_distance: Array

    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {
        "force_W": (NUM_FIELD, 3), "distance": (NUM_FIELD,), "c_W": (3,), "speed": (1,), "heading_error": (1,),
        "goal_distance": (1,),
    }  # fmt: skip
    SIZE: ClassVar[int] = sum(int(np.prod(shape)) for shape in SHAPES.values())

    def flat(self) -> Array:
        """All attributes in order, (82,): what ports carry."""
        return np.concatenate([np.ravel(getattr(self, f.name)) for f in fields(self)])

    @classmethod
    def unflatten(cls, vector: Array) -> FieldReading:
        """Inverse of `flat`; the attributes are views."""
        return cls(**{name: vector[where].reshape(cls.SHAPES[name]) for name, where in _WHERE.items()})


_ENDS = np.cumsum([0, *(int(np.prod(shape)) for shape in FieldReading.SHAPES.values())])
_WHERE = {n: slice(int(a), int(b)) for n, a, b in zip(FieldReading.SHAPES, _ENDS[:-1], _ENDS[1:], strict=True)}


def read_fields(pf: HodPf, percept: Percept, task: PolicyTask) -> FieldReading:
    """Fields at the keypoints of a percept, and the command that they make."""
    points = percept.p_WK.astype(np.float32)  # the environment samples in single precision
    carried = np.concatenate([points[NUM_SGF:], percept.p_WOK.astype(np.float32)])
    sgf, sgf_distance, _ = pf.sgf.query(points[:NUM_SGF])
    ogf, ogf_distance, _ = (pf.ogf if task.object_field == "ogf" else pf.sgf).query(carried)
    offset_W = pf.scene.goal_W[:2] - percept.p_WP[:2]
    c_W, speed = navigation_command(
        sgf[_STEERED].astype(np.float64), offset_W, pf.params.attraction, task.speed_m_s, task.stop_gain_hz
    )
    return FieldReading(
        force_W=np.concatenate([sgf, ogf]).astype(np.float64),
        distance=np.concatenate([sgf_distance, ogf_distance]).astype(np.float64), c_W=c_W, speed=np.array([speed]),
        heading_error=np.array([heading_error(c_W, speed, float(percept.yaw[0]), task.speed_m_s)]),
        goal_distance=np.array([math.hypot(*offset_W)]),
    )  # fmt: skip
