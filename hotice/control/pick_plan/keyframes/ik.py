"""Inverse kinematics by Drake: one configuration of the whole robot under named constraints, solved by SNOPT.

A problem that has no solution is answered with the names of the constraints that its best try violates.
"""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.pick_plan.keyframes.robot import DrakeRobot
from hotice.errors import PickInfeasible

Array = NDArray[np.float64]
JOINT_MARGIN_RAD = 0.02
ACCURACY = 5e-4
"""Largest violation of a constraint, [m] or [rad]."""
MAJOR_STEPS = 150
AHEAD_M, ASIDE_M = 0.2, 0.2
"""Points that fix a frame's orientation: a tolerance at them is one of the angle times this length."""


class KeyframeIk:
    """One problem. Frames are links of the robot by name; tolerances are half widths.

    Costs are squares, weights before the square; `solve` may be called once.
    """

    def __init__(self, robot: DrakeRobot) -> None:
        from pydrake.multibody.inverse_kinematics import ComPositionConstraint, InverseKinematics

        self.robot, plant = robot, robot.plant
        self._ik = ik = InverseKinematics(plant, False)
        self._prog, self._world = ik.prog(), plant.world_frame()
        self._q = ik.q()
        self._joints = self._q[robot.joints]
        low, high = robot.limits + JOINT_MARGIN_RAD * np.array([[1.0], [-1.0]])
        self._name(self._prog.AddBoundingBoxConstraint(low, high, self._joints), "joint limits")
        self._com = self._prog.NewContinuousVariables(3, "com")
        com = ComPositionConstraint(plant, None, self._world, ik.get_mutable_context())
        self._name(self._prog.AddConstraint(com, np.concatenate([self._q, self._com])), "centre of mass over the feet")

    def place(
        self,
        link: str,
        p_F: ArrayLike,
        p: ArrayLike,
        R: Array,
        name: str,
        at_m: float = 0.0,
        turn: float = 0.0,
        seen_from: str = "",
    ) -> None:
        """Point p_F (3,) of a link comes to p (3,), within `at_m`, and the link turns to R (3, 3), within `turn` [rad].

        `seen_from`: another link, in whose frame p and R are; default the world.
        """
        p_F, target = np.asarray(p_F, dtype=float), _pose(p, R)
        ahead, aside = p_F + [AHEAD_M, 0.0, 0.0], p_F + [0.0, ASIDE_M, 0.0]
        near, inf, arc = np.full(3, at_m), np.inf, at_m + turn * AHEAD_M
        far, side = np.array([inf, arc, arc]), np.array([inf, inf, at_m + turn * ASIDE_M])
        for point, least, most, what in (
            (p_F, -near, near, name),
            (ahead, -far, far, f"turn of the {name}"),
            (aside, -side, side, f"turn of the {name}"),
        ):
            self._within(link, point, target, least, most, what, seen_from)

    def within(
        self,
        link: str,
        p_F: ArrayLike,
        low: ArrayLike,
        high: ArrayLike,
        name: str,
        p: ArrayLike = (0.0, 0.0, 0.0),
        R: Array | None = None,
    ) -> None:
        """Point p_F (3,) of a link between low and high (3,), in the frame at p, R (default the world)."""
        self._within(link, p_F, _pose(p, np.eye(3) if R is None else R), low, high, name)

    def off_axis(
        self, link: str, p_F: ArrayLike, p: ArrayLike, axis: ArrayLike, low: float, high: float, name: str
    ) -> None:
        """Distance of point p_F of a link to a line through p (3,) along `axis` (3,)."""
        frame = self.robot.plant.GetFrameByName(link)
        self._name(self._ik.AddPointToLineDistanceConstraint(frame, p_F, self._world, p, axis, low, high), name)

    def off_point(self, link: str, p_F: ArrayLike, p: ArrayLike, low: float, high: float, name: str) -> None:
        """Distance of point p_F of a link to p (3,)."""
        frame = self.robot.plant.GetFrameByName(link)
        self._name(self._ik.AddPointToPointDistanceConstraint(frame, p_F, self._world, p, low, high), name)

    def level(self, link: str, p_F: ArrayLike, sine: float, name: str) -> None:
        """The x axis of a link climbs or falls by at most an angle of that sine."""
        points = np.stack([p_F, np.add(p_F, [1.0, 0.0, 0.0])], axis=1)
        A = np.array([[0, 0, -1.0, 0, 0, 1.0], [0, 0, 1.0, 0, 0, -1.0]])
        frame = self.robot.plant.GetFrameByName(link)
        self._name(self._ik.AddPolyhedronConstraint(self._world, frame, points, A, np.full(2, sine)), name)

    def balance(self, box: Array, load_kg: float, p_load: Array, name: str) -> None:
        """Common centre of mass of robot and a load at p_load (3,) within `box` (2, 2)."""
        share = self.robot.mass_kg / (self.robot.mass_kg + load_kg)
        low, high = (box - (1.0 - share) * p_load[:2]) / share
        self._name(self._prog.AddBoundingBoxConstraint(low, high, self._com[:2]), name)

    def centre(self, weight: float, load_kg: float, p_load: Array) -> None:
        """Cost: common centre of mass over the origin."""
        share = self.robot.mass_kg / (self.robot.mass_kg + load_kg)
        wish, C = -(1.0 - share) / share * p_load[:2], (weight * share) ** 2 * np.eye(2)
        self._prog.AddQuadraticErrorCost(2.0 * C, wish, self._com[:2])

    def point(self, link: str, p_F: ArrayLike, p: ArrayLike, weights: ArrayLike, R: Array) -> None:
        """Cost: point p_F of a link at p (3,), weights (3,) along the axes R (3, 3)."""
        C = R @ np.diag(np.square(weights)) @ R.T
        frame = self.robot.plant.GetFrameByName(link)
        self._ik.AddPositionCost(self._world, p, frame, p_F, C)

    def posture(self, joints: Array, weights: Array) -> None:
        """Cost: joints (20,), weights (20,)."""
        self._prog.AddQuadraticErrorCost(2.0 * np.diag(weights**2), joints, self._joints)

    def pelvis_turn(self, quat_WP: Array, weights: ArrayLike) -> None:
        """Cost of the pelvis' turn from quat (4,), weights (3,) about its axes.

        The turn is the vector part of the difference, doubled.
        """
        w, x, y, z = quat_WP
        vector = np.array([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]])  # of conj(quat) * q
        L = 2.0 * np.asarray(weights)[:, None] * vector
        self._prog.AddQuadraticCost(2.0 * L.T @ L, np.zeros(4), 0.0, self._q[:4], True)

    def pelvis(self, p: ArrayLike, quat_WP: Array, weights: tuple[float, float]) -> None:
        """Cost: pelvis at p (3,), turned as quat (4,); weights of position and turn."""
        self._prog.AddQuadraticErrorCost(2.0 * weights[0] ** 2 * np.eye(3), p, self._q[4:7])
        self.pelvis_turn(quat_WP, np.full(3, weights[1]))

    def solve(self, guess: Array, what: str) -> Array:
        """Configuration (27,) of least cost near `guess` (27,). Raises `PickInfeasible`, naming what is violated."""
        from pydrake.solvers import SnoptSolver, SolverOptions

        options, solver = SolverOptions(), SnoptSolver()
        for key, value in (
            ("Major iterations limit", MAJOR_STEPS),
            ("Major feasibility tolerance", 1e-6),
            ("Major optimality tolerance", 1e-4),
        ):
            options.SetOption(solver.solver_id(), key, value)
        start = self._start(guess)
        result: Any = solver.Solve(self._prog, start, options)
        worst = self._violated(result)
        if worst:
            raise PickInfeasible(f"{what}: " + ", ".join(f"{name} is violated by {v:.3f}" for name, v in worst.items()))
        return self.robot.configuration(result.GetSolution(self._q))

    def _start(self, guess: Array) -> Array:
        plant = self.robot.plant
        positions = self.robot.positions(guess)
        start, context = np.zeros(self._prog.num_vars()), self._ik.get_mutable_context()
        plant.SetPositions(context, positions)
        self._prog.SetDecisionVariableValueInVector(self._q, positions, start)
        self._prog.SetDecisionVariableValueInVector(self._com, plant.CalcCenterOfMassPositionInWorld(context), start)
        return start

    def _violated(self, result: Any) -> dict[str, float]:
        """Constraints that are violated by more than `ACCURACY`, the worst first."""
        found: dict[str, float] = {}
        for binding in self._prog.GetAllConstraints():
            constraint = binding.evaluator()
            value = result.EvalBinding(binding)
            off = np.maximum(constraint.lower_bound() - value, value - constraint.upper_bound()).max()
            if not off <= ACCURACY:
                name = constraint.get_description() or "unit quaternion"
                found[name] = max(float(off), found.get(name, 0.0))
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    def _within(
        self, link: str, p_F: ArrayLike, target: Any, low: ArrayLike, high: ArrayLike, name: str, seen_from: str = ""
    ) -> None:
        plant = self.robot.plant
        base = plant.GetFrameByName(seen_from) if seen_from else self._world
        bound = self._ik.AddPositionConstraint(plant.GetFrameByName(link), p_F, base, target, low, high)
        self._name(bound, name)

    @staticmethod
    def _name(binding: Any, name: str) -> None:
        binding.evaluator().set_description(name)


def _pose(p: ArrayLike, R: Array) -> Any:
    from pydrake.math import RigidTransform, RotationMatrix

    return RigidTransform(
        RotationMatrix.ProjectToRotationMatrix(np.asarray(R, dtype=float)), np.asarray(p, dtype=float)
    )
