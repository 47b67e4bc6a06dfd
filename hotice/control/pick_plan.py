"""Plan of a pick-up: whole-body keyframes from standing in front of the object to holding it in the carry state.

Frame G of all of this: origin on the floor between the feet, x ahead. The forearms stay level from grasp to carry, because
locked wrists turn an object with the forearm; the legs give the height.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.contacts import PALM_M
from hotice.control.keyframes import FEET, PALM_POINTS_M, PALM_RADIUS_M, KeyframeIk, ObjectPose, Pose, Rows, hinge
from hotice.control.terms import LEFT_HAND, PELVIS, RIGHT_HAND, Terms
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.carry import CarryState, solve_carry, surface_distance
from hotice.model.frames import quat_from_yaw, yaw_from_quat
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
SUPPORT_TOP_M = (0.40, 0.85)
GRASP_ABOVE_CENTRE_M = 0.055  # the object hangs from the palms: the higher they hold it, the less it tilts
HIGHEST_GRASP_M = 1.03
PREGRASP_GAP_M = 0.07
GRIP_AHEAD_M = 0.04
TOE_IN_M = 0.0025
WRIST_IN_RAD = 0.06
"""Boxes are held between the front of the palms, whose rear stays off by this much: locked wrists cannot make palms perfectly
flush, and which pair of palm spheres carries must be known, so that it can be put beside the centre of mass."""
PALM_REACH_M = 0.16  # a palm further than this behind the near face is not asked for
CLEAR_M = 0.03  # between object and support
READY_ARM = np.array([0.8, 0.6, 0.9, -0.7])  # left: hands wide and drawn back [rad]
TIPS_M = np.array([[0.075, 0.0, -0.04], [-0.1, 0.0, -0.04]])  # of the hand frame: fingers and wrist, from below
COM_BOX_M = np.array([[-0.035, -0.085], [0.05, 0.085]])
MAX_GAP_M = 0.008
MAX_OFF_M = 0.08
LEG_WEIGHT, ARM_WEIGHT = 0.02, 0.05
LIFT_KNOTS, RETREAT_KNOTS = 4, 8
STEPPING_HEIGHT_M = 0.755  # highest pelvis at which the legs are long enough to step


@dataclass(frozen=True, kw_only=True)
class Support:
    """What the object stands on: height of its top [m] and distance of its near edge ahead of the feet's middle [m]."""

    top_m: float
    near_m: float

    def __post_init__(self) -> None:
        low, high = SUPPORT_TOP_M
        if not (np.isfinite(self.top_m) and low <= self.top_m <= high):
            raise PickInfeasible(f"support top at {self.top_m:.2f} m: allowed are {low:.2f} to {high:.2f} m")
        if not (np.isfinite(self.near_m) and 0.15 <= self.near_m <= 0.6):
            raise PickInfeasible(
                f"support edge {self.near_m:.2f} m ahead of the feet: allowed are 0.15 to 0.60 m, stand nearer or farther"
            )


@dataclass(frozen=True, kw_only=True)
class PickPlan:
    """Configurations (27,) in Pinocchio's order, in G.

    Attributes:
        crouch: pelvis ready for the grasp, arms drawn back; pregrasp: palms off the object; grasp: palms on it.
        retreat: (K, 27) from the grasp over the lifted object to the carry state.
        lift_knots: how many of them belong to the lift.
        p_OH: (2, 3) palms in the object frame [m]. p_HO: (2, 3) the object's centre in the hand frames, moved to the palms.
        hand_point: (2, 3) where the hands press, in their frames [m].
        p_GO: (3,) where the object ends, in G as it is then; back_m: how far the robot steps back between lift and retreat.
    """

    crouch: Array
    pregrasp: Array
    grasp: Array
    retreat: Array
    lift_knots: int
    p_OH: Array
    p_HO: Array
    hand_point: Array
    p_GO: Array
    back_m: float


def ready_joints(carry: CarryState) -> Array:
    """Standing with the arms drawn back and apart, (20,) [rad]; the legs are those of the carry state."""
    joints = carry.joint_pos.copy()
    sign = g1.mirror_joints()[1][g1.UPPER][4:]
    joints[g1.UPPER] = np.concatenate([READY_ARM, sign * READY_ARM])
    return joints


