"""Walking baseline that carries the object: footsteps along the field, DCM, step adjustment, whole-body QP."""

from typing import TYPE_CHECKING, Any

from hotice.control.walk.config import WalkConfig

if TYPE_CHECKING:
    from hotice.control.walk.controller import WalkController
    from hotice.control.walk.memory import WalkMemory
    from hotice.control.walk.plan import WalkPlan, plan_walk

_LAZY = {"WalkController": "controller", "WalkMemory": "memory", "WalkPlan": "plan", "plan_walk": "plan"}
__all__ = ["WalkConfig", "WalkController", "WalkMemory", "WalkPlan", "plan_walk"]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
