"""Scenes made by rule: graded families, and the check that a robot with its load gets through."""

from typing import TYPE_CHECKING, Any

from hotice.model.generate.families import FAMILIES, family_from_text, family_scenes

if TYPE_CHECKING:
    from hotice.model.generate.traversable import Traversal, check_traversable, require_traversable

_LAZY = {name: "traversable" for name in ("Traversal", "check_traversable", "require_traversable")}

__all__ = [
    "FAMILIES", "Traversal", "check_traversable", "family_from_text", "family_scenes", "require_traversable",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