class Planner:
    """Plans picks of one object: its carry state, locked wrists and kinematics are solved once.

    Raises `CarryInfeasible` where the object cannot be held.
    """

    def __init__(self, carried: CarriedObject, support: Support) -> None:
        self.carried, self.support = carried, support
        half = carried.half_extents_m
        room = min(GRASP_ABOVE_CENTRE_M, half[2] - 0.05, HIGHEST_GRASP_M - support.top_m - half[2])
        self.above_m = 0.0 if carried.shape == "sphere" else max(room, 0.02)
        box = carried.shape == "box"
        self.grip_m = GRIP_AHEAD_M if box else 0.0
        self.toe_m = np.where(PALM_POINTS_M[:, 0] < 0, TOE_IN_M, 0.0) if box else np.zeros(4)
        self.carry = solve_carry(carried, grasp_height_m=self.above_m)
        self.wrist_pos = self.carry.wrist_pos + WRIST_IN_RAD * np.array([0, 0, -1.0, 0, 0, 1.0]) * box
        self.terms = Terms(self.wrist_pos)
        self._ik = KeyframeIk(self.terms)
        self.rise_m = 2 * CLEAR_M
        p = self.carry.object_pos_W
        self.steps_back = bool(p[0] + half[0] + CLEAR_M > support.near_m and p[2] - half[2] < support.top_m + CLEAR_M)

    def plan(self, q_start: Array, p_GO: ArrayLike, quat_GO: ArrayLike) -> PickPlan:
        """Plans from a standing configuration (27,) to an object at p_GO (3,), quat_GO (4,). Raises `PickInfeasible`."""
        p_GO, quat_GO = _finite("p_GO", p_GO, 3), _finite("quat_GO", quat_GO, 4)
        t, carried = self.terms, self.carried
        t.q[:], t.v[:] = q_start, 0.0
        t.refresh()
        feet = [(f, t.p_WF[f].copy(), t.R_WF[f].copy()) for f in FEET]
        yaw = self._yaw(quat_GO)
        pose = ObjectPose.of(p_GO, quat_from_yaw(yaw))
        grasp = self._grasp(q_start, feet, pose, yaw)
        pelvis_p, pelvis_R = t.p_WF[PELVIS].copy(), t.R_WF[PELVIS].copy()
        hands = [(f, t.p_WF[f].copy(), t.R_WF[f].copy()) for f in (LEFT_HAND, RIGHT_HAND)]
        p_OH = np.array([pose.R_WO.T @ (p - pose.p_WO) for _, p, _ in hands])
        centre = np.array([R.T @ (pose.p_WO - p) for _, p, R in hands])
        centre[:, 1] = PALM_M[:, 1]  # each hand carries its half of the load where it touches

        legs, arms = np.full(20, LEG_WEIGHT), np.full(20, ARM_WEIGHT)
        arms[g1.LOWER] = LEG_WEIGHT

        def before(p: Pose) -> list[Rows]:
            rows = [*self._stand(p, feet, 0.0, pose.p_WO), p.frame(PELVIS, pelvis_p, pelvis_R, (10.0, 10.0))]
            for hand in (LEFT_HAND, RIGHT_HAND):
                tips, J = p.point(hand, TIPS_M)
                rows.append(hinge(tips[:, 2] - self.support.top_m - 0.05, J[:, 2], 50.0))
            return rows

        def pregrasp(p: Pose) -> list[Rows]:
            return [
                *before(p),
                p.palms(carried, pose, PREGRASP_GAP_M + self.toe_m, 50.0),
                p.hand_places(pose, p_OH, np.eye(3)[[0, 2]], 15.0),
            ]

        pre = self._ik.solve(grasp, grasp[7:], arms, pregrasp)
        legs[g1.UPPER] = 1.0
        ready = np.concatenate([grasp[7:19], ready_joints(self.carry)[g1.UPPER]])
        crouch = self._ik.solve(grasp, ready, legs, before)

        final, back = self._carry_pose(pose)
        lifted = ObjectPose(p_WO=pose.p_WO + [0.0, 0.0, self._rise(pose)], R_WO=pose.R_WO)
        holds = _Holds(feet=feet, hands=hands, grasped=pose, p_OH=p_OH)
        retreat, turned = [grasp], _rpy(t._pin, grasp[3:7])
        for share in np.linspace(0.0, 1.0, LIFT_KNOTS + 1)[1:]:
            at = _between(pose, lifted, share)
            retreat.append(self._held(retreat[-1], grasp[7:], holds, at, turned, arms=0.5, low=self.steps_back))
        end = self._carried_stance(self._carry_q(q_start), holds, final)
        final = ObjectPose(p_WO=self._middle_of(end) - self._offset(holds, final), R_WO=final.R_WO)
        up = retreat[-1]
        for share in np.linspace(0.0, 1.0, RETREAT_KNOTS + 1)[1:-1]:
            guess = t._pin.interpolate(t.model, up, end, share)
            retreat.append(self._pulled(guess, holds, _between(lifted, final, share)))
        retreat.append(end)
        return PickPlan(
            crouch=crouch, pregrasp=pre, grasp=grasp, retreat=np.array(retreat), lift_knots=LIFT_KNOTS, p_OH=p_OH,
            p_HO=centre, hand_point=PALM_M + [self.grip_m, 0.0, 0.0], p_GO=final.p_WO, back_m=back,
        )  # fmt: skip

    def _yaw(self, quat_GO: Array) -> float:
        if self.carried.shape != "box":
            return 0.0
        return float(yaw_from_quat(quat_GO))

    def _stand(self, p: Pose, feet: list, load: float, p_WO: Array) -> list[Rows]:
        com, J = p.com(np.zeros(2), 1.0, load, p_WO)
        knees = [p.point_of_joint(joint) for joint in ("left_knee_joint", "right_knee_joint")]
        room = np.array([self.support.near_m - 0.07 - x[0] for x, _ in knees])
        return [
            *(p.frame(f, at, R, (300.0, 100.0)) for f, at, R in feet),
            _inside(com, J),
            (1.0 * com, 1.0 * J),
            hinge(room, np.array([-by_v[0] for _, by_v in knees]), 100.0),
        ]

    def _grasp(self, q_start: Array, feet: list, pose: ObjectPose, yaw: float) -> Array:
        t, carried, half = self.terms, self.carried, self.carried.half_extents_m
        weight = np.full(20, ARM_WEIGHT)
        weight[g1.LOWER] = LEG_WEIGHT
        place = np.array(
            [
                [
                    min(-self.grip_m, PALM_REACH_M - half[0]) if self.grip_m else 0.0,
                    s * (half[1] + PALM_RADIUS_M),
                    self.above_m,
                ]
                for s in (1.0, -1.0)
            ]
        )
        front = np.array([[0.079, y, z] for y in (-0.08, 0.08) for z in (0.0, 0.14, 0.27)])

        def rows(stiff: float, turn: float):
            def at(p: Pose) -> list[Rows]:
                chest, J = p.point(PELVIS, front)
                distance, normal = surface_distance(carried, (chest - pose.p_WO) @ pose.R_WO)
                return [
                    *self._stand(p, feet, 0.0, pose.p_WO),
                    *([self._low(p)] if self.steps_back else []),
                    *([] if carried.shape == "box" else [_upright(p)]),
                    _inside(*p.com(np.zeros(2), 1.0, carried.mass_kg, pose.p_WO)),
                    p.palms(carried, pose, self.toe_m, stiff),
                    p.hand_places(pose, place, np.eye(3), 15.0),
                    p.hand_pitch(0.0, 2.0),
                    p.pelvis_turn(np.array([0.0, 0.1, yaw]), np.array([6.0, 1.0, turn])),
                    hinge(distance - 0.02, np.einsum("kc,kcv->kv", normal @ pose.R_WO.T, J), 100.0),
                ]

            return at

        best, cost = q_start, np.inf
        for lean, drop, bend in (
            (0.0, 0.0, 0.0),
            (0.2, -0.1, 0.25),
            (0.5, -0.05, 0.0),
            (0.0, -0.25, 0.7),
            (0.3, -0.3, 0.8),
        ):
            x = np.zeros(26)
            x[2], x[4] = drop, lean
            for first in (6, 12):
                x[first], x[first + 3], x[first + 4] = -bend - lean, 2.0 * bend, -bend
            nominal = np.concatenate([q_start[:7], self.carry.joint_pos])
            q = self._ik.solve(nominal, self.carry.joint_pos, weight, rows(12.0, 2.0), start=x)
            x = t._pin.difference(t.model, nominal, q)
            q = self._ik.solve(nominal, self.carry.joint_pos, weight, rows(300.0, 0.3), start=x)
            now = sum(float(r @ r) for r, _ in rows(300.0, 0.3)(Pose(t)))
            if now < cost:
                best, cost = q, now
            if cost < 0.5:
                break
        self.cost = cost
        t.q[:] = best
        t.refresh()
        p = Pose(t)
        gap = float(np.abs(p.palms(carried, pose, self.toe_m, 1.0)[0]).max())
        off = float(np.abs(p.hand_places(pose, place, np.eye(3), 1.0)[0]).max())
        slip = max(float(np.linalg.norm(t.p_WF[f] - at)) for f, at, _ in feet)
        if gap > MAX_GAP_M or off > MAX_OFF_M or slip > 0.01:
            x, y, z = pose.p_WO
            raise PickInfeasible(
                f"{carried.shape} at x {x:.2f}, y {y:.2f}, z {z:.2f} m from the feet, turned {np.degrees(yaw):.0f} deg, "
                f"cannot be grasped standing: the palms miss its sides by {1e3 * gap:.0f} mm and their places by "
                f"{1e3 * off:.0f} mm; stand nearer and face it"
            )
        return best

    def _rise(self, pose: ObjectPose) -> float:
        return self.rise_m

    def _carry_pose(self, pose: ObjectPose) -> tuple[ObjectPose, float]:
        """Where the carry state has the object, and how far to step back first where the support is in the way [m]."""
        p, half = self.carry.object_pos_W, self.carried.half_extents_m
        back = 0.0
        if self.steps_back:
            extent = np.abs(pose.R_WO[0]) @ half
            back = float(pose.p_WO[0] + extent + CLEAR_M - self.support.near_m)
        return ObjectPose(p_WO=p, R_WO=np.eye(3)), back

    def _carry_q(self, q_start: Array) -> Array:
        return np.concatenate([self.carry.root_pos_W, np.roll(self.carry.quat_WP, -1), self.carry.joint_pos])

    @staticmethod
    def _low(p: Pose) -> Rows:
        return hinge(STEPPING_HEIGHT_M - p.terms.p_WF[PELVIS, 2:3], -p.terms.J_WF[PELVIS, 2:3], 60.0)

    def _held(
        self, start: Array, posture: Array, holds: _Holds, at: ObjectPose, rpy: Array, *, arms: float, low: bool = False
    ) -> Array:
        """The robot with the object at a pose and its hands on it as they grasped it, near `start` and `posture`.

        `rpy`: wished turn of the pelvis; `arms`: weight of the posture of the arms; `low`: the pelvis lets the legs step.
        """
        weight = np.full(20, arms)
        weight[g1.LOWER] = LEG_WEIGHT
        R = at.R_WO @ holds.grasped.R_WO.T

        def rows(p: Pose) -> list[Rows]:
            found = self._stand(p, holds.feet, self.carried.mass_kg, at.p_WO)
            for (f, _, R_hand), place in zip(holds.hands, holds.p_OH, strict=True):
                found.append(p.frame(f, at.p_WO + at.R_WO @ place, R @ R_hand, (200.0, 40.0)))
            found.append(p.pelvis_turn(rpy, np.array([2.0, 1.0, 1.0])))
            if low:
                found.append(self._low(p))
            return found

        return self._ik.solve(start, posture, weight, rows)

    def _carried_stance(self, start: Array, holds: _Holds, at: ObjectPose) -> Array:
        """The end: pelvis and legs of the carry state, from which carrying controllers take over.

        The object is level and as near to its place there as the arms, with their wrists locked, can have it.
        """
        weight = np.full(20, 0.3)
        weight[g1.LOWER] = LEG_WEIGHT
        R = at.R_WO @ holds.grasped.R_WO.T
        apart = at.R_WO @ (holds.p_OH[0] - holds.p_OH[1])
        middle = at.p_WO + self._offset(holds, at)
        height = self.carry.root_pos_W[2]

        def rows(p: Pose) -> list[Rows]:
            t, (left, right) = self.terms, (LEFT_HAND, RIGHT_HAND)
            found = self._stand(p, holds.feet, self.carried.mass_kg, at.p_WO)
            found.append(
                (200.0 * (t.p_WF[left] - t.p_WF[right] - apart), 200.0 * (t.J_WF[left, :3] - t.J_WF[right, :3]))
            )
            mean, J = 0.5 * (t.p_WF[left] + t.p_WF[right]), 0.5 * (t.J_WF[left, :3] + t.J_WF[right, :3])
            soft = np.array([5.0, 60.0, 5.0])
            found.append((soft * (mean - middle), soft[:, None] * J))
            for f, _, R_hand in holds.hands:
                r, J = p.frame(f, t.p_WF[f], R @ R_hand, (0.0, 40.0))
                found.append((r[3:], J[3:]))
            found.append((100.0 * (t.p_WF[PELVIS, 2:3] - height), 100.0 * t.J_WF[PELVIS, 2:3]))
            found.append(p.pelvis_turn(np.zeros(3), np.array([20.0, 20.0, 20.0])))
            return found

        return self._ik.solve(start, self.carry.joint_pos, weight, rows)

    def _offset(self, holds: _Holds, at: ObjectPose) -> Array:
        return at.R_WO @ (0.5 * (holds.p_OH[0] + holds.p_OH[1]))

    def _middle_of(self, q: Array) -> Array:
        self.terms.q[:], self.terms.v[:] = q, 0.0
        self.terms.refresh()
        return 0.5 * (self.terms.p_WF[LEFT_HAND] + self.terms.p_WF[RIGHT_HAND])

    def _pulled(self, guess: Array, holds: _Holds, at: ObjectPose) -> Array:
        """The robot near `guess`, with its hands as far apart and turned as at the grasp; the object may be ahead of `at`."""
        weight = np.tile(
            [3.0, 0.3, 0.3, 3.0], 5
        )  # shoulder pitch and elbow lead, or the arms would jump from one branch to another
        weight[g1.LOWER] = LEG_WEIGHT
        R = at.R_WO @ holds.grasped.R_WO.T
        pelvis = _rpy(self.terms._pin, guess[3:7])
        apart = at.R_WO @ (holds.p_OH[0] - holds.p_OH[1])
        middle = at.p_WO + at.R_WO @ (0.5 * (holds.p_OH[0] + holds.p_OH[1]))
        lowest = self.support.top_m + self.carried.half_extents_m[2] + 0.5 * CLEAR_M + self.above_m

        def rows(p: Pose) -> list[Rows]:
            t, (left, right) = self.terms, (LEFT_HAND, RIGHT_HAND)
            found = self._stand(p, holds.feet, self.carried.mass_kg, at.p_WO)
            found.append(
                (200.0 * (t.p_WF[left] - t.p_WF[right] - apart), 200.0 * (t.J_WF[left, :3] - t.J_WF[right, :3]))
            )
            mean, J = 0.5 * (t.p_WF[left] + t.p_WF[right]), 0.5 * (t.J_WF[left, :3] + t.J_WF[right, :3])
            soft = np.array([1.0, 60.0, 3.0])
            found.append((soft * (mean - middle), soft[:, None] * J))
            if not self.steps_back:
                found.append(hinge(mean[2:] - lowest, J[2:], 60.0))
            for f, _, R_hand in holds.hands:
                r, J = p.frame(f, t.p_WF[f], R @ R_hand, (0.0, 40.0))
                found.append((r[3:], J[3:]))
            found.append(p.pelvis_turn(pelvis, np.array([2.0, 1.0, 2.0])))
            return found

        return self._ik.solve(guess, guess[7:], weight, rows)


