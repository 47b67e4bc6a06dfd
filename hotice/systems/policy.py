"""The carrying policy (both agents, one ONNX file) as a Drake system."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice.model.carry import CarryState
from hotice.policies import PolicySession, PolicyTask
from hotice.policies.guidance import FieldReading
from hotice.policies.observation import LAYOUT, Carrying, observe
from hotice.policies.percept import Percept
from hotice.policies.policy_file import check_layout
from hotice.systems.signals import GUIDANCE, NUM_JOINTS, PERCEPT

Array = NDArray[np.float64]
_ACTION, _TARGET, _HELD, _PHASE, _SINCE = (*(slice(n, n + 20) for n in (0, 20, 40)), 60, 61)
_STATE_SIZE = 62


class PolicySystem(LeafSystem):
    """Acts every control period by a periodic *unrestricted* update, which Drake runs before the discrete updates of the
    same instant: the plant's step that begins now feels the action made from the state now.

    Inputs `percept` (119,), `guidance` (82,); `active` (1,), optional: while it is 0 the policy rests, its clock stands and
    the target is the carry state's. Outputs `joint_target` (20,) [rad], absolute; `action` (20,), unitless.
    The state holds the last action, the last two targets, the step clock and when the action was made.

    Args:
        policy: the file; `carry`: what it carries and how.
        latency_s: time from an action to its arrival at the motors, at most the control period.
        phase_rad: step clock of the left leg at the start, 0 or pi.

    Raises:
        CheckpointError: the policy reads another observation.
    """

    def __init__(
        self, policy: PolicySession, carry: CarryState, latency_s: float = 0.0, phase_rad: float = 0.0
    ) -> None:
        super().__init__()
        check_layout(policy.name, policy.layout, LAYOUT)
        self.policy = policy
        self.task = PolicyTask.from_meta(policy.meta, policy.name)
        self._carrying, self._target = Carrying.of(carry), np.asarray(carry.joint_target, dtype=float)
        self._scale, self._latency = self.task.action_scale, latency_s
        self._phase0 = phase_rad
        index = self.DeclareDiscreteState(self._rest())
        reads = {self.discrete_state_ticket(index)} | ({self.time_ticket()} if latency_s else set())
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._guidance = self.DeclareVectorInputPort("guidance", GUIDANCE)
        self._active = self.DeclareVectorInputPort("active", 1)
        self.DeclareVectorOutputPort("joint_target", NUM_JOINTS, self._output_target, reads)
        self.DeclareVectorOutputPort("action", NUM_JOINTS, self._output_action, {self.discrete_state_ticket(index)})
        self.DeclarePeriodicUnrestrictedUpdateEvent(self.task.control_dt_s, 0.0, self._act)

    def observation(self, context: Context) -> NDArray[np.float32]:
        """What the policy would read now, (241,); rows as in `hotice.policies.observation.LAYOUT`."""
        percept = Percept(self._percept.Eval(context))
        reading = FieldReading(self._guidance.Eval(context))
        held = context.get_discrete_state_vector().value()
        return observe(percept, reading, self._carrying, held[_ACTION], float(held[_PHASE]))

    def _rest(self) -> Array:
        rest = np.zeros(_STATE_SIZE)
        rest[_TARGET] = rest[_HELD] = self._target
        rest[_PHASE], rest[_SINCE] = self._phase0, -1.0
        return rest

    def _act(self, context: Context, state: State) -> None:
        new = state.get_mutable_discrete_state(0)
        if self._active.HasValue(context) and self._active.Eval(context)[0] < 0.5:
            new.SetFromVector(self._rest())
            return
        held = context.get_discrete_state_vector().value()
        raw = self.policy.run(self.observation(context)[None])[0].astype(float)
        action = next_action(raw, self.task.action_limit)
        step = 2.0 * math.pi * self.task.gait_hz * self.task.control_dt_s
        target = self._target + self._scale * action
        clock = ((held[_PHASE] + step) % (2.0 * math.pi), context.get_time())
        new.SetFromVector(np.concatenate([action, target, held[_TARGET], clock]))

    def _output_target(self, context: Context, output: BasicVector) -> None:
        held = context.get_discrete_state_vector().value()
        early = self._latency and context.get_time() < held[_SINCE] + self._latency - 1e-9
        output.SetFromVector(held[_HELD] if early else held[_TARGET])

    def _output_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state_vector().value()[_ACTION])


def next_action(raw: Array, limit: float) -> Array:
    """What the environment makes of a network's output (20,): finite, within ± `limit`."""
    return np.clip(np.nan_to_num(raw, nan=0.0, posinf=limit, neginf=-limit), -limit, limit)
