"""What exists: the robot, carried objects and scenes. Importing this package costs numpy only."""

from hotice.model.objects import Box, CarriedObject, Cylinder, Sphere, object_from_dict
from hotice.model.scene import Obstacle, Scene
from hotice.model.shipped import load_scene, load_scenes, shipped_scenes

__all__ = [
    "Box",
    "CarriedObject",
    "Cylinder",
    "Obstacle",
    "Scene",
    "Sphere",
    "load_scene",
    "load_scenes",
    "object_from_dict",
    "shipped_scenes",
]
