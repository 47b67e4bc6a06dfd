"""From the state of either plant to the one robot state that everything else reads."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.primitives import Selector, SelectorParams

from hotice.model import g1
from hotice.model.robot_state import joint_index
from hotice.systems.signals import NQ, ROBOT_STATE

Array = NDArray[np.float64]
_WRISTS = 7 + np.array([g1.ALL_JOINTS.index(j) for j in g1.WRIST_JOINTS])
_ACTION = joint_index(20)


class StateAdaptor(LeafSystem):
    """Input `state` (n,): of a plant. Output `robot_state` (84,): see `signals`. `convert` maps one to the other."""

    def __init__(self, size: int, convert: Callable[[Array], Array]) -> None:
        super().__init__()
        self._convert = convert
        self._state = self.DeclareVectorInputPort("state", size)
        self.DeclareVectorOutputPort("robot_state", ROBOT_STATE, self._output)

    def _output(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._convert(self._state.Eval(context)))


def joint_state_selector(size: int, q_index: Array, v_index: Array) -> Selector:
    """Drake's own block: input `state` (size,), output `joint_state` (40,): q [rad], q̇ [rad/s] (`g1.ACTION_JOINTS`)."""
    params = SelectorParams()
    params.inputs = [SelectorParams.InputPortParams(name="state", size=size)]
    chosen = [
        SelectorParams.OutputSelection(input_port_index=0, input_offset=int(i)) for i in (*q_index, *v_index)
    ]  # fmt: skip
    params.outputs = [SelectorParams.OutputPortParams(name="joint_state", selections=chosen)]
    return Selector(params)


def mujoco_to_robot_state(wrist_pos: Array) -> Callable[[Array], Array]:
    """Function (66,) -> (84,): qpos and qvel of the 20-joint model with object, wrists welded at `wrist_pos` (6,) [rad]."""
    rest = np.zeros(ROBOT_STATE)
    rest[_WRISTS] = wrist_pos
    joints, joint_vel = 7 + _ACTION, NQ + 6 + _ACTION
    index = np.concatenate(
        [np.arange(7), joints, np.arange(36, 43), NQ + np.arange(6), joint_vel, NQ + np.arange(35, 41)]
    )

    def convert(state: Array) -> Array:
        out = rest.copy()
        out[index] = state
        return out

    return convert


def drake_to_robot_state(q_index: Array, v_index: Array, wrist_pos: Array) -> Callable[[Array], Array]:
    """Function (66,) -> (84,) of a MultibodyPlant's state of the same robot.

    Drake's free bodies have q = [quat wxyz, p_W] and v = [w_W, v_W]; here angular velocities are in the body.

    Args:
        q_index: (34,) where quat and p of the pelvis, the 20 joints, quat and p of the object are in the plant's q.
        v_index: (32,) where w and v of the pelvis, the joint velocities, w and v of the object are in [q; v].
        wrist_pos: (6,) angles of the welded wrists [rad].
    """
    to_robot_state = mujoco_to_robot_state(wrist_pos)
    index = np.concatenate([q_index, v_index]).astype(int)

    def convert(state: Array) -> Array:
        x = state[index]
        quat_WP, p_WP, q, quat_WO, p_WO = np.split(x[:34], [4, 7, 27, 31])
        w_WP, v_WP, qd, w_WO, v_WO = np.split(x[34:], [3, 6, 26, 29])
        quat_WP, quat_WO = _normalized(quat_WP), _normalized(quat_WO)
        return to_robot_state(
            np.concatenate([
                p_WP, quat_WP, q, p_WO, quat_WO, v_WP, _in_body(quat_WP, w_WP), qd, v_WO, _in_body(quat_WO, w_WO),
            ])
        )  # fmt: skip

    return convert


def _normalized(quat: Array) -> Array:
    return quat / np.sqrt(quat @ quat)


def _in_body(quat: Array, v_W: Array) -> Array:
    w, u = quat[0], -quat[1:]
    t = 2.0 * np.cross(u, v_W)
    return v_W + w * t + np.cross(u, t)
