"""Any controller of `hotice.control` as a Drake system."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem, State

from hotice import checks
from hotice.control import Command, Controller, Measurement
from hotice.errors import InvalidStation
from hotice.model import g1
from hotice.model.frames import rotation_z
from hotice.safety import Answer, Fault, MeasurementLimits
from hotice.systems.failing import CONTROLLER_ERRORS, message_of
from hotice.systems.signals import (
    ANSWER,
    CONTACT_FORCE,
    JOINT_POS,
    JOINT_VEL,
    NQ,
    OBJECT_POS,
    OBJECT_QUAT,
    OBJECT_RATE,
    OBJECT_VEL,
    ROBOT_STATE,
    ROOT_RATE,
    ROOT_VEL,
)

Array = NDArray[np.float64]
UNKNOWN_PHASE = -1.0
POSSIBLE = MeasurementLimits.possible_speed_rad_s
"""Largest velocity of anything that a controller reads [m/s, rad/s]; beyond it, or NaN, the measurement is wrong."""
TORQUE, PHASE, FAULTS, STATE = range(4)


def measurement_of(
    time_s: float,
    state: Array,
    contact_force: Array,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    stand: bool = False,
) -> Measurement:
    """Measurement that a controller reads.

    Args:
        time_s: now. state: (84,) robot state; contact_force: (12,), see `signals`.
        origin: x, y [m], yaw [rad] of the frame on the floor in which the controller works.
        stand: whether it is told to come to a stand.
    """
    x, y, yaw = origin
    R_GW = rotation_z(-yaw)
    p_WG, half = np.array([x, y, 0.0]), -0.5 * yaw
    turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])

    def quat(q: Array) -> Array:
        w, i, j, k = q
        return np.array(
            [turn[0] * w - turn[3] * k, turn[0] * i - turn[3] * j, turn[0] * j + turn[3] * i, turn[0] * k + turn[3] * w]
        )

    force = contact_force.reshape(4, 3) @ R_GW.T
    return Measurement(
        time_s=time_s,
        joint_pos=state[JOINT_POS],
        joint_vel=state[JOINT_VEL],
        p_WP=R_GW @ (state[g1.ROOT_POS] - p_WG),
        quat_WP=quat(state[g1.ROOT_QUAT]),
        v_WP=R_GW @ state[ROOT_VEL],
        w_WP_P=state[ROOT_RATE].copy(),
        p_WO=R_GW @ (state[OBJECT_POS] - p_WG),
        quat_WO=quat(state[OBJECT_QUAT]),
        v_WO=R_GW @ state[OBJECT_VEL],
        w_WO_O=state[OBJECT_RATE].copy(),
        foot_force_W=force[:2],
        hand_force_W=force[2:],
        stand=stand,
    )


class _Held:
    """A controller's memory. Controllers never change the memory they are given, so copies of a Context share it."""

    __slots__ = ("memory",)

    def __init__(self, memory: Any) -> None:
        self.memory = memory

    def __deepcopy__(self, _: Any) -> _Held:
        return _Held(self.memory)


class ControllerSystem(LeafSystem):
    """Steps the controller by a periodic unrestricted update at its own rate; its memory is abstract state.

    Inputs `robot_state` (84,), `contact_force` (12,); `active` (1,), optional: while it is 0 the controller rests;
    `answer` (2,), optional: see `signals`; the controller is told to stand while it says so.
    Outputs `torque` (20,) [N m], held between steps; `phase` (1,): index into `phases`, -1 for another; `faults` (1,):
    steps that were answered with a fallback; `status` (2,): see `signals`.

    A velocity that cannot be, a step that was answered with a fallback, and an exception among `CONTROLLER_ERRORS` are
    a fault in `status`; but for the fallback, torque and memory stay as they were, and the next step tries again.
    `message` says what happened last.

    Args:
        controller: started at the first step.
        phases: names that the controller gives its phases, for `phase`.
        torque: (20,) [N m] before the first step.
        origin: x, y [m], yaw [rad] of the frame in which the controller works, in W.
    """

    def __init__(
        self,
        controller: Controller,
        phases: Sequence[str],
        torque: Array,
        origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        super().__init__()
        rate = checks.number("the controller's rate_hz", controller.rate_hz, checks.POSITIVE, InvalidStation)
        self.controller, self.phases, self.origin = controller, tuple(phases), origin
        rest = (np.asarray(torque, float), [UNKNOWN_PHASE], np.zeros(1), [np.nan, 0.0])
        groups = [self.DeclareDiscreteState(value) for value in rest]
        self.DeclareAbstractState(AbstractValue.Make(_Held(None)))
        self.DeclareAbstractState(AbstractValue.Make(""))
        self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self._force = self.DeclareVectorInputPort("contact_force", CONTACT_FORCE)
        self._active = self.DeclareVectorInputPort("active", 1)
        self._answer = self.DeclareVectorInputPort("answer", ANSWER)
        for name, group in zip(("torque", "phase", "faults", "status"), groups, strict=True):
            self.DeclareStateOutputPort(name, group)
        self.DeclarePeriodicUnrestrictedUpdateEvent(1.0 / rate, 0.0, self._act)

    def memory(self, context: Context) -> Any:
        """The controller's memory in this system's own Context; None before the first step."""
        return context.get_abstract_state(0).get_value().memory

    def message(self, context: Context) -> str:
        """What this system's own Context says of the last fault; empty before the first."""
        return str(context.get_abstract_state(1).get_value())

    def _act(self, context: Context, state: State) -> None:
        if self._active.HasValue(context) and self._active.Eval(context)[0] < 0.5:
            return
        status = state.get_mutable_discrete_state(STATE)
        fastest = np.abs(self._state.Eval(context)[NQ:]).max()
        # not a number is beyond every limit, and would stay in the controller's memory
        if not fastest <= POSSIBLE:
            text = f"a velocity of {fastest:g} m/s or rad/s is impossible: no step was made"
            state.get_mutable_abstract_state(1).set_value(text)
            status.SetFromVector([context.get_time(), float(Fault.STATE_IMPOSSIBLE)])
            return
        stand = self._answer.HasValue(context) and int(self._answer.Eval(context)[0]) == Answer.STOP_WALKING
        measurement = measurement_of(
            context.get_time(), self._state.Eval(context), self._force.Eval(context), self.origin, stand
        )
        try:
            memory = self.memory(context)
            if memory is None:
                memory = self.controller.start(measurement)
            command: Command
            command, memory = self.controller.step(memory, measurement)
        except CONTROLLER_ERRORS as error:
            state.get_mutable_abstract_state(1).set_value(message_of(error))
            status.SetFromVector([context.get_time(), float(Fault.CONTROLLER_ERROR)])
            return
        gave_up = command.faults > context.get_discrete_state(FAULTS).value()[0]
        if gave_up:
            text = f"{command.faults} steps were answered with a fallback"
            state.get_mutable_abstract_state(1).set_value(text)
        status.SetFromVector([context.get_time(), float(Fault.CONTROLLER_ERROR if gave_up else 0)])
        phase = self.phases.index(command.phase) if command.phase in self.phases else UNKNOWN_PHASE
        state.get_mutable_abstract_state(0).set_value(_Held(memory))
        state.get_mutable_discrete_state(TORQUE).SetFromVector(command.torque)
        state.get_mutable_discrete_state(PHASE).SetFromVector([float(phase)])
        state.get_mutable_discrete_state(FAULTS).SetFromVector([float(command.faults)])
