"""The plan of a pick-up, from standing before a support to holding in the carry state; the support; the durations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.joint_limits import position_limits

Array = NDArray[np.float64]
SUPPORT_TOP_M = (0.40, 0.85)
NEAR_M = (0.15, 0.60)
BEYOND_RAD = 0.1
"""Distance that joints may be beyond their ranges [rad]: at the start, as measured; the solvers stay within."""
PATHS = ("to_crouch", "to_pregrasp", "to_grasp", "retreat")


@dataclass(frozen=True, kw_only=True)
class Support:
    """Support of the object: height of its top [m], distance of its near edge ahead of the feet's middle [m]."""

    top_m: float
    near_m: float

    def __post_init__(self) -> None:
        low, high = SUPPORT_TOP_M
        if not (np.isfinite(self.top_m) and low <= self.top_m <= high):
            raise PickInfeasible(f"support top at {self.top_m:.2f} m: allowed are {low:.2f} to {high:.2f} m")
        low, high = NEAR_M
        if not (np.isfinite(self.near_m) and low <= self.near_m <= high):
            raise PickInfeasible(
                f"support edge {self.near_m:.2f} m ahead of the feet: allowed are {low:.2f} to {high:.2f} m, "
                "stand nearer or farther"
            )


@dataclass(frozen=True, kw_only=True)
class Durations:
    """Durations of a plan's parts [s], ours."""

    crouch_s: float = 2.0
    reach_s: float = 1.5
    close_s: float = 1.0
    lift_s: float = 1.8
    retreat_s: float = 6.5

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE)


@dataclass(frozen=True, kw_only=True)
class PickPlan:
    """Configurations (27,) in Pinocchio's order, in G; paths (K, 27) begin where the one before ends.

    Attributes:
        to_crouch: from standing; the pelvis is then ready for the grasp, the arms drawn back. to_pregrasp: palms off
            the object. to_grasp: palms on it.
        retreat: from the grasp over the lifted object to the carry state.
        lift_knots: how many steps of it belong to the lift.
        p_OH: (2, 3) palms in the object frame [m]. p_HO: (2, 3) the object's centre in the hand frames, moved to the
            palms.
        hand_point: (2, 3) where the hands press, in their frames [m].
        p_GO: (3,) where the object is before the pick, quat_GO: (4,) its turn about z.
        back_m: how far the robot steps back between lift and retreat.

    Raises:
        ValueError: a shape is another, a quaternion is not of unit length, a joint is beyond its range, the lift is
            longer than the retreat or the step back negative.
    """

    to_crouch: Array
    to_pregrasp: Array
    to_grasp: Array
    retreat: Array
    lift_knots: int
    p_OH: Array
    p_HO: Array
    hand_point: Array
    p_GO: Array
    quat_GO: Array
    back_m: float

    def __post_init__(self) -> None:
        for name in PATHS:
            path = getattr(self, name)
            _check_shape(name, path, (max((1, *np.shape(path)[:1])), 27))
            _check_unit(f"the pelvis' turn in {name}", path[:, g1.ROOT_QUAT])
            beyond = beyond_range(path)
            if beyond.max() > BEYOND_RAD:
                worst = np.unravel_index(np.argmax(beyond), beyond.shape)
                raise ValueError(
                    f"{name} has {g1.ACTION_JOINTS[worst[1]]} at {path[:, g1.JOINT_POS][worst]:.4g} rad: "
                    f"allowed is its range and {BEYOND_RAD:g} rad beyond"
                )
        for name, shape in (
            ("p_OH", (2, 3)),
            ("p_HO", (2, 3)),
            ("hand_point", (2, 3)),
            ("p_GO", (3,)),
            ("quat_GO", (4,)),
        ):
            _check_shape(name, getattr(self, name), shape)
        _check_unit("quat_GO", self.quat_GO)
        if not 0 < self.lift_knots <= len(self.retreat):
            raise ValueError(
                f"lift_knots is {self.lift_knots}: 1 to {len(self.retreat)}, the length of retreat, is needed"
            )
        if not 0.0 <= self.back_m < np.inf:
            raise ValueError(f"back_m is {self.back_m}: a finite number of at least 0 is needed")

    @property
    def crouch(self) -> Array:
        """(27,) ready for the grasp."""
        return self.to_crouch[-1]

    @property
    def pregrasp(self) -> Array:
        """(27,) palms beside the object."""
        return self.to_pregrasp[-1]

    @property
    def grasp(self) -> Array:
        """(27,) palms on the object."""
        return self.to_grasp[-1]


def beyond_range(q: Array) -> Array:
    """Distance of joints beyond their ranges in configurations (..., 27), (..., 20) [rad]; negative within."""
    low, high = position_limits(g1.ACTION_JOINTS)
    joints = q[..., g1.JOINT_POS]
    return np.maximum(low - joints, joints - high)


def _check_shape(name: str, value: Array, shape: tuple[int, ...]) -> None:
    if np.shape(value) != shape or np.asarray(value).dtype.kind != "f" or not np.isfinite(value).all():
        raise ValueError(
            f"{name} has shape {np.shape(value)}, type {np.asarray(value).dtype}: {shape} finite floats needed"
        )


def _check_unit(name: str, quat: Array) -> None:
    length = np.linalg.norm(quat, axis=-1)
    if not (np.abs(length - 1.0) <= 1e-3).all():
        raise ValueError(f"{name} has a quaternion of length {np.max(length):.4g}: unit length is needed")
