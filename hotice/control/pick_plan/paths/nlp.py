"""Nonlinear program of a path through configurations, solved by IPOPT: smooth, within limits, every knot constrained.

minimise Σ_k |soft(x_k, θ_k)|² + Σ_k |W (x_{k-1} − 2 x_k + x_{k+1})|²
with low_k <= hard(x_k, θ_k) <= high_k, joint limits, and joint steps |x_{k+1} − x_k| within what the speed limit
allows. The first and the last knot are given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.paths.kinematics import NX
from hotice.errors import PickInfeasible

if TYPE_CHECKING:
    import casadi

Array = NDArray[np.float64]
SMOOTH = np.concatenate([np.full(3, 6.0), np.full(3, 2.0), np.full(20, 1.0)])
"""Weights W of second differences: a metre of the pelvis, a radian of its turn, a radian of a joint."""
ACCURACY = 1e-3
"""Largest violation of a constraint, in its unit."""
MAX_STEPS = 150


@dataclass(frozen=True, kw_only=True)
class Knots:
    """Wishes for the K knots between the ends.

    Attributes:
        ends: (2, 26) first and last knot. guess: (K, 26). theta: (K, P) parameters of `soft` and `hard`.
        low, high: (K, C) bounds of `hard`. joint_low, joint_high: (20,) [rad]. step: (20,) largest change from knot to
            knot.
    """

    ends: Array
    guess: Array
    theta: Array
    low: Array
    high: Array
    joint_low: Array
    joint_high: Array
    step: Array


class PathProgram:
    """The program for K knots; made once, solved for any numbers.

    Args:
        knots: K. soft, hard: functions (x (26,), θ (P,)) -> residuals and constraints of a knot.
        names: (C,) of the rows of `hard`, for messages.
    """

    def __init__(self, knots: int, soft: casadi.Function, hard: casadi.Function, names: tuple[str, ...]) -> None:
        import casadi as cs

        self.knots, self.names = knots, names
        parameters = hard.size1_in(1)
        X, ends, theta = cs.MX.sym("X", NX, knots), cs.MX.sym("ends", NX, 2), cs.MX.sym("theta", parameters, knots)
        path = cs.horzcat(ends[:, 0], X, ends[:, 1])
        bend = cs.mtimes(cs.diag(SMOOTH), path[:, :-2] - 2 * path[:, 1:-1] + path[:, 2:])
        cost = cs.sumsqr(soft.map(knots)(X, theta)) + cs.sumsqr(bend)
        steps = path[6:, 1:] - path[6:, :-1]
        g = cs.vertcat(cs.vec(hard.map(knots)(X, theta)), cs.vec(steps))
        program = {"x": cs.vec(X), "p": cs.vertcat(cs.vec(ends), cs.vec(theta)), "f": cost, "g": g}
        self._solver: Any = cs.nlpsol(
            "path",
            "ipopt",
            program,
            {
                "print_time": False,
                "expand": True,
                "ipopt": {
                    "print_level": 0,
                    "sb": "yes",
                    "max_iter": MAX_STEPS,
                    "tol": 1e-5,
                    "constr_viol_tol": 1e-6,
                    "acceptable_tol": 1e-4,
                    "acceptable_iter": 5,
                },
            },
        )

    def solve(self, knots: Knots, what: str) -> Array:
        """The path with its ends, (K + 2, 26). Raises `PickInfeasible`, naming the constraint that is violated most."""
        n = self.knots
        limits = [
            np.tile(np.concatenate([np.full(6, -sign * np.inf), joint]), n)
            for sign, joint in ((1.0, knots.joint_low), (-1.0, knots.joint_high))
        ]
        step = np.tile(knots.step, n + 1)
        low, high = np.concatenate([knots.low.ravel(), -step]), np.concatenate([knots.high.ravel(), step])
        found = self._solver(
            x0=np.clip(knots.guess.ravel(), *limits),
            p=np.concatenate([knots.ends.ravel(), knots.theta.ravel()]),
            lbx=limits[0],
            ubx=limits[1],
            lbg=low,
            ubg=high,
        )
        g = np.asarray(found["g"]).ravel()
        off = np.maximum(low - g, g - high)
        worst = int(np.argmax(off))
        if not off[worst] <= ACCURACY:
            size = len(self.names)
            knot, row = divmod(worst, size) if worst < n * size else ((worst - n * size) // 20, -1)
            name = self.names[row] if row >= 0 else "joint speed"
            raise PickInfeasible(
                f"no path for {what}: {name} is violated by {off[worst]:.3f} at knot {knot + 1} of {n}"
            )
        x = np.asarray(found["x"]).reshape(n, NX)
        return np.concatenate([knots.ends[:1], x, knots.ends[1:]])

    @property
    def steps(self) -> int:
        """Iterations of the last solve."""
        return int(self._solver.stats()["iter_count"])
