"""Who commands: the pick-up until the object is held, then the carrying controller, without a jump in torque."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from hotice.errors import InvalidConfig
from hotice.systems.signals import CONTACT_FORCE, NUM_JOINTS

Array = NDArray[np.float64]
PICKUP, CARRY = 0.0, 1.0
NEVER = -1.0


@dataclass(frozen=True, kw_only=True)
class HandOver:
    """When and how the command changes hands."""

    ready_phase: int
    """Index of the pick-up's phase in which the object is held and the robot stands still."""
    settle_s: float = 0.5
    """How long it must have been ready, and both hands must have felt the object."""
    hold_n: float = 8.0
    """Force from which a hand feels it."""
    blend_s: float = 0.4
    """In which the torques go over from one to the other."""

    def __post_init__(self) -> None:
        for name in ("settle_s", "hold_n", "blend_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise InvalidConfig(f"{name} is {value!r}: a finite number of at least 0 is needed")


def blend(pickup: Array, carry: Array, share: float) -> Array:
    """Torques (20,) on the way from the pick-up's (share 0) to the carrying controller's (share 1)."""
    return pickup + min(max(share, 0.0), 1.0) * (carry - pickup)


class ModeSelector(LeafSystem):
    """Inputs `pickup_torque` and `carry_torque` (20,) [N m], `phase` (1,) of the pick-up, `contact_force` (12,).

    Outputs `torque` (20,) [N m]; `mode` (1,): 0 pick-up, 1 carry; `carry_active` (1,): the same, for the policy, which rests
    until then. The mode never goes back. Checked every `period_s`.
    """

    def __init__(self, rule: HandOver, period_s: float) -> None:
        super().__init__()
        self.rule = rule
        modes = self.DeclareDiscreteState([PICKUP])
        self.DeclareDiscreteState([NEVER, NEVER])  # time of the hand-over, and since when the pick-up is ready [s]
        self._pickup = self.DeclareVectorInputPort("pickup_torque", NUM_JOINTS)
        self._carry = self.DeclareVectorInputPort("carry_torque", NUM_JOINTS)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self._force = self.DeclareVectorInputPort("contact_force", CONTACT_FORCE)
        self.DeclareVectorOutputPort("torque", NUM_JOINTS, self._output)
        self.DeclareStateOutputPort("mode", modes)
        self.DeclareStateOutputPort("carry_active", modes)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period_s, 0.0, self._decide)

    def _decide(self, context: Context, state: State) -> None:
        if context.get_discrete_state(0).value()[0] == CARRY:
            return
        handed, since = context.get_discrete_state(1).value().copy()
        hands = np.linalg.norm(self._force.Eval(context).reshape(4, 3)[2:], axis=1)
        held = hands.min() >= self.rule.hold_n
        if self._phase.Eval(context)[0] != self.rule.ready_phase or not held:
            since = NEVER
        elif since == NEVER:
            since = context.get_time()
        if since != NEVER and context.get_time() - since >= self.rule.settle_s - 1e-9:
            handed = context.get_time()
            state.get_mutable_discrete_state(0).SetFromVector([CARRY])
        state.get_mutable_discrete_state(1).SetFromVector([handed, since])

    def _output(self, context: Context, output: BasicVector) -> None:
        if context.get_discrete_state(0).value()[0] == PICKUP:
            output.SetFromVector(self._pickup.Eval(context))
            return
        handed = context.get_discrete_state(1).value()[0]
        share = (context.get_time() - handed) / max(self.rule.blend_s, 1e-9)
        carry = self._carry.Eval(context)
        output.SetFromVector(carry if share >= 1.0 else blend(self._pickup.Eval(context), carry, share))
