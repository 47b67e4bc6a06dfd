"""Refusal of scenes in which something moves, by whoever knows only what stands still."""

from __future__ import annotations

from hotice.errors import InvalidScene
from hotice.model.scene import Scene


def only_still(scene: Scene, who: str) -> Scene:
    """The scene. Raises `InvalidScene` where something in it moves, which `who`, a noun, does not know."""
    if scene.moving:
        raise InvalidScene(
            f"scene {scene.name!r}: obstacle {scene.moving[0].name!r} moves, which {who} does not know yet: take a "
            "scene without motions, or save one moment of it, Scene.at"
        )
    return scene
