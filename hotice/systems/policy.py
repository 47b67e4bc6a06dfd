"""The carrying policy (both agents, one ONNX file) as a Drake system."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice.fields.defaults import ETA
from hotice.model.carry import CarryState
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.policy import PolicySession, PolicyTask
from hotice.policy.action import next_action
from hotice.policy.guidance import FieldReading, read_standing
from hotice.policy.observation import Carrying, layout_of, observe, remember
from hotice.policy.percept import Percept
from hotice.policy.policy_file import check_layout
from hotice.safety import Answer, Fault
from hotice.systems.failing import CONTROLLER_ERRORS, message_of
from hotice.systems.signals import ANSWER, GUIDANCE, NUM_JOINTS, PERCEPT
from hotice.task import history

Array = NDArray[np.float64]
TARGET, MEMORY, STATE, PLACE = range(4)
"""Groups of the state: joint target (20,) [rad]; last action (20,), the target before (20,) [rad], step clock [rad],
time of the action [s] and, for a policy with a history, what was read in the steps before; the status, see
`signals`; where it was told to stand (3,) [m], NaN while it walks."""
ACTION, HELD, PHASE, SINCE, PAST = slice(0, 20), slice(20, 40), 40, 41, slice(42, None)


class PolicySystem(LeafSystem):
    """Acts every control period.

    By a periodic *unrestricted* update, which Drake runs before the discrete updates of the same instant: the plant's
    step that begins now feels the action made from the state now.

    Inputs `percept` (119,), `guidance` (122,); `active` (1,), optional: while it is 0 the policy rests, its clock
    stands and the target is the carry state's; `answer` (2,), optional: while it says so, and while guidance is not
    finite, the policy reads fields whose goal is where it is, and stands. Outputs `joint_target` (20,) [rad], absolute;
    `action` (20,), unitless; `status` (2,): see `signals`. The state holds the last action, the last two targets, the
    step clock, when the action was made and the history.

    An observation or an action that is not finite, and an exception among `CONTROLLER_ERRORS`, are faults in `status`:
    target and memory stay as they were, and `message` says what happened last.

    Args:
        policy: the file; `carry`: what it carries and how.
        latency_s: delay of the motors, from an action to its arrival there, at most the control period (the delay
            model is in `hotice.task.sensing`).
        phase_rad: step clock of the left leg at the start, 0 or pi.
        attraction: eta of the fields that `guidance` comes from [m/s], to which it also stands.

    Raises:
        CheckpointError: the policy reads another observation.
    """

    def __init__(
        self,
        policy: PolicySession,
        carry: CarryState,
        latency_s: float = 0.0,
        phase_rad: float = 0.0,
        attraction: float = ETA,
    ) -> None:
        super().__init__()
        self.policy = policy
        self.task = PolicyTask.from_meta(policy.meta, policy.name)
        check_layout(policy.name, policy.layout, layout_of(self.task))
        self._carrying, self._target = Carrying.of(carry), np.asarray(carry.joint_target, dtype=float)
        self._scale, self._latency, self._attraction = self.task.action_scale, latency_s, attraction
        self._phase_step = 2.0 * math.pi * self.task.gait_hz * self.task.control_dt_s
        past = np.zeros(self.task.history * history.FRAME)
        self._rest = (self._target, np.concatenate([np.zeros(NUM_JOINTS), self._target, [phase_rad, -1.0], past]))
        groups = [
            self.DeclareDiscreteState(rest) for rest in (*self._rest, np.array([np.nan, 0.0]), np.full(3, np.nan))
        ]
        self.DeclareAbstractState(AbstractValue.Make(""))
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._guidance = self.DeclareVectorInputPort("guidance", GUIDANCE)
        self._active = self.DeclareVectorInputPort("active", 1)
        self._answer = self.DeclareVectorInputPort("answer", ANSWER)
        if latency_s:
            reads = {self.all_state_ticket(), self.time_ticket()}
            self.DeclareVectorOutputPort("joint_target", NUM_JOINTS, self._output_target, reads)
        else:
            self.DeclareStateOutputPort("joint_target", groups[TARGET])
        remembered = {self.discrete_state_ticket(groups[MEMORY])}
        self.DeclareVectorOutputPort("action", NUM_JOINTS, self._output_action, remembered)
        self.DeclareStateOutputPort("status", groups[STATE])
        self.DeclarePeriodicUnrestrictedUpdateEvent(self.task.control_dt_s, 0.0, self._act)

    def message(self, context: Context) -> str:
        """What this system's own Context says of the last fault; empty before the first."""
        return str(context.get_abstract_state(0).get_value())

    def observation(self, context: Context) -> NDArray[np.float32]:
        """What the policy would read now; rows as in `hotice.policy.observation.layout_of`."""
        percept, reading = self._inputs(context)
        if self._has_to_stand(context, reading):
            reading = self._standing(percept, reading, context.get_discrete_state(PLACE).value())
        return self._observe(percept, reading, context.get_discrete_state(MEMORY).value())

    def _inputs(self, context: Context) -> tuple[Percept, FieldReading]:
        return Percept(self._percept.Eval(context)), FieldReading(self._guidance.Eval(context))

    def _observe(self, percept: Percept, reading: FieldReading, memory: Array) -> NDArray[np.float32]:
        clock = float(memory[PHASE])
        return observe(percept, reading, self._carrying, memory[ACTION], clock, self.task.scan, memory[PAST])

    def _standing(self, percept: Percept, reading: FieldReading, place: Array) -> FieldReading:
        place = self._here(percept) if math.isnan(place[0]) else place
        return read_standing(reading, percept, place, self.task, self._attraction)

    def _has_to_stand(self, context: Context, reading: FieldReading) -> bool:
        told = self._answer.HasValue(context) and int(self._answer.Eval(context)[0]) == Answer.STOP_WALKING
        return told or not math.isfinite(reading.vector.dot(reading.vector))

    def _here(self, percept: Percept) -> Array:
        return np.array([*percept.p_WP[:2], GOAL_HEIGHT_M])

    def _act(self, context: Context, state: State) -> None:
        if self._active.HasValue(context) and self._active.Eval(context)[0] < 0.5:
            for group, rest in enumerate(self._rest):
                state.get_mutable_discrete_state(group).SetFromVector(rest)
            return
        memory = state.get_mutable_discrete_state(MEMORY).get_mutable_value()  # still the last step's
        percept, reading = self._inputs(context)
        stands, place = self._has_to_stand(context, reading), context.get_discrete_state(PLACE).value()
        if stands == math.isnan(place[0]):
            remembered = self._here(percept) if stands else np.full(3, np.nan)
            state.get_mutable_discrete_state(PLACE).SetFromVector(remembered)
        if stands:
            reading = self._standing(percept, reading, place)
        observation = self._observe(percept, reading, memory)
        raw, fault = None, Fault.NONE
        if not math.isfinite(observation.dot(observation)):
            fault = self._fails(state, Fault.OBSERVATION_INVALID, "the observation is not finite")
        else:
            try:
                raw = self.policy.run(observation[None])[0].astype(float)
            except CONTROLLER_ERRORS as error:
                fault = self._fails(state, Fault.CONTROLLER_ERROR, message_of(error))
        if raw is not None and not math.isfinite(raw.dot(raw)):
            fault = self._fails(state, Fault.ACTION_INVALID, "the action is not finite")
        state.get_mutable_discrete_state(STATE).SetFromVector([context.get_time(), float(fault)])
        if raw is None or fault:
            return
        target = state.get_mutable_discrete_state(TARGET).get_mutable_value()
        action = next_action(raw, self.task.action_limit)
        memory[ACTION], memory[HELD], memory[PAST] = action, target, remember(memory[PAST], observation)
        memory[PHASE] = (memory[PHASE] + self._phase_step) % (2.0 * math.pi)
        memory[SINCE] = context.get_time()
        np.multiply(self._scale, action, out=target)
        target += self._target

    def _fails(self, state: State, fault: Fault, message: str) -> Fault:
        state.get_mutable_abstract_state(0).set_value(message)
        return fault

    def _output_target(self, context: Context, output: BasicVector) -> None:
        memory = context.get_discrete_state(MEMORY).value()
        early = context.get_time() < memory[SINCE] + self._latency - 1e-9
        output.SetFromVector(memory[HELD] if early else context.get_discrete_state(TARGET).value())

    def _output_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(MEMORY).value()[ACTION])
