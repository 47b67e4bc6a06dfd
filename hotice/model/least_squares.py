"""Small bounded least-squares problems, solved fast by Levenberg-Marquardt steps on the free variables."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Residual = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Variables (n,) -> residuals (m,) and their Jacobian (m, n)."""


def minimize(
    residual: Residual,
    start: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    step_tolerance: float = 1e-7,
    max_steps: int = 100,
) -> NDArray[np.float64]:
    """A local minimum of |r(x)|² within bounds, (n,); `start` is moved into the bounds first.

    A variable at a bound rests while the gradient pushes it outwards; the others take a damped Gauss-Newton step, cut
    at the bounds. Ends when no variable moved by more than `step_tolerance`, no step descends, or after `max_steps`.
    Method: Nocedal and Wright, Numerical Optimization, 10.3 and 16.7.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    x = np.clip(np.asarray(start, dtype=np.float64), lower, upper)
    r, jacobian = residual(x)
    damping = 1e-3
    for _ in range(max_steps):
        gradient = jacobian.T @ r
        free = np.flatnonzero(~((x <= lower) & (gradient > 0) | (x >= upper) & (gradient < 0)))
        if not len(free):
            break
        hessian = jacobian[:, free].T @ jacobian[:, free]
        scale = np.diag(np.diagonal(hessian) + 1e-12)
        while damping < 1e9:
            new = x.copy()
            new[free] -= np.linalg.solve(hessian + damping * scale, gradient[free])
            new = np.clip(new, lower, upper)
            r_new, jacobian_new = residual(new)
            if r_new @ r_new <= r @ r:
                break
            damping *= 4.0
        else:
            break
        moved = np.abs(new - x).max()
        x, r, jacobian, damping = new, r_new, jacobian_new, max(damping / 6.0, 1e-12)
        if moved < step_tolerance:
            break
    return x
