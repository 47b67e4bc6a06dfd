"""Shapes of obstacles and robot: primitives, triangle meshes, their bounding-volume trees and extents."""
