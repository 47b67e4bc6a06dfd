"""Scenes from what was measured or modelled elsewhere: point clouds, meshes, 3D-FRONT rooms."""
