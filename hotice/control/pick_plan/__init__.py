"""Plan of a pick-up: keyframes by Drake's inverse kinematics, paths between them by IPOPT, both cached on disk.

Importing this package costs numpy and numba only.
"""

from hotice.control.pick_plan.grip import ready_joints
from hotice.control.pick_plan.plan import Durations, PickPlan, Support
from hotice.control.pick_plan.planner import Planner

__all__ = ["Durations", "PickPlan", "Planner", "Support", "ready_joints"]
