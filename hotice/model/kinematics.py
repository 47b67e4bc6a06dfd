"""Robot and object as one Pinocchio model: where points of its bodies are and how they move with v.

v is Pinocchio's: twist of the pelvis in its own frame (linear, angular), joints, then the twist of the object in its
frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidState, UnknownName
from hotice.model import builder
from hotice.model.robot_state import BASE_NV, RobotState, joint_index

if TYPE_CHECKING:
    import pinocchio

Array = NDArray[np.float64]


@lru_cache(maxsize=2)
def _model(carries: bool) -> pinocchio.Model:
    import pinocchio as pin

    model = builder.pinocchio_model(29)
    if carries:
        model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), builder.OBJECT_BODY)
    return model


@lru_cache(maxsize=2)
def _support(carries: bool) -> Array:
    model = _model(carries)
    support = np.zeros((model.njoints, model.nv))
    for joint in range(1, model.njoints):
        for above in model.supports[joint].tolist()[1:]:
            start = model.joints[above].idx_v
            support[joint, start : start + model.joints[above].nv] = 1.0
    return support


@lru_cache(maxsize=2)
def _frames(body: bool) -> dict[str, tuple[int, pinocchio.SE3]]:
    """Parent joint and pose in its frame of the bodies or the sites of g1.xml, by name."""
    import pinocchio as pin

    kind = pin.FrameType.BODY if body else pin.FrameType.OP_FRAME
    return {f.name: (int(f.parentJoint), f.placement.copy()) for f in _model(False).frames if f.type == kind}


class Kinematics:
    """The 29-joint robot, and a free object where `carries`; call `update` before asking for points.

    `model` and `data` are Pinocchio's; `support` (joints, nv) says which parts of v move the body behind a joint.
    """

    def __init__(self, carries: bool) -> None:
        self.carries = carries
        self.model = _model(carries)
        self.data = self.model.createData()
        self.support = _support(carries)
        self.object_joint = self.model.getJointId(builder.OBJECT_BODY) if carries else 0

    def columns(self, joints: int) -> NDArray[np.int64]:
        """Indices of the parts of v that the robot with 20 or 29 joints has, object included. Raises `InvalidState`."""
        base, held = np.arange(BASE_NV), np.arange(BASE_NV + 29, self.model.nv)
        return np.concatenate([base, BASE_NV + joint_index(joints), held])

    def update(self, state: RobotState) -> Array:
        """Places every joint and computes the Jacobian of all; returns v. Raises `InvalidState` without the object."""
        import pinocchio as pin

        if self.carries and state.carried is None:
            raise InvalidState("the state carries no object: give carried=, p_WO and quat_WO")
        q, v = state.to_pinocchio()
        pin.computeJointJacobians(self.model, self.data, q[: self.model.nq])
        return v[: self.model.nv]

    def body_frame(self, body: str) -> tuple[int, pinocchio.SE3]:
        """Joint that carries a body of g1.xml, and the body's pose in that joint's frame. Raises `UnknownName`."""
        return self._frame(body, _frames(True))

    def sites(self, names: Sequence[str]) -> tuple[NDArray[np.int64], Array]:
        """Joint (K,) and place p_JK (K, 3) [m] in the joint's frame of sites of g1.xml. Raises `UnknownName`."""
        found = [self._frame(name, _frames(False)) for name in names]
        return np.array([j for j, _ in found]), np.array([X.translation for _, X in found])

    def points(self, joint: NDArray[np.int64], p_J: Array) -> Array:
        """Points p_J (K, 3) of joint frames (K,) in W, (K, 3) [m]."""
        X_WJ = self.data.oMi
        return np.array([X_WJ[int(j)].act(p) for j, p in zip(joint, p_J, strict=True)])

    def point_jacobian(self, joint: NDArray[np.int64], p_W: Array) -> Array:
        """d(velocity in W)/dv of points p_W (K, 3) fixed to the bodies behind joints (K,), (K, 3, nv)."""
        linear, angular = self.data.J[:3], self.data.J[3:]
        moves = linear.T + np.cross(angular.T, p_W[:, None])  # (K, nv, 3)
        return np.swapaxes(moves * self.support[joint][..., None], 1, 2)

    @staticmethod
    def _frame(name: str, known: dict[str, tuple[int, pinocchio.SE3]]) -> tuple[int, pinocchio.SE3]:
        if name not in known:
            raise UnknownName("frame", name, known)
        return known[name]
