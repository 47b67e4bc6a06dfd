"""Scenes made by rule: graded families, furnished rooms, and the check that a robot with its load gets through."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

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
else:
    __getattr__, __dir__ = lazy_face(__name__)

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
