"""One configuration of robot and carried object, and its translation between MuJoCo and Pinocchio.

A state always holds all 29 joints: the 20-joint robot is one whose waist stands at zero and whose wrists stand still.

| | base and object pose | their velocity |
|---|---|---|
| here, MuJoCo | position, quaternion wxyz | linear in W, angular in the body |
| Pinocchio | position, quaternion xyzw | linear and angular in the body |
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.errors import InvalidState
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.frames import normalize, quat_conj, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.objects import CarriedObject

Array = NDArray[np.float64]
BASE_NQ, BASE_NV = 7, 6
_ACTION = np.array([g1.ALL_JOINTS.index(j) for j in g1.ACTION_JOINTS])
_WRIST = np.array([g1.ALL_JOINTS.index(j) for j in g1.WRIST_JOINTS])
_JOINTS = {20: _ACTION, 29: np.arange(len(g1.ALL_JOINTS))}
_IDENTITY = (1.0, 0.0, 0.0, 0.0)


def _zeros(size: int) -> Any:
    return field(default_factory=lambda: np.zeros(size))


def joint_index(joints: int) -> NDArray[np.int64]:
    """Indices of the 29 joints that a robot with 20 or 29 moves, (joints,). Raises `InvalidState`."""
    if joints not in _JOINTS:
        raise InvalidState(f"robot with {joints!r} joints: allowed are 20 (waist and wrists locked) and 29 (all)")
    return _JOINTS[joints]


@dataclass(frozen=True, kw_only=True)
class RobotState:
    """Pelvis, joints (order `g1.ALL_JOINTS`) and object at one instant; velocities default to rest.

    Attributes:
        p_WP: (3,) pelvis [m]; quat_WP: (4,) wxyz; v_WP: (3,) [m/s]; w_WP_P: (3,) in P [rad/s].
        joint_pos: (29,) [rad]; joint_vel: (29,) [rad/s].
        carried: what is carried, if anything; p_WO, quat_WO, v_WO, w_WO_O: as for the pelvis, of its centre.

    Raises:
        InvalidState: a part of the wrong size or not finite, or a quaternion of length zero.
    """

    p_WP: Array
    joint_pos: Array
    quat_WP: Array = field(default_factory=lambda: np.array(_IDENTITY))
    v_WP: Array = _zeros(3)
    w_WP_P: Array = _zeros(3)
    joint_vel: Array = _zeros(29)
    carried: CarriedObject | None = None
    p_WO: Array = _zeros(3)
    quat_WO: Array = field(default_factory=lambda: np.array(_IDENTITY))
    v_WO: Array = _zeros(3)
    w_WO_O: Array = _zeros(3)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name == "carried":
                continue
            size = 29 if name.startswith("joint") else 4 if name.startswith("quat") else 3
            array = checks.array(name, value, size, error=InvalidState)
            if size == 4 and np.linalg.norm(array) < 1e-6:
                raise InvalidState(f"{name} has length 0: a quaternion w, x, y, z is needed")
            object.__setattr__(self, name, normalize(array) if size == 4 else array)

    @classmethod
    def from_mujoco(
        cls,
        qpos: ArrayLike,
        qvel: ArrayLike | None = None,
        *,
        carried: CarriedObject | None = None,
        wrist_pos: ArrayLike | None = None,
    ) -> RobotState:
        """State of a model of `builder.build_model`, with 20 or 29 joints, with or without object.

        Args:
            qpos: (27,) or (36,), with object (34,) or (43,); qvel: (26,), (35,), (32,) or (41,), default zero.
            carried: the object; needed where qpos holds one.
            wrist_pos: (6,) angles at which the wrists of the 20-joint robot are welded, default zero.

        Raises:
            InvalidState: sizes that fit no model.
        """
        qpos = np.asarray(qpos, dtype=np.float64)
        sizes = {BASE_NQ + j + o: j for j in (20, 29) for o in (0, BASE_NQ) if bool(o) == (carried is not None)}
        joints = sizes.get(qpos.size)
        if joints is None:
            what = "without object" if carried is None else "with object"
            raise InvalidState(f"qpos {what} has shape {qpos.shape}: {' or '.join(map(str, sizes))} numbers are needed")
        qvel = np.zeros(qpos.size - (1 if carried is None else 2)) if qvel is None else np.asarray(qvel, np.float64)
        nv = qpos.size - (1 if carried is None else 2)
        if qvel.shape != (nv,):
            raise InvalidState(f"qvel has shape {qvel.shape}: {nv} numbers belong to a qpos of {qpos.size}")
        q, qd = np.zeros(29), np.zeros(29)
        if joints == 20 and wrist_pos is not None:
            q[_WRIST] = wrist_pos
        q[_JOINTS[joints]] = qpos[BASE_NQ : BASE_NQ + joints]
        qd[_JOINTS[joints]] = qvel[BASE_NV : BASE_NV + joints]
        held: dict[str, Any] = {}
        if carried is not None:
            x, v = qpos[-BASE_NQ:], qvel[-BASE_NV:]
            held = {"carried": carried, "p_WO": x[:3], "quat_WO": x[3:], "v_WO": v[:3], "w_WO_O": v[3:]}
        return cls(
            p_WP=qpos[g1.ROOT_POS],
            quat_WP=qpos[g1.ROOT_QUAT],
            joint_pos=q,
            v_WP=qvel[g1.ROOT_VEL],
            w_WP_P=qvel[g1.ROOT_RATE],
            joint_vel=qd,
            **held,
        )

    @classmethod
    def from_carry(cls, state: CarryState) -> RobotState:
        """The robot at rest in a carry state."""
        return cls.from_mujoco(state.qpos(), carried=state.carried, wrist_pos=state.wrist_pos)

    @classmethod
    def at_start(cls, state: CarryState, start: tuple[float, float, float]) -> RobotState:
        """The robot at rest in a carry state, its pelvis at a scene's `start`: x, y [m], heading [rad]."""
        x, y, yaw = start
        turn, held = quat_from_yaw(yaw), cls.from_carry(state)
        pelvis = np.array([x, y, state.root_pos_W[2]])
        return cls(
            p_WP=pelvis,
            quat_WP=quat_mul(turn, state.quat_WP),
            joint_pos=held.joint_pos,
            carried=state.carried,
            p_WO=pelvis + quat_rotate(turn, state.object_pos_W - state.root_pos_W),
            quat_WO=quat_mul(turn, state.quat_WO),
        )

    def to_mujoco(self, joints: int = 20) -> tuple[Array, Array]:
        """Qpos and qvel of the model with 20 or 29 joints, and with the object where one is carried."""
        index = joint_index(joints)
        qpos, qvel = [self.p_WP, self.quat_WP, self.joint_pos[index]], [self.v_WP, self.w_WP_P, self.joint_vel[index]]
        if self.carried is not None:
            qpos += [self.p_WO, self.quat_WO]
            qvel += [self.v_WO, self.w_WO_O]
        return np.concatenate(qpos), np.concatenate(qvel)

    def to_pinocchio(self) -> tuple[Array, Array]:
        """Q (36,) and v (35,) of the 29-joint robot; with an object, whose free joint follows, (43,) and (41,)."""

        def in_body(v_W: Array, quat: Array) -> Array:
            return np.asarray(quat_rotate(quat_conj(quat), v_W), dtype=np.float64)

        q = [self.p_WP, np.roll(self.quat_WP, -1), self.joint_pos]
        v = [in_body(self.v_WP, self.quat_WP), self.w_WP_P, self.joint_vel]
        if self.carried is not None:
            q += [self.p_WO, np.roll(self.quat_WO, -1)]
            v += [in_body(self.v_WO, self.quat_WO), self.w_WO_O]
        return np.concatenate(q), np.concatenate(v)
