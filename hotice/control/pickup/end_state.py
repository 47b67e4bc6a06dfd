"""End of a pick-up: the carry state in which it leaves robot and object and a carrying controller takes over."""

from __future__ import annotations

import numpy as np

from hotice.control.pick_plan.task import frames_at
from hotice.control.pickup.controller import Pickup
from hotice.model import g1
from hotice.model.carry import CarryState, carry_state_at


def carry_at_end(pickup: Pickup) -> CarryState:
    """The carry state at the end of the planned pick-up: its grasp, its locked wrists, its squeeze.

    It is not that of `solve_carry`: the palms hold above the object's centre, boxes at the front of the palms, and the
    wrists are locked as the grasp needs them. A policy reads this state as its own and offsets its targets from the
    ones that hold it.
    """
    plan, planner = pickup.expected, pickup.planner
    end = plan.retreat[-1]
    lean = 2.0 * float(np.arcsin(np.clip(end[4], -1.0, 1.0)))
    object_pos = frames_at(planner.terms, end).p.mean(axis=0) - plan.p_OH.mean(axis=0)  # the object is level, heading x
    return carry_state_at(
        pickup.carried,
        end[g1.JOINT_POS],
        planner.wrist_pos,
        object_pos - end[g1.ROOT_POS],
        lean_rad=lean,
        squeeze_n=pickup.squeeze_n,
    )
