"""Geodesic distance around obstacles: second-order fast marching, exact where a straight or bent string is known."""
