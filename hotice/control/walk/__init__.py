"""Walking baseline that carries the object: footsteps along the field, DCM, step adjustment, whole-body QP."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.walk.config import WalkConfig
    from hotice.control.walk.controller import WalkController
    from hotice.control.walk.memory import WalkMemory
    from hotice.control.walk.plan import WalkPlan, plan_walk
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["WalkConfig", "WalkController", "WalkMemory", "WalkPlan", "plan_walk"]
