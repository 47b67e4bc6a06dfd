"""Scenes by what a user writes: shipped names, files, folders and generated families."""

from __future__ import annotations

from collections.abc import Sequence

from hotice.model.scene import Scene, load_scenes

FAMILY_PREFIX = "family:"


def resolve_scenes(items: Sequence[str]) -> list[Scene]:
    """Scenes of names, files, folders, or `family:NAME:COUNT[:SEED]`. Raises `InvalidScene` or `UnknownName`."""
    return [scene for item in items for scene in resolve_item(item)]


def resolve_item(item: str) -> list[Scene]:
    """Scenes of one name, file, folder or family. Raises as `resolve_scenes`."""
    if not str(item).startswith(FAMILY_PREFIX):
        return load_scenes([item])
    from hotice.model.generate.families import family_from_text

    return family_from_text(str(item).removeprefix(FAMILY_PREFIX))
