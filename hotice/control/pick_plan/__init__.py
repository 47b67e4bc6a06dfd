"""Plan of a pick-up: keyframes by Drake's inverse kinematics, paths between them by IPOPT, both cached on disk.

Importing this package costs numpy and numba only.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.pick_plan.grip import Grip, ready_joints
    from hotice.control.pick_plan.plan import Durations, PickPlan, Support
    from hotice.control.pick_plan.planner import Planner
    from hotice.control.pick_plan.task import frames_at
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Durations", "Grip", "PickPlan", "Planner", "Support", "frames_at", "ready_joints"]
