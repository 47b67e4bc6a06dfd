"""The things that exist: robot, carried objects and scenes. Importing this package costs nothing."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.model.carry import CarryState, solve_carry
    from hotice.model.collision import CollisionChecker
    from hotice.model.geometry.shapes import BoxShape, CylinderShape, SphereShape
    from hotice.model.object_range import ObjectRange
    from hotice.model.objects import Box, CarriedObject, Cylinder, Sphere
    from hotice.model.robot_state import RobotState
    from hotice.model.scene import Obstacle, Scene
    from hotice.model.shipped import load_scene, load_scenes, shipped_scenes
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "Box",
    "BoxShape",
    "CarriedObject",
    "CarryState",
    "CollisionChecker",
    "Cylinder",
    "CylinderShape",
    "ObjectRange",
    "Obstacle",
    "RobotState",
    "Scene",
    "Sphere",
    "SphereShape",
    "load_scene",
    "load_scenes",
    "shipped_scenes",
    "solve_carry",
]
