"""The estimator of a robot: what it knows of itself and its object, tracked as students are trained."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.estimate.held import HeldObject
from hotice.deploy.estimate.root import RootTracker
from hotice.deploy.estimate.seen import Look
from hotice.deploy.frames import WAIST
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.past import Past, Torso
from hotice.deploy.runner.estimator import Estimate
from hotice.model import g1
from hotice.model.frames import mat_to_quat, normalize, quat_to_mat
from hotice.model.objects import CarriedObject
from hotice.model.robot_state import RobotState, joint_index
from hotice.policy.legs import Legs
from hotice.policy.measuring import attitude, heading
from hotice.policy.percept import PerceptModel
from hotice.task.sensing import STUDENT_SENSING

Array = NDArray[np.float64]
LOST_S = 0.25
"""After so long without a pose near tracking, two of them missing, the legs say where the root is."""
_JOINTS, _REST = joint_index(len(g1.ACTION_JOINTS)), np.zeros(43)
_REST[[3, 39]] = 1.0
"""Upright, all joints straight."""


class TrackingEstimator:
    """See `Estimator`: gravity, gyro and joints are the robot's own; its place is tracked, its object filtered.

    While no pose comes, and while poses insist on another place, the root is where gyro and legs carry it.

    Args:
        carried: the object
        pelvis: X_WP, the pelvis in the scene; place and heading count, roll and pitch are the IMU's
        box: X_PO, the object seen from the pelvis, where it stays while it is not seen
        control_dt_s: time from update to update [s], for the object's filter
        latency_s: of localization, as far as it is known [s]
    """

    def __init__(
        self,
        carried: CarriedObject,
        pelvis: Look,
        box: Look,
        *,
        control_dt_s: float = 0.02,
        latency_s: float = 0.0,
    ) -> None:
        self._carried, self._pelvis, self._box = carried, pelvis, box
        self._model = PerceptModel(carried)
        self._legs, self._last, self._foot = Legs(self._model, _REST), None, np.nan
        self._root = RootTracker(latency_s=latency_s)
        self._past = Past()
        self._object = HeldObject(STUDENT_SENSING.object_gain(control_dt_s))

    def update(self, state: np.ndarray, now_s: float, state_s: float | None = None) -> Estimate | None:
        """See `Estimator.update`."""
        imu, motors = state["imu_state"], state["motor_state"][JOINTS]
        gravity_P = -quat_to_mat(normalize(imu["quaternion"].astype(float)))[2]
        w_WP_P, q = imu["gyroscope"].astype(float), motors["q"].astype(float)
        tracked, held = self._root, self._object
        passed_s = tracked.gravity(gravity_P, w_WP_P, now_s)
        self._past.add(Torso(q[list(WAIST)], -tracked.down_P), now_s if state_s is None else state_s)
        tracked.move(self._pelvis(self._past, now_s), w_WP_P, passed_s, now_s)
        held.step(self._box(self._past, now_s))
        if tracked.root is None or held.pose is None:
            return None
        yaw = heading(tracked.root)
        self._walk(q[_JOINTS], float(yaw[0]), now_s)
        R_WP, p_WP = attitude(yaw[0], tracked.down_P), tracked.root[:3].copy()
        robot = RobotState(
            p_WP=p_WP,
            quat_WP=mat_to_quat(R_WP),
            w_WP_P=w_WP_P,
            joint_pos=q,
            joint_vel=motors["dq"].astype(float),
            carried=self._carried,
            p_WO=p_WP + R_WP @ held.pose[0],
            quat_WO=mat_to_quat(R_WP @ held.rotation),
        )
        percept = self._model(*robot.to_mujoco(len(g1.ALL_JOINTS)))
        self._last = percept
        # what a policy reads of gravity is the measurement, not what is tracked for places
        percept.gravity_P[:] = gravity_P
        return Estimate(
            percept=percept,
            pose_age_s=now_s - tracked.accepted_s,
            box_age_s=now_s - held.accepted_s,
            disputed=tracked.moved,
            pose_verdict=tracked.verdict,
            box_verdict=held.verdict,
        )

    def _walk(self, q: Array, yaw: float, now_s: float) -> None:
        """Carries the root on by its legs while poses do not say where it is."""
        if self._last is None or now_s - self._root.tracked_s <= LOST_S:
            self._foot = np.nan
            return
        p_WP, p_WK = self._last.p_WP, self._last.p_WK
        p_WP, _, self._foot = self._legs.step(p_WP, p_WK, self._foot, yaw, self._root.down_P, q)
        self._root.walk(p_WP)

    def acknowledge(self) -> None:
        """See `Estimator.acknowledge`."""
        self._root.acknowledge()

    def settle(self) -> None:
        """See `Estimator.settle`."""
        self._root.settle()
