"""Soft costs and hard constraints of one path knot, as CasADi functions of x and parameters θ: hands free or holding.

θ is a row of numbers, whose parts `FREE` and `HOLDING` name with their sizes.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.grip import PALM_POINTS_M
from hotice.control.pick_plan.paths.kinematics import NX, OUT, kinematics
from hotice.control.pick_plan.task import TIPS_M

if TYPE_CHECKING:
    import casadi

Array = NDArray[np.float64]
STANDING = {"wrists": 6, "feet_p": 6, "feet_R": 18, "wish": NX, "weight": NX}
FREE = STANDING | {"object_p": 3, "side": 3}
"""`wish`, `weight`: where x is pulled and how much. `object_p`, `side`: the object's centre and its lateral axis."""
HOLDING = STANDING | {
    "left_p": 3,
    "left_R": 9,
    "right_in_left_p": 3,
    "right_in_left_R": 9,
    "middle": 3,
    "middle_weight": 3,
    "load": 1,
    "off": 2,
}
"""`left_*`: target of the left hand; `right_in_left_*`: the right hand seen from it; `middle`: target of the middle of
both hands. `load`: the object's share of the total mass; `off`: its centre, horizontally, from the middle of the hands.
"""
ROWS_STANDING = ("foot on the floor",) * 12 + ("centre of mass over the feet",) * 2 + ("knees off the support",) * 2
ROWS_FREE = (*ROWS_STANDING, *("hands above the support",) * 4, *("palms beside the object",) * 8)
ROWS_HOLDING = (
    *ROWS_STANDING,
    *("hold of the object",) * 6,
    *("object upright",) * 3,
    *("object on its way",) * 3,
    "pelvis low enough to step",
)
TURN_WEIGHT = 40.0


@lru_cache(maxsize=1)
def free() -> tuple[casadi.Function, casadi.Function]:
    """Soft and hard rows of a knot whose hands hold nothing."""
    import casadi as cs

    x, theta, part = _symbols(FREE)
    out = _out(x, part["wrists"])
    p, R = _hands(out)
    tips = [p[i] + R[i] @ cs.DM(tip) for i in range(2) for tip in TIPS_M]
    palms = [p[i] + R[i] @ cs.DM(point) for i in range(2) for point in PALM_POINTS_M]
    beside = [
        sign * cs.dot(q - part["object_p"], part["side"]) for sign, q in zip([1.0] * 4 + [-1.0] * 4, palms, strict=True)
    ]
    com = out["com"][:2]
    hard = cs.vertcat(_feet(out, part), com, out["knees_p"][0], out["knees_p"][3], *[t[2] for t in tips], *beside)
    soft = cs.vertcat(part["weight"] * (x - part["wish"]), com)
    return _function("soft_free", x, theta, soft), _function("hard_free", x, theta, hard)


@lru_cache(maxsize=1)
def holding() -> tuple[casadi.Function, casadi.Function]:
    """Soft and hard rows of a knot whose hands hold the object."""
    import casadi as cs

    x, theta, part = _symbols(HOLDING)
    out = _out(x, part["wrists"])
    (left, right), (R_left, R_right) = _hands(out)
    middle = 0.5 * (left + right)
    com = (1.0 - part["load"]) * out["com"][:2] + part["load"] * (middle[:2] + part["off"])
    hold = cs.vertcat(
        R_left.T @ (right - left) - part["right_in_left_p"],
        _turn(R_left.T @ R_right, cs.reshape(part["right_in_left_R"], 3, 3)),
    )
    upright = _turn(R_left, cs.reshape(part["left_R"], 3, 3))
    way = middle - part["middle"]
    hard = cs.vertcat(_feet(out, part), com, out["knees_p"][0], out["knees_p"][3], hold, upright, way, x[2])
    soft = cs.vertcat(part["weight"] * (x - part["wish"]), com, part["middle_weight"] * way, TURN_WEIGHT * upright)
    return _function("soft_holding", x, theta, soft), _function("hard_holding", x, theta, hard)


def pack(parts: dict[str, int], values: dict[str, Array]) -> Array:
    """θ (P,) from its parts; rotation matrices column by column."""
    return np.concatenate(
        [
            np.swapaxes(v, -1, -2).ravel() if name.endswith("_R") else np.ravel(v)
            for name, v in ((name, np.asarray(values[name], dtype=float)) for name in parts)
        ]
    )


def _symbols(parts: dict[str, int]):
    import casadi as cs

    theta, part, start = cs.SX.sym("theta", sum(parts.values())), {}, 0
    for name, size in parts.items():
        part[name] = theta[start : start + size]
        start += size
    return cs.SX.sym("x", NX), theta, part


def _out(x, wrists):
    rows = kinematics()(x, wrists)
    return {name: rows[a:b] for name, (a, b) in OUT.items()}


def _hands(out):
    import casadi as cs

    return [out["hands_p"][3 * i : 3 * i + 3] for i in range(2)], [
        cs.reshape(out["hands_R"][9 * i : 9 * i + 9], 3, 3) for i in range(2)
    ]


def _feet(out, part):
    """Where the feet are and how they are turned, less where they shall be, 12 rows."""
    import casadi as cs

    turns = [
        _turn(*(cs.reshape(R[9 * i : 9 * i + 9], 3, 3) for R in (out["feet_R"], part["feet_R"]))) for i in range(2)
    ]
    return cs.vertcat(out["feet_p"] - part["feet_p"], *turns)


def _turn(R, wished):
    """Small turn from the target `wished` to R, (3,) [rad]."""
    import casadi as cs

    E = R @ wished.T
    return 0.5 * cs.vertcat(E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1])


def _function(name, x, theta, out):
    import casadi as cs

    return cs.Function(name, [x, theta], [out], ["x", "theta"], ["out"], {"cse": True})
