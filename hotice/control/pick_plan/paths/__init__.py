"""Paths between keyframes, as nonlinear programs."""
