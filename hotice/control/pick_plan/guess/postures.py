"""First guesses of the keyframes: bounded least squares over robot pose and joints, where every target is soft.

A guess may miss what it is asked for; `keyframes` turns it into a configuration that keeps its constraints or says
which it cannot.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.grip import ready_joints
from hotice.control.pick_plan.guess.rows import Pose, Rows, hinge
from hotice.control.pick_plan.task import (
    CHEST_GAP_M,
    CHEST_M,
    KNEE_ROOM_M,
    PREGRASP_GAP_M,
    STEPPING_HEIGHT_M,
    TIPS_ABOVE_M,
    TIPS_M,
    Frames,
    ObjectPose,
    PickTask,
)
from hotice.control.whole_body.terms import LEFT_FOOT, LEFT_HAND, NV, PELVIS, RIGHT_HAND, Terms
from hotice.model import g1
from hotice.model.carry import surface_distance
from hotice.model.least_squares import minimize

Array = NDArray[np.float64]
LEG_WEIGHT, ARM_WEIGHT = 0.02, 0.05
JOINT_MARGIN_RAD = 0.03


class Guess:
    """Guesses for one task; `terms` serve as scratch. That of grasp and carry state is in `together`."""

    def __init__(self, terms: Terms, task: PickTask) -> None:
        self.terms, self.task = terms, task
        self._pin = terms._pin

    def grasp_rows(self, p: Pose, stiff: float, turn: float) -> list[Rows]:
        """Palms on the object's sides; `stiff`: weight of the palms' gaps, `turn`: of the pelvis' heading."""
        task, grip = self.task, self.task.grip
        carried, pose = grip.carried, task.pose
        chest, J = p.point(PELVIS, CHEST_M)
        distance, normal = surface_distance(carried, (chest - pose.p_WO) @ pose.R_WO)
        height, by_v = p.terms.p_WF[PELVIS, 2:3] - 0.7, p.terms.J_WF[PELVIS, 2:3]
        return [
            *self.stand_rows(p, 0.0, pose.p_WO),
            *([_low(p)] if grip.steps_back else []),
            (2.0 * height, 2.0 * by_v),  # no deep squat
            _inside(task.com_box_m, *p.com(np.zeros(2), 1.0, carried.mass_kg, pose.p_WO)),
            p.palms(carried, pose, grip.gaps_m(), stiff),
            p.hand_places(pose, grip.place, np.eye(3), 15.0 if carried.shape == "box" else 50.0),
            p.hand_pitch(0.0, 2.0),
            p.pelvis_turn(np.array([0.0, 0.1, task.yaw]), np.array([6.0, 1.0, turn])),
            hinge(distance - CHEST_GAP_M, np.einsum("kc,kcv->kv", normal @ pose.R_WO.T, J), 100.0),
        ]

    def joint_bounds(self) -> tuple[Array, Array]:
        """Limits of the joints less a margin, (20,) each."""
        return self.terms.lower + JOINT_MARGIN_RAD, self.terms.upper - JOINT_MARGIN_RAD

    def pregrasp(self, grasp: Array, p_OH: Array) -> Array:
        """Posture of the grasp, palms `PREGRASP_GAP_M` off the object; p_OH (2, 3) are the hands at the grasp, in O."""
        grip, pose, before = self.task.grip, self.task.pose, self._before(grasp)

        def rows(p: Pose) -> list[Rows]:
            return [
                *before(p),
                p.palms(grip.carried, pose, grip.gaps_m(PREGRASP_GAP_M), 50.0),
                p.hand_places(pose, p_OH, np.eye(3)[[0, 2]], 15.0),
            ]

        return self._solve(grasp, grasp[g1.JOINT_POS], posture_weights(ARM_WEIGHT), rows)

    def crouch(self, grasp: Array) -> Array:
        """The body as at the grasp, the arms drawn back."""
        ready = np.concatenate([grasp[g1.JOINT_POS][g1.LOWER], ready_joints(self.task.grip.carry)[g1.UPPER]])
        return self._solve(grasp, ready, posture_weights(1.0), self._before(grasp))

    def held(self, start: Array, posture: Array, hands: Frames, at: ObjectPose, rpy: Array, *, arms: float) -> Array:
        """Hands at their poses with the object at `at`, near `start` and `posture`; `rpy`: target turn of the pelvis.

        While the robot has to step back next, the pelvis stays so low that the legs can step.
        """
        low = self.task.grip.steps_back and at is self.task.lifted

        def rows(p: Pose) -> list[Rows]:
            found = self.stand_rows(p, self.task.grip.carried.mass_kg, at.p_WO)
            for i in range(2):
                found.append(p.frame(LEFT_HAND + i, hands.p[i], hands.R[i], (200.0, 40.0)))
            found.append(p.pelvis_turn(rpy, np.array([2.0, 1.0, 1.0])))
            return [*found, _low(p)] if low else found

        return self._solve(start, posture, posture_weights(arms), rows)

    def _before(self, grasp: Array) -> Callable[[Pose], list[Rows]]:
        """Before the grasp: the pelvis as then, hands above the support."""
        t, task = self.terms, self.task
        t.q[:], t.v[:] = grasp, 0.0
        t.refresh()
        pelvis = t.p_WF[PELVIS].copy(), t.R_WF[PELVIS].copy()

        def rows(p: Pose) -> list[Rows]:
            found = [*self.stand_rows(p, 0.0, task.pose.p_WO), p.frame(PELVIS, *pelvis, (10.0, 10.0))]
            for hand in (LEFT_HAND, RIGHT_HAND):
                tips, J = p.point(hand, TIPS_M)
                found.append(hinge(tips[:, 2] - task.grip.support.top_m - TIPS_ABOVE_M, J[:, 2], 50.0))
            return found

        return rows

    def stand_rows(self, p: Pose, load: float, p_WO: Array) -> list[Rows]:
        """Feet where they are, knees off the support, a load [kg] at p_WO (3,) balanced."""
        feet, near = self.task.feet, self.task.grip.support.near_m
        com, J = p.com(np.zeros(2), 1.0, load, p_WO)
        knees = [p.point_of_joint(f"{side}_knee_joint") for side in g1.SIDES]
        room = np.array([near - KNEE_ROOM_M - x[0] for x, _ in knees])
        return [
            *(p.frame(LEFT_FOOT + i, feet.p[i], feet.R[i], (300.0, 100.0)) for i in range(2)),
            _inside(self.task.com_box_m, com, J),
            (1.0 * com, 1.0 * J),
            hinge(room, np.array([-by_v[0] for _, by_v in knees]), 100.0),
        ]

    def _solve(
        self,
        nominal: Array,
        posture: Array,
        weight: Array,
        rows: Callable[[Pose], list[Rows]],
        *,
        start: Array | None = None,
    ) -> Array:
        """The least-squares configuration near `nominal` (27,); `posture` pulls the joints, weights (20,).

        Unknowns are increments from `nominal`, (26,), from `start`.
        """
        t, pin = self.terms, self._pin
        lower = np.concatenate([np.full(6, -1.5), t.lower + JOINT_MARGIN_RAD - nominal[g1.JOINT_POS]])
        upper = np.concatenate([np.full(6, 1.5), t.upper - JOINT_MARGIN_RAD - nominal[g1.JOINT_POS]])
        t.v[:] = 0.0
        pose = Pose(t)
        eye = np.zeros((20, NV))
        eye[:, 6:] = np.diag(weight)

        def residual(x: Array) -> Rows:
            t.q[:] = pin.integrate(t.model, nominal, x)
            t.refresh()
            found = rows(pose)
            found.append((weight * (t.q[g1.JOINT_POS] - posture), eye))
            J = np.concatenate([j for _, j in found])
            return np.concatenate([r for r, _ in found]), J @ pin.dIntegrate(t.model, nominal, x, pin.ARG1)

        found = minimize(
            residual, np.zeros(NV) if start is None else start, lower, upper, max_steps=120, step_tolerance=1e-5
        )
        residual(found)
        return t.q.copy()


def posture_weights(arms: float) -> Array:
    """Weights of the joints' posture, (20,): light legs."""
    weight = np.full(g1.ACTIONS, arms)
    weight[g1.LOWER] = LEG_WEIGHT
    return weight


def _inside(box: Array, com: Array, J: Array) -> Rows:
    """Centre of mass within `box` (2, 2)."""
    return hinge(np.concatenate([com - box[0], box[1] - com]), np.concatenate([J, -J]), 100.0)


def _low(p: Pose) -> Rows:
    return hinge(STEPPING_HEIGHT_M - p.terms.p_WF[PELVIS, 2:3], -p.terms.J_WF[PELVIS, 2:3], 60.0)
