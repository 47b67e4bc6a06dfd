"""Source of the command: the pick-up until the object is held, then the policy or, if that is unfit, the walk.

Where neither is, the pick-up goes on holding the object. In a whole job whoever carries gives back to a put-down.
"""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice import checks
from hotice.systems.failing import CONTROLLER_ERRORS, message_of
from hotice.systems.hand_over.sound import sound
from hotice.systems.hand_over.stage import VERDICTS
from hotice.systems.signals import ANSWER, CONTACT_FORCE, NUM_JOINTS, ROBOT_STATE, STATUS

Array = NDArray[np.float64]
MODES = ("pickup", "policy", "walk", "hold", "putdown")
PICKUP, CARRY, WALK, HOLD, PUTDOWN = 0.0, 1.0, 2.0, 3.0, 4.0
NEVER = UNTRIED = -1.0
_GAVE_UP = VERDICTS.index("gave_up")


@dataclass(frozen=True, kw_only=True)
class HandOver:
    """Conditions and duration of the hand-over of the command."""

    ready_phase: int
    """Index of the pick-up's phase in which the object is held and the robot stands still."""
    settle_s: float = 0.5
    """Time for which it must have been ready, and both hands must have felt the object."""
    hold_n: float = 8.0
    """Force from which a hand feels it."""
    blend_s: float = 0.2
    """Time in which the torques go over from one to the other."""
    back_s: float = 0.04
    """Time in which they go over to a put-down, from those of the moment in which it begins."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.NOT_NEGATIVE, "settle_s", "hold_n", "blend_s", "back_s")


def blend(pickup: Array, carry: Array, share: float) -> Array:
    """Torques (20,) on the way from the pick-up's (share 0) to the carrying controller's (share 1)."""
    return pickup + min(max(share, 0.0), 1.0) * (carry - pickup)


class ModeSelector(LeafSystem):
    """Inputs `pickup_torque`, `carry_torque` (20,) [N m], `phase` (1,) of the pick-up, `contact_force` (12,).

    With `rehearse` also `walk_torque` (20,) and `robot_state` (84,): the policy takes over only where its rehearsal
    from the present state ends with verdict 0; else the walking baseline does, if `rehearse_walk` ends so (None: in any
    case); else mode `hold` is left to the pick-up for good.

    `pickup_status`, `carry_status`, `walk_status` (2,), optional, see `signals`: `status` is that of who commands.
    `answer` (2,), optional, see `signals`: while there is a fault, and while the state is impossible, nothing is handed
    over; the pick-up holds, and is ready anew once all is well again. An exception among `CONTROLLER_ERRORS` in a
    rehearsal is a verdict, and `message` says what it was.

    With `arrived` also `putdown_torque` (20,), `putdown_status` (2,) and `robot_state`: whoever carries gives back as
    soon as `arrived` says so of a robot state (84,) and contact forces (12,), both hands feel the object and there is
    no fault.

    Outputs `torque` (20,) [N m]; `status` (2,); `mode` (1,): index into `MODES`; `carry_active`, `walk_active`,
    `putdown_active` (1,): 1 while policy, baseline or put-down commands, which rest until then; `verdict`,
    `walk_verdict` (1,): of the rehearsals, -1 before them; of a job `pickup_active` (1,): 0 when it is over;
    `fallbacks` (1,): hand-overs that went to the baseline. The mode never goes back. Checked every `period_s`.
    """

    def __init__(
        self,
        rule: HandOver,
        period_s: float,
        rehearse: Callable[[Array], int] | None = None,
        rehearse_walk: Callable[[Array], int] | None = None,
        arrived: Callable[[Array, Array], bool] | None = None,
    ) -> None:
        super().__init__()
        self._arrived = arrived
        self.rule, self._rehearse, self._rehearse_walk = rule, rehearse, rehearse_walk
        self._mode = self.DeclareDiscreteState([PICKUP])
        self._times = self.DeclareDiscreteState([NEVER, NEVER])  # of the hand-over; since when the pick-up is ready [s]
        self._verdict = self.DeclareDiscreteState([UNTRIED])
        self._walk_verdict = self.DeclareDiscreteState([UNTRIED])
        self._pickup = self.DeclareVectorInputPort("pickup_torque", NUM_JOINTS)
        self._carry = self.DeclareVectorInputPort("carry_torque", NUM_JOINTS)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._force = self.DeclareVectorInputPort("contact_force", CONTACT_FORCE)
        if rehearse is not None:
            self._walk = self.DeclareVectorInputPort("walk_torque", NUM_JOINTS)
        if arrived is not None:
            self._putdown = self.DeclareVectorInputPort("putdown_torque", NUM_JOINTS)
            self._left = self.DeclareDiscreteState(NUM_JOINTS)  # torques when the put-down began
        if rehearse is not None or arrived is not None:
            self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self._answer = self.DeclareVectorInputPort("answer", ANSWER)
        self.DeclareAbstractState(AbstractValue.Make(""))
        self._statuses = [self.DeclareVectorInputPort(f"{name}_status", STATUS) for name in ("pickup", "carry", "walk")]
        if arrived is not None:
            self._statuses += [self._statuses[0], self.DeclareVectorInputPort("putdown_status", STATUS)]
        self.DeclareVectorOutputPort("torque", NUM_JOINTS, self._output)
        self.DeclareVectorOutputPort("status", STATUS, self._output_status)
        self.DeclareStateOutputPort("mode", self._mode)
        self.DeclareStateOutputPort("verdict", self._verdict)
        self.DeclareStateOutputPort("walk_verdict", self._walk_verdict)
        reads = {self.discrete_state_ticket(self._mode)}
        putdown = (("putdown_active", PUTDOWN),) if arrived is not None else ()
        for name, mode in (("carry_active", CARRY), ("walk_active", WALK), ("fallbacks", WALK), *putdown):
            self.DeclareVectorOutputPort(name, 1, self._is(mode), reads)
        if arrived is not None:
            self.DeclareVectorOutputPort("pickup_active", 1, self._is(PUTDOWN, other=True), reads)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period_s, 0.0, self._decide)

    def message(self, context: Context) -> str:
        """What this system's own Context says of the last rehearsal that gave up; empty without one."""
        return str(context.get_abstract_state(0).get_value())

    def _is(self, mode: float, other: bool = False) -> Callable[[Context, BasicVector], None]:
        """Writer of whether the mode is this one or, with `other`, another."""

        def output(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector([float((context.get_discrete_state(self._mode).value()[0] == mode) != other)])

        return output

    def _decide(self, context: Context, state: State) -> None:
        mode = context.get_discrete_state(self._mode).value()[0]
        if mode in (CARRY, WALK) and self._arrived is not None:
            self._give_back(context, state)
        if mode != PICKUP:
            return
        handed, since = context.get_discrete_state(self._times).value().copy()
        hands = np.linalg.norm(self._force.Eval(context).reshape(4, 3)[2:], axis=1)
        held = hands.min() >= self.rule.hold_n
        if self._phase.Eval(context)[0] != self.rule.ready_phase or not held or not self._sure(context):
            since = NEVER
        elif since == NEVER:
            since = context.get_time()
        if since != NEVER and context.get_time() - since >= self.rule.settle_s - 1e-9:
            handed = context.get_time()
            state.get_mutable_discrete_state(self._mode).SetFromVector([self._choose(context, state)])
        state.get_mutable_discrete_state(self._times).SetFromVector([handed, since])

    def _give_back(self, context: Context, state: State) -> None:
        """To the put-down, from where the robot is."""
        force = self._force.Eval(context)
        held = np.linalg.norm(force.reshape(4, 3)[2:], axis=1).min() >= self.rule.hold_n
        told = self._answer.HasValue(context) and self._answer.Eval(context).any()
        if self._arrived is None or told or not held or not self._arrived(self._state.Eval(context), force):
            return
        since = context.get_discrete_state(self._times).value()[1]
        state.get_mutable_discrete_state(self._left).SetFromVector(self._torque(context))
        state.get_mutable_discrete_state(self._mode).SetFromVector([PUTDOWN])
        state.get_mutable_discrete_state(self._times).SetFromVector([context.get_time(), since])

    def _sure(self, context: Context) -> bool:
        if self._answer.HasValue(context) and self._answer.Eval(context).any():
            return False
        return self._rehearse is None or sound(self._state.Eval(context))

    def _choose(self, context: Context, state: State) -> float:
        """The mode from now on; writes the verdicts."""
        verdict = 0 if self._rehearse is None else self._tried(self._rehearse, context, state)
        state.get_mutable_discrete_state(self._verdict).SetFromVector([float(verdict)])
        if not verdict:
            return CARRY
        if self._rehearse_walk is None:
            return WALK
        verdict = self._tried(self._rehearse_walk, context, state)
        state.get_mutable_discrete_state(self._walk_verdict).SetFromVector([float(verdict)])
        return HOLD if verdict else WALK

    def _tried(self, rehearse: Callable[[Array], int], context: Context, state: State) -> int:
        try:
            return rehearse(self._state.Eval(context))
        except CONTROLLER_ERRORS as error:
            state.get_mutable_abstract_state(0).set_value(message_of(error))
            return _GAVE_UP

    def _output_status(self, context: Context, output: BasicVector) -> None:
        mode = context.get_discrete_state(self._mode).value()[0]
        port = self._statuses[0 if mode == HOLD else int(mode)]
        output.SetFromVector(port.Eval(context) if port.HasValue(context) else [np.nan, 0.0])

    def _output(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._torque(context))

    def _torque(self, context: Context) -> Array:
        """Torques (20,) of who commands, or on the way there."""
        mode = context.get_discrete_state(self._mode).value()[0]
        if mode in (PICKUP, HOLD):
            return np.asarray(self._pickup.Eval(context))
        handed = context.get_discrete_state(self._times).value()[0]
        if mode == PUTDOWN:
            share = (context.get_time() - handed) / max(self.rule.back_s, 1e-9)
            return blend(context.get_discrete_state(self._left).value(), self._putdown.Eval(context), share)
        share = (context.get_time() - handed) / max(self.rule.blend_s, 1e-9)
        new = (self._walk if mode == WALK else self._carry).Eval(context)
        return np.asarray(new) if share >= 1.0 else blend(self._pickup.Eval(context), new, share)
