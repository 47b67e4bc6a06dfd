"""Scenes by what a user writes: shipped names, files, folders and generated families."""

from __future__ import annotations

from collections.abc import Sequence

from hotice.model.scene import Scene, load_scenes

FAMILY_PREFIX = "family:"


def resolve_scenes(items: Sequence[str]) -> list[Scene]:
    """Scenes of names, files, folders, or `family:NAME:COUNT[:SEED]`. Raises `InvalidScene` or `UnknownName`."""
    scenes: list[Scene] = []
    for item in items:
        if str(item).startswith(FAMILY_PREFIX):
            from hotice.model.generate.families import family_from_text

            scenes += family_from_text(str(item).removeprefix(FAMILY_PREFIX))
        else:
            scenes += load_scenes([item])
    return scenes
