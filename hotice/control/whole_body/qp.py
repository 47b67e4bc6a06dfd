"""Joint torques that do as much of all tasks as contacts and limits allow: an inverse-dynamics QP over x = (a, f).

a: 26 accelerations, f: three forces at each of four points per foot, and on each hand. Hard: Newton-Euler of the base
and of the load, friction cones, torque and joint limits. Soft: tasks (`tasks.Targets`), standing feet heaviest, small
forces. Torques follow: τ = M_j a + h_j − J_jᵀ f. Form: Herzog et al., Momentum control with hierarchical inverse
dynamics, 2016.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.checks import Range
from hotice.compiled import compiled
from hotice.control.controller import NUM_JOINTS, Measurement
from hotice.control.whole_body import contacts as touch
from hotice.control.whole_body import tasks
from hotice.control.whole_body.contacts import Contacts
from hotice.control.whole_body.solvers import UNBOUNDED, Guess, Problem, make_solver
from hotice.control.whole_body.tasks import Targets
from hotice.control.whole_body.terms import NV, Terms
from hotice.model import g1
from hotice.model.frames import GRAVITY
from hotice.model.joint_limits import torque_limits

Array = NDArray[np.float64]
FEET = slice(NV, NV + 6 * touch.FOOT_POINTS)
HANDS = slice(FEET.stop, FEET.stop + 6)
N = HANDS.stop
TORQUE_ROWS = slice(0, NUM_JOINTS)
LIMIT_ROWS = slice(NUM_JOINTS, 2 * NUM_JOINTS)
FIRST_CONE = LIMIT_ROWS.stop
ROWS = FIRST_CONE + touch.CONE_ROWS


@dataclass(frozen=True, kw_only=True)
class QpConfig:
    """Parameters of the QP, all ours."""

    solver: str = "proxqp"
    """"proxqp" or "osqp"."""
    tolerance: float | None = None
    """Tolerance of the solver's residuals; None: its own, 1e-5 of ProxQP, 1e-6 of OSQP."""
    foot_friction: float = 0.6
    """Friction coefficient of the feet's cones; the simulated soles have 1.0."""
    hand_friction: float = 1.0
    """Friction coefficient of the hands' cones; the simulated palms have 2.0."""
    torque_share: float = 0.95
    """Share of the torque limits that may be used."""
    stand_weight: float = 300.0
    """Weight of the rows that keep a standing foot where it is."""
    stand_damping: float = 20.0
    """Damping of a standing foot's velocity [1/s]."""
    force_weight: float = 1e-4
    """Weight of squared foot forces [1/N²]."""
    hand_weight: float = 1.0
    """Weight of the squared difference to the target hand forces [1/N²]."""
    acceleration_weight: float = 1e-3
    """Weight of squared accelerations."""
    limit_horizon_s: float = 0.1
    """Joints may move such that they stop within their limits in this time."""
    deadline_s: float | None = None
    """A solve that takes longer counts as a fault; None: none is late, so that a simulation repeats itself."""
    hold_faults: int = 10
    """Faults in a row that are answered with the last torque alone; then servos also hold the last safe joint
    angles."""

    def __post_init__(self) -> None:
        absent = [name for name in ("deadline_s", "tolerance") if getattr(self, name) is None]
        checks.numbers(self, checks.POSITIVE, but=("solver", *absent))
        checks.number("torque_share", self.torque_share, Range(above=0, most=1))


@dataclass(kw_only=True)
class QpMemory:
    """Memory from solve to solve: warm start, last safe torque (20,), its joint angles (20,), counters of faults."""

    guess: Guess
    torque: Array
    joint_pos: Array
    faults: int = 0
    in_a_row: int = 0
    late: int = 0