@dataclass(frozen=True, kw_only=True)
class _Holds:
    """What a held object keeps: the feet's poses, and the hands' poses relative to the object as it was grasped."""

    feet: list
    hands: list
    grasped: ObjectPose
    p_OH: Array


def _upright(p: Pose) -> Rows:
    """The pelvis is rather at 0.7 m than in a deep squat, which round objects would allow."""
    return 3.0 * (p.terms.p_WF[PELVIS, 2:3] - 0.7), 3.0 * p.terms.J_WF[PELVIS, 2:3]


def _inside(com: Array, J: Array) -> Rows:
    """Centre of mass within `COM_BOX_M`."""
    return hinge(np.concatenate([com - COM_BOX_M[0], COM_BOX_M[1] - com]), np.concatenate([J, -J]), 100.0)


def _finite(name: str, value: ArrayLike, size: int) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise PickInfeasible(f"{name} of the object has shape {array.shape}: {size} finite numbers are needed")
    return array


def _rpy(pin: Any, quat: Array) -> Array:
    return pin.rpy.matrixToRpy(pin.Quaternion(quat).matrix())


def _between(a: ObjectPose, b: ObjectPose, s: float) -> ObjectPose:
    """Straight line and single turn about z from a to b."""
    yaw = np.arctan2(a.R_WO[1, 0], a.R_WO[0, 0]) * (1 - s) + np.arctan2(b.R_WO[1, 0], b.R_WO[0, 0]) * s
    return ObjectPose.of((1 - s) * a.p_WO + s * b.p_WO, quat_from_yaw(yaw))
