"""Readers of point clouds and meshes: PCD, PLY, OBJ, OFF, STL and GLB, hardened against broken files."""
