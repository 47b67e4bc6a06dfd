"""A first estimator: the newest poses of pelvis and object as they come, jumps refused; IMU and joints as measured.

It neither tracks between poses nor filters: `hotice.systems.sensor_model` does, as students are trained.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.runner.estimator import Estimate
from hotice.model import g1
from hotice.model.frames import normalize, quat_from_yaw, quat_mul, quat_rotate, quat_to_mat, yaw_from_quat
from hotice.model.objects import CarriedObject
from hotice.model.robot_state import RobotState
from hotice.policy.percept import PerceptModel
from hotice.safety import PoseGate
from hotice.safety.limits import BOX_JUMP, POSE_JUMP

Array = NDArray[np.float64]


class SeenPose(NamedTuple):
    """A pose that a source gave: position (3,) [m], quaternion (4,) wxyz, and when it came [s]."""

    p: Array
    quat: Array
    received_s: float


class _Gated:
    """Newest pose of a source that passed its gate."""

    def __init__(self, gate: PoseGate) -> None:
        self._gate, self._seen_s = gate, -np.inf
        self._refused = False
        self.pose: SeenPose | None = None
        self.moved = False
        """Whether the pose was accepted somewhere else, after so many refused ones agreed."""

    def offer(self, pose: SeenPose | None) -> None:
        """A pose, the same again and none of no effect; one that is not finite is refused."""
        if pose is None or pose.received_s <= self._seen_s:
            return
        self._seen_s = pose.received_s
        if not (np.isfinite(pose.p).all() and np.isfinite(pose.quat).all() and np.any(pose.quat)):
            return
        accepted = self._gate.accepts(np.asarray(pose.p, float), quat_to_mat(normalize(pose.quat)))
        if accepted:
            self.pose, self.moved = pose, self.moved or self._refused
        self._refused = not accepted

    def age_s(self, now_s: float) -> float:
        return np.inf if self.pose is None else now_s - self.pose.received_s


class DirectEstimator:
    """See `Estimator`.

    Args:
        carried: the object
        pelvis: X_WP, the pelvis in the scene; its heading counts, roll and pitch are the IMU's
        box: X_PO, the object seen from the pelvis, where it stays while it is not seen
    """

    def __init__(
        self,
        carried: CarriedObject,
        pelvis: Callable[[], SeenPose | None],
        box: Callable[[], SeenPose | None],
    ) -> None:
        self._carried, self._read_pelvis, self._read_box = carried, pelvis, box
        self._model = PerceptModel(carried)
        self._pelvis, self._box = _Gated(PoseGate(POSE_JUMP)), _Gated(PoseGate(BOX_JUMP))

    def update(self, state: np.ndarray, now_s: float) -> Estimate | None:
        """See `Estimator.update`."""
        self._pelvis.offer(self._read_pelvis())
        self._box.offer(self._read_box())
        pelvis, box = self._pelvis.pose, self._box.pose
        if pelvis is None or box is None:
            return None
        imu, motors = state["imu_state"], state["motor_state"][JOINTS]
        measured = normalize(imu["quaternion"].astype(float))
        # the IMU's own heading starts anywhere
        turn = quat_from_yaw(yaw_from_quat(pelvis.quat) - yaw_from_quat(measured))
        quat_WP = quat_mul(turn, measured)
        robot = RobotState(
            p_WP=pelvis.p,
            quat_WP=quat_WP,
            w_WP_P=imu["gyroscope"].astype(float),
            joint_pos=motors["q"].astype(float),
            joint_vel=motors["dq"].astype(float),
            carried=self._carried,
            p_WO=pelvis.p + quat_rotate(quat_WP, box.p),
            quat_WO=quat_mul(quat_WP, box.quat),
        )
        return Estimate(
            percept=self._model(*robot.to_mujoco(len(g1.ALL_JOINTS))),
            pose_age_s=self._pelvis.age_s(now_s),
            box_age_s=self._box.age_s(now_s),
            disputed=self._pelvis.moved,
        )

    def settle(self) -> None:
        """See `Estimator.settle`."""
        self._pelvis.moved = False
