"""Shapes of obstacles and robot: primitives, triangle meshes, their bounding-volume trees and extents."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.model.geometry.meshes import TriangleMesh, load_mesh
    from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, Shape, SphereShape
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "BoxShape",
    "CapsuleShape",
    "CylinderShape",
    "MeshShape",
    "Shape",
    "SphereShape",
    "TriangleMesh",
    "load_mesh",
]