class WholeBodyQp:
    """The QP of one robot; its work space is allocated here, and what lasts lies in a `QpMemory`.

    Args:
        wrist_pos: (6,) angles at which the wrists are locked [rad], default zero.
        config: see `QpConfig`.

    `terms` describe the state of the last solve. Per solve, what is still allocated are views and scalars made by numpy
    and Pinocchio, and the three result vectors that the solver's binding returns.
    """

    def __init__(self, wrist_pos: ArrayLike | None = None, config: QpConfig | None = None) -> None:
        self.config = config or QpConfig()
        self.terms = Terms(wrist_pos)
        self.problem = p = Problem(n=N, equalities=9, inequalities=ROWS)
        # Rows: 6 of the base and 3 of the load are equalities; 20 torques, 20 joint limits and 5 for each cone follow.
        # A sparse solver is set up for these entries only, once.
        p.may_be_nonzero[:] = False
        p.may_be_nonzero[:9, :NV] = p.may_be_nonzero[:6, NV:] = p.may_be_nonzero[6:9, HANDS] = True
        p.may_be_nonzero[9:, :][TORQUE_ROWS] = True
        for i in range(2 * touch.FOOT_POINTS + 2):
            rows = slice(9 + FIRST_CONE + 5 * i, 9 + FIRST_CONE + 5 * (i + 1))
            p.may_be_nonzero[rows, NV + 3 * i : NV + 3 * (i + 1)] = True
        p.C[LIMIT_ROWS, NV - NUM_JOINTS : NV] = np.eye(NUM_JOINTS)
        p.may_be_nonzero[9:][LIMIT_ROWS] = p.C[LIMIT_ROWS] != 0
        p.upper[FIRST_CONE:] = 0.0
        self._solver = make_solver(self.config.solver, p, self.config.tolerance)
        self._full_limit = torque_limits(g1.ACTION_JOINTS)
        self._limit = self.config.torque_share * self._full_limit
        self._kp, self._kd = g1.gains()
        self._task_A, self._task_b, self._task_w = (
            np.zeros((tasks.ROWS, NV)),
            np.zeros(tasks.ROWS),
            np.zeros(tasks.ROWS),
        )
        self._weighted = np.zeros((tasks.ROWS, NV))
        self._force_ref = np.zeros(6)
        self._h = np.zeros(NV)

    def start(self, measurement: Measurement) -> QpMemory:
        """Memory before the first solve: no torque, the measured joint angles (zero where not finite)."""
        pos = np.where(np.isfinite(measurement.joint_pos), measurement.joint_pos, 0.0)
        return QpMemory(guess=Guess.zeros(self.problem), torque=np.zeros(NUM_JOINTS), joint_pos=pos)

    def solve(
        self, measurement: Measurement, targets: Targets, contacts: Contacts, memory: QpMemory, *, updated: bool = False
    ) -> Array:
        """Torques (20,) [N m], also written into `memory`; on failure the last safe ones, and a fault is counted.

        `updated` says that `terms` already describe the measurement.
        """
        begin = time.perf_counter()
        solved = measurement.finite()
        if solved:
            if not updated:
                self.terms.update(measurement)
            # The state is finite here, but absurd speeds overflow: g shows it before the solver is asked.
            self.assemble(targets, contacts)
            solved = bool(np.isfinite(self.problem.g).all()) and self._solver.solve(memory.guess)
        late = self.config.deadline_s is not None and time.perf_counter() - begin > self.config.deadline_s
        if not solved or late:
            memory.faults += 1
            memory.in_a_row += 1
            memory.late += late
            return self._fallback(measurement, memory)
        p, x = self.problem, memory.guess.x
        # τ = M q̈ − Σ Jᵀ f + h; the torque rows of C hold the first two terms.
        np.dot(p.C[TORQUE_ROWS], x, out=memory.torque)
        memory.torque += self._h[NV - NUM_JOINTS :]
        np.clip(memory.torque, -self._full_limit, self._full_limit, out=memory.torque)
        memory.joint_pos[:] = measurement.joint_pos
        memory.in_a_row = 0
        return memory.torque

    def assemble(self, targets: Targets, contacts: Contacts) -> None:
        """Writes the problem of the state of `terms` into `problem`."""
        t, p, c, k, g = self.terms, self.problem, self.config, contacts, targets
        A, b, w = self._task_A, self._task_b, self._task_w
        tasks.stack_com(
            t.J_com,
            t.com,
            t.v_com,
            t.com_drift,
            g.com_pos,
            g.com_vel,
            g.com_acc,
            g.com_weight,
            g.com_kp,
            g.com_kd,
            A,
            b,
            w,
        )
        tasks.stack_frames(
            t.J_WF,
            t.R_WF,
            t.p_WF,
            t.v_WF,
            t.drift_WF,
            g.frame_pos,
            g.frame_rot,
            g.frame_vel,
            g.frame_acc,
            g.frame_weight,
            g.frame_kp,
            g.frame_kd,
            g.frame_axes,
            k.foot_force_max_n,
            c.stand_weight,
            c.stand_damping,
            A,
            b,
            w,
        )
        tasks.stack_joints(
            t.q[g1.JOINT_POS],
            t.v[g1.JOINT_VEL],
            g.joint_pos,
            g.joint_vel,
            g.joint_acc,
            g.joint_weight,
            g.joint_kp,
            g.joint_kd,
            A,
            b,
            w,
        )
        reference = self._force_ref
        reference[:3], reference[3:] = k.hand_force_ref_W[0], k.hand_force_ref_W[1]
        # Each hand bears half of the object's weight.
        reference[2] -= 0.5 * k.load_kg * GRAVITY
        reference[5] -= 0.5 * k.load_kg * GRAVITY
        _objective(A, b, w, self._weighted, c.acceleration_weight, c.force_weight, c.hand_weight, reference, p.H, p.g)
        # Before the dynamics, which read the bias forces with these moments in them.
        touch.add_moments(t.J_WF, k.hand_moment_W, t.h, self._h)
        _dynamics(t.M, self._h, self._limit, p.A, p.b, p.C, p.lower, p.upper)
        _limits(t.q, t.v, t.lower, t.upper, c.limit_horizon_s, p.lower, p.upper)
        touch.stack_feet(
            t.J_WF, t.R_WF, touch.SOLE_POINTS_M, c.foot_friction, k.foot_force_max_n, p.A, p.C, p.upper, FIRST_CONE
        )
        touch.stack_hands(
            t.J_WF,
            t.R_WF,
            t.v_WF,
            t.drift_WF,
            k.hand_point,
            k.hand_normal_W,
            c.hand_friction,
            k.hand_force_max_n,
            k.load_kg,
            p.A,
            p.b,
            p.C,
            p.upper,
            FIRST_CONE,
        )

    def _fallback(self, measurement: Measurement, memory: QpMemory) -> Array:
        # For a few steps the last torque is nearest to right; alone for longer it would let the robot drift.
        if memory.in_a_row <= self.config.hold_faults:
            return memory.torque
        error = memory.joint_pos - measurement.joint_pos
        servo = memory.torque + self._kp * error - self._kd * measurement.joint_vel
        return np.clip(np.where(np.isfinite(servo), servo, memory.torque), -self._full_limit, self._full_limit)


