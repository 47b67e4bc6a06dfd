"""Two solvers of one convex problem: minimise ½ xᵀH x + gᵀx with A x = b and l ≤ C x ≤ u, from a warm start.

Both own their work space, made once; a solve reads the arrays of `Problem` and writes x, y, z of `Guess` in place.
"""

from __future__ import annotations

import atexit
import weakref
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidConfig, UnknownName

Array = NDArray[np.float64]
UNBOUNDED = 1e20


@dataclass(kw_only=True)
class Problem:
    """H (n, n) symmetric, g (n,), A (e, n), b (e,), C (m, n), lower and upper (m,); ± `UNBOUNDED` where there is none.

    `may_be_nonzero`: (e + m, n), where A and C may ever hold something.
    """

    n: int
    equalities: int
    inequalities: int
    H: Array = field(init=False)
    g: Array = field(init=False)
    A: Array = field(init=False)
    b: Array = field(init=False)
    C: Array = field(init=False)
    lower: Array = field(init=False)
    upper: Array = field(init=False)
    may_be_nonzero: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        n, e, m = self.n, self.equalities, self.inequalities
        self.H, self.g = np.zeros((n, n)), np.zeros(n)
        self.A, self.b = np.zeros((e, n)), np.zeros(e)
        self.C, self.lower, self.upper = np.zeros((m, n)), np.full(m, -UNBOUNDED), np.full(m, UNBOUNDED)
        self.may_be_nonzero = np.ones((e + m, n), dtype=bool)


@dataclass(kw_only=True)
class Guess:
    """Primal x (n,), multipliers y (e,) of the equalities and z (m,) of the inequalities."""

    x: Array
    y: Array
    z: Array

    @classmethod
    def zeros(cls, problem: Problem) -> Guess:
        """A cold start."""
        return cls(x=np.zeros(problem.n), y=np.zeros(problem.equalities), z=np.zeros(problem.inequalities))


class Solver(Protocol):
    """Solves `Problem`s of the size it was made for."""

    def solve(self, guess: Guess) -> bool:
        """Solves the problem it was made with, from `guess` and into it; False, `guess` unchanged, where it cannot."""
        ...


class ProxQp:
    """Proximal augmented Lagrangian on dense matrices (proxsuite).

    Its work space is given back when the program ends: diagrams keep their systems beyond that, and proxsuite would
    report a leak.
    """

    def __init__(self, problem: Problem, *, tolerance: float = 1e-5, max_iterations: int = 100) -> None:
        from proxsuite import proxqp

        self._p, self._qp = problem, proxqp.dense.QP(problem.n, problem.equalities, problem.inequalities)
        self._solved = proxqp.QPSolverOutput.PROXQP_SOLVED
        settings = self._qp.settings
        settings.eps_abs, settings.eps_rel, settings.max_iter = tolerance, 0.0, max_iterations
        settings.initial_guess = proxqp.InitialGuess.WARM_START
        settings.check_duality_gap = False
        self._ready = False
        _ALIVE.add(self)

    def solve(self, guess: Guess) -> bool:
        """See `Solver`."""
        p, qp = self._p, self._qp
        if not self._ready:
            qp.init(p.H, p.g, p.A, p.b, p.C, p.lower, p.upper)
            self._ready = True
        # the first problem too: the same one, solved again later, has the same solution to the last bit
        qp.update(H=p.H, g=p.g, A=p.A, b=p.b, C=p.C, l=p.lower, u=p.upper, update_preconditioner=False)
        qp.solve(guess.x, guess.y, guess.z)
        results = qp.results
        if results.info.status != self._solved or not np.isfinite(results.x).all():
            return False
        guess.x[:], guess.y[:], guess.z[:] = results.x, results.y, results.z
        return True


_ALIVE: weakref.WeakSet[ProxQp] = weakref.WeakSet()


@atexit.register
def _give_back() -> None:
    for solver in list(_ALIVE):
        vars(solver).clear()


class Osqp:
    """Operator splitting on sparse matrices of a fixed pattern (OSQP)."""

    def __init__(self, problem: Problem, *, tolerance: float = 1e-6, max_iterations: int = 8000) -> None:
        import osqp
        import scipy.sparse as sp

        p = self._p = problem
        rows = p.equalities + p.inequalities
        self._upper = np.triu_indices(p.n)
        order = np.lexsort(self._upper)  # by column, then row: how OSQP stores it
        self._upper = tuple(i[order] for i in self._upper)
        columns, at = np.nonzero(p.may_be_nonzero.T)
        self._entries = (at, columns)
        self._AC, self._l, self._u = np.zeros((rows, p.n)), np.zeros(rows), np.zeros(rows)
        H = sp.csc_matrix((np.ones(len(order)), self._upper), (p.n, p.n))
        AC = sp.csc_matrix((np.ones(len(at)), self._entries), (rows, p.n))
        H.data[:], AC.data[:] = np.where(self._upper[0] == self._upper[1], 1.0, 0.0), 1.0
        self._qp = osqp.OSQP()
        self._qp.setup(
            H,
            np.zeros(p.n),
            AC,
            np.full(rows, -1.0),
            np.full(rows, 1.0),
            verbose=False,
            eps_abs=tolerance,
            eps_rel=tolerance,
            max_iter=max_iterations,
            warm_starting=True,
            check_termination=10,
            adaptive_rho_interval=50,
        )

    def solve(self, guess: Guess) -> bool:
        """See `Solver`."""
        p, e = self._p, self._p.equalities
        self._AC[:e], self._AC[e:] = p.A, p.C
        self._l[:e], self._l[e:], self._u[:e], self._u[e:] = p.b, p.lower, p.b, p.upper
        self._qp.update(q=p.g, l=self._l, u=self._u, Px=p.H[self._upper], Ax=self._AC[self._entries])
        self._qp.warm_start(x=guess.x, y=np.concatenate([guess.y, guess.z]))
        results = self._qp.solve(raise_error=False)
        if results.info.status_val != 1 or not np.isfinite(results.x).all():
            return False
        guess.x[:], guess.y[:], guess.z[:] = results.x, results.y[:e], results.y[e:]
        return True


SOLVERS = {"proxqp": ProxQp, "osqp": Osqp}


def make_solver(name: str, problem: Problem, tolerance: float | None = None) -> Solver:
    """The named solver for problems that lie in the arrays of `problem`; `tolerance` of its own where None.

    Raises `UnknownName`, and `InvalidConfig` where its package is missing.
    """
    if name not in SOLVERS:
        raise UnknownName("QP solver", name, SOLVERS)
    try:
        return SOLVERS[name](problem) if tolerance is None else SOLVERS[name](problem, tolerance=tolerance)
    except ImportError as error:
        raise InvalidConfig(f"QP solver {name!r} needs {error.name}: pip install 'hotice[drake]'") from None
