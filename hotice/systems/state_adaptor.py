"""From the state of either plant to the one robot state that everything else reads."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Selector, SelectorParams

from hotice.model import g1
from hotice.systems.signals import JOINT_POS, JOINT_VEL, NQ, ROBOT_STATE

Array = NDArray[np.float64]
MUJOCO_STATE = 66
"""qpos (34,) and qvel (32,) of the 20-joint model with object."""
_WRISTS = 7 + np.array([g1.ALL_JOINTS.index(j) for j in g1.WRIST_JOINTS])
_MUJOCO_PLACES = np.concatenate(
    [np.arange(7), JOINT_POS, np.arange(36, 43), NQ + np.arange(6), JOINT_VEL, NQ + np.arange(35, 41)]
)


def robot_state_of_mujoco(state: Array, wrist_pos: Array) -> Array:
    """(66,) -> (84,): qpos and qvel of the 20-joint model with object, wrists welded at `wrist_pos` (6,) [rad]."""
    out = np.zeros(ROBOT_STATE)
    out[_WRISTS] = wrist_pos
    out[_MUJOCO_PLACES] = state
    return out


class MujocoStateAdaptor(Diagram):
    """Input `full_state` (size,): of a `MujocoPlant`. Outputs `robot_state` (84,), `joint_state` (40,): q, q̇; `tick`.

    `tick` (1,): the plant's own time [s]. Made of Drake's own blocks; `robot_state` is `robot_state_of_mujoco`.
    `first`: where qpos begins in the input.
    """

    def __init__(self, size: int, first: int, wrist_pos: Array) -> None:
        Diagram.__init__(self)
        constants = np.append(wrist_pos, 0.0)
        source = np.full(ROBOT_STATE, size + 6)  # the zero after the wrist angles
        source[_WRISTS] = size + np.arange(6)
        source[_MUJOCO_PLACES] = first + np.arange(MUJOCO_STATE)
        builder = DiagramBuilder()
        selector = builder.AddNamedSystem(
            "select",
            selector_of(
                (size, 7),
                {
                    "robot_state": source,
                    "joint_state": source[np.append(JOINT_POS, JOINT_VEL)],
                    "tick": np.zeros(1, dtype=int),
                },
            ),
        )
        welded = builder.AddNamedSystem("welded", ConstantVectorSource(constants))
        builder.Connect(welded.get_output_port(), selector.get_input_port(1))
        builder.ExportInput(selector.get_input_port(0), "full_state")
        for name in ("robot_state", "joint_state", "tick"):
            builder.ExportOutput(selector.GetOutputPort(name), name)
        builder.BuildInto(self)


def selector_of(sizes: Sequence[int], outputs: dict[str, Array]) -> Selector:
    """Drake's block that picks elements: `outputs` index into the inputs of these sizes, one after the other."""
    params, starts = SelectorParams(), np.cumsum([0, *sizes])
    params.inputs = [SelectorParams.InputPortParams(name=f"in{i}", size=size) for i, size in enumerate(sizes)]
    chosen = []
    for name, index in outputs.items():
        port = np.searchsorted(starts, index, side="right") - 1
        picks = [
            SelectorParams.OutputSelection(input_port_index=int(p), input_offset=int(i - starts[p]))
            for p, i in zip(port, index, strict=True)
        ]
        chosen.append(SelectorParams.OutputPortParams(name=name, selections=picks))
    params.outputs = chosen
    return Selector(params)


class DrakeStateAdaptor(LeafSystem):
    """Input `state` (n,): [q; v] of a MultibodyPlant. Outputs `robot_state` (84,), `joint_state` (40,): q, q̇; `tick`.

    `tick` (1,): the time [s]; in Drake no plant has its own.
    `index` (66,): where in [q; v] to find quat and p of the pelvis, the 20 joints, quat and p of the object; w and v of
    the pelvis, the joint velocities, w and v of the object. `wrist_pos` (6,): angles of the welded wrists [rad].
    """

    def __init__(self, size: int, index: Array, wrist_pos: Array) -> None:
        super().__init__()
        self._convert = drake_to_robot_state(index, wrist_pos)
        self._joints = np.concatenate([index[7:27], index[40:60]]).astype(int)
        self._state = self.DeclareVectorInputPort("state", size)
        self.DeclareVectorOutputPort("robot_state", ROBOT_STATE, self._output_robot_state)
        self.DeclareVectorOutputPort("joint_state", len(self._joints), self._output_joint_state)
        self.DeclareVectorOutputPort("tick", 1, self._output_tick, {self.time_ticket()})

    def _output_robot_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._convert(self._state.Eval(context)))

    def _output_joint_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._state.Eval(context)[self._joints])

    def _output_tick(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([context.get_time()])


def drake_to_robot_state(index: Array, wrist_pos: Array) -> Callable[[Array], Array]:
    """Function (n,) -> (84,) of a MultibodyPlant's [q; v]; see `DrakeStateAdaptor`.

    Drake's free bodies have q = [quat wxyz, p_W] and v = [w_W, v_W]; here angular velocities are in the body.
    """
    places = np.asarray(index, dtype=int)

    def convert(state: Array) -> Array:
        x = state[places]
        quat_WP, p_WP, q, quat_WO, p_WO, w_WP, v_WP, qd, w_WO, v_WO = np.split(x, [4, 7, 27, 31, 34, 37, 40, 60, 63])
        quat_WP, quat_WO = _normalized(quat_WP), _normalized(quat_WO)
        parts = [p_WP, quat_WP, q, p_WO, quat_WO, v_WP, _in_body(quat_WP, w_WP), qd, v_WO, _in_body(quat_WO, w_WO)]
        return robot_state_of_mujoco(np.concatenate(parts), wrist_pos)

    return convert


def _normalized(quat: Array) -> Array:
    return quat / np.sqrt(quat @ quat)


def _in_body(quat: Array, v_W: Array) -> Array:
    w, u = quat[0], -quat[1:]
    t = 2.0 * np.cross(u, v_W)
    return v_W + w * t + np.cross(u, t)
