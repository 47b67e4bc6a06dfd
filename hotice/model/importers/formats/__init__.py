"""Readers of point clouds, octrees and meshes: PCD, PLY, BT, OBJ, OFF, STL and GLB, hardened against broken files."""
