"""A fingerprint of what is in a scene, by which it is known again."""

from __future__ import annotations

import hashlib
import json

from hotice.model.geometry.shapes import MeshShape
from hotice.model.scene import Scene


def scene_digest(scene: Scene) -> str:
    """SHA-256 of a scene and of the mesh files it names."""
    digest = hashlib.sha256(json.dumps(scene.to_dict(), sort_keys=True).encode())
    for obstacle in scene.obstacles:
        if isinstance(obstacle.shape, MeshShape):
            digest.update(obstacle.shape.path.read_bytes())
    return digest.hexdigest()