@compiled
def _objective(A, b, w, weighted, acceleration_weight, force_weight, hand_weight, hand_ref, H, g):
    """H and g of Σ w (A a − b)² and the small weights on accelerations and forces, halved."""
    for r in range(len(b)):
        for k in range(26):
            weighted[r, k] = w[r] * A[r, k]
    # `weighted` is W A, so this is Aᵀ W A.
    H[:26, :26] = np.dot(weighted.T, A)
    for k in range(26):
        H[k, k] += acceleration_weight
        total = 0.0
        for r in range(len(b)):
            total -= weighted[r, k] * b[r]
        g[k] = total
    for k in range(26, 50):
        H[k, k] = force_weight
    for k in range(50, 56):
        H[k, k] = hand_weight
        g[k] = -hand_weight * hand_ref[k - 50]


@compiled
def _dynamics(M, h, limit, A, b, C, lower, upper):
    """Acceleration columns and right-hand sides of the base rows and the torque rows."""
    for r in range(26):
        for k in range(26):
            # Pinocchio fills the upper triangle only.
            m = M[r, k] if k >= r else M[k, r]
            if r < 6:
                A[r, k] = m
            else:
                C[r - 6, k] = m
        if r < 6:
            b[r] = -h[r]
        else:
            lower[r - 6], upper[r - 6] = -limit[r - 6] - h[r], limit[r - 6] - h[r]


@compiled
def _limits(q, v, q_lower, q_upper, horizon, lower, upper):
    """Bounds of joint accelerations: where q + q̇ T + ½ q̈ T² stays within the joint's range."""
    for j in range(20):
        # Clipped to ± 500 rad/s²: a joint far beyond its range does not ask for the impossible.
        ahead = q[7 + j] + v[6 + j] * horizon
        lower[20 + j] = min(2.0 * (q_lower[j] - ahead) / horizon**2, 500.0)
        upper[20 + j] = max(2.0 * (q_upper[j] - ahead) / horizon**2, -500.0)


__all__ = ["Contacts", "QpConfig", "QpMemory", "Targets", "WholeBodyQp", "UNBOUNDED"]
