"""Scenes from what was measured or modelled elsewhere: point clouds, meshes, 3D-FRONT rooms."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.model.importers.front3d import House, load_house
    from hotice.model.importers.house_scenes import Front3dScenes, crop_house, front3d_scenes
    from hotice.model.importers.options import ImportOptions
    from hotice.model.importers.scene_import import Imported, from_points, from_triangles, import_scene
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "Front3dScenes",
    "House",
    "ImportOptions",
    "Imported",
    "crop_house",
    "from_points",
    "from_triangles",
    "front3d_scenes",
    "import_scene",
    "load_house",
]
