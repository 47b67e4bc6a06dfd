"""Scenes made by rule: graded families, furnished rooms, and the check that a robot with its load gets through."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hotice.model.generate.families import (
        FAMILIES,
        Generated,
        Rejected,
        family_from_text,
        family_scenes,
        generate,
        generate_from_text,
    )
    from hotice.model.generate.traversable import Traversal, check_traversable, require_traversable

_FAMILIES = (
    "FAMILIES",
    "Generated",
    "Rejected",
    "family_from_text",
    "family_scenes",
    "generate",
    "generate_from_text",
)
_LAZY = {
    **dict.fromkeys(_FAMILIES, "families"),
    **dict.fromkeys(("Traversal", "check_traversable", "require_traversable"), "traversable"),
}

__all__ = [
    "FAMILIES",
    "Generated",
    "Rejected",
    "Traversal",
    "check_traversable",
    "family_from_text",
    "family_scenes",
    "generate",
    "generate_from_text",
    "require_traversable",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
