"""Planner of picks of one object from one support: first guesses, keyframes, paths; known plans come from the cache."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.control.pick_plan import cache
from hotice.control.pick_plan.grip import Grip, ready_joints
from hotice.control.pick_plan.plan import BEYOND_RAD, Durations, PickPlan, Support, beyond_range
from hotice.control.pick_plan.task import CALM_COM_BOX_M, COM_BOX_M, PickTask, frames_at
from hotice.control.whole_body.contacts import PALM_M
from hotice.control.whole_body.terms import FEET, Terms
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.frames import normalize, quat_from_yaw, yaw_from_quat
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
ROUNDED = 4
"""Decimals of a task, [m] and [rad]: what differs by less gets the same plan."""
SAME_M, SAME_RAD = 0.004, 0.01


class Planner:
    """Plans picks of one object: how it is gripped, and kinematics, are prepared once.

    Drake and CasADi are imported when a plan is made that is not in the cache.

    Args:
        carried: the object; support: what it stands on.
        durations: of the parts of a plan.
        folder: of the cache; default `cache.default_folder()`; None: no cache.
        grasp_above_m: see `Grip`.
        calm: whether the centre of mass stays so near the middle of the feet that the plan can be played back.

    Raises `CarryInfeasible` where the object cannot be held.
    """

    def __init__(
        self,
        carried: CarriedObject,
        support: Support,
        durations: Durations | None = None,
        *,
        folder: Path | str | None = "",
        calm: bool = False,
        grasp_above_m: float | None = None,
    ) -> None:
        self.carried, self.support, self.durations = carried, support, durations or Durations()
        self.folder = cache.default_folder() if folder == "" else None if folder is None else Path(folder)
        self.com_box_m = CALM_COM_BOX_M if calm else COM_BOX_M
        self.grip = Grip(carried=carried, support=support, grasp_above_m=grasp_above_m)
        self.carry, self.wrist_pos = self.grip.carry, self.grip.wrist_pos
        self.above_m, self.rise_m = self.grip.above_m, self.grip.rise_m
        self.terms = Terms(self.wrist_pos)

    @cached_property
    def start_q(self) -> Array:
        """(27,) standing at the origin, ready to begin."""
        return np.concatenate([self.carry.root_pos_W, np.roll(self.carry.quat_WP, -1), ready_joints(self.carry)])

    def plan(self, q_start: ArrayLike, p_GO: ArrayLike, quat_GO: ArrayLike) -> PickPlan:
        """Plans from a standing configuration (27,) to an object at p_GO (3,), quat_GO (4,).

        Raises `PickInfeasible`, naming the constraint that cannot be kept.
        """
        q = np.round(checks.array("q_start", q_start, 27, error=PickInfeasible), ROUNDED)
        p = np.round(checks.array("p_GO", p_GO, 3, error=PickInfeasible), ROUNDED)
        quat = np.round(normalize(checks.array("quat_GO", quat_GO, 4, error=PickInfeasible)), ROUNDED)
        q[g1.ROOT_QUAT] = normalize(q[g1.ROOT_QUAT])
        beyond = beyond_range(q)
        worst = int(np.argmax(beyond))
        if beyond[worst] > BEYOND_RAD:
            raise PickInfeasible(
                f"q_start has {g1.ACTION_JOINTS[worst]} {beyond[worst]:.3g} rad beyond its range: "
                f"at most {BEYOND_RAD:g} rad is allowed, begin within the range"
            )
        task = PickTask.of(self.grip, self.terms, q, p, quat, self.com_box_m)
        key = cache.plan_key(task, self.durations) if self.folder is not None else ""
        plan = cache.load(self.folder, key) if self.folder is not None else None
        if plan is None:
            plan = self._solve(task)
            if self.folder is not None:
                cache.save(self.folder, key, plan)
        return plan

    def fits(self, plan: PickPlan, q_start: Array, p_GO: Array, quat_GO: Array) -> bool:
        """True if an earlier plan serves here: feet and object moved by at most `SAME_M` and `SAME_RAD`."""
        now = PickTask.of(self.grip, self.terms, q_start, p_GO, quat_GO)
        feet = frames_at(self.terms, plan.to_crouch[0], FEET)
        turned = [np.linalg.norm(a - b) / np.sqrt(2.0) for a, b in zip(feet.R, now.feet.R, strict=True)]
        turned.append(abs(float(yaw_from_quat(plan.quat_GO)) - now.yaw))
        moved = [*np.linalg.norm(feet.p - now.feet.p, axis=1), np.linalg.norm(plan.p_GO - now.pose.p_WO)]
        return bool(max(moved) <= SAME_M and max(turned) <= SAME_RAD)

    def _solve(self, task: PickTask) -> PickPlan:
        from hotice.control.pick_plan.keyframes.keyframes import KeyframeSolver
        from hotice.control.pick_plan.paths.trajectory import LIFT_KNOTS, Paths

        keys = KeyframeSolver(task, self._robot, self.terms).solve()
        paths = Paths(task, self.terms, self.durations)
        crouch, reach, close = paths.approach(keys)
        hands, pose = keys.hands, task.pose
        centre = np.einsum("hji,hj->hi", hands.R, pose.p_WO - hands.p)
        centre[:, 1] = PALM_M[:, 1]  # each hand carries its half of the load where it touches
        return PickPlan(
            to_crouch=crouch,
            to_pregrasp=reach,
            to_grasp=close,
            retreat=paths.retreat(keys),
            lift_knots=LIFT_KNOTS,
            p_OH=(hands.p - pose.p_WO) @ pose.R_WO,
            p_HO=centre,
            hand_point=PALM_M + [self.grip.grip_m, 0.0, 0.0],
            p_GO=pose.p_WO,
            quat_GO=np.asarray(quat_from_yaw(task.yaw), dtype=np.float64),
            back_m=task.back_m,
        )

    @cached_property
    def _robot(self):
        from hotice.control.pick_plan.keyframes.robot import DrakeRobot

        return DrakeRobot(self.wrist_pos)
