"""Longest lengths and distances of a scene: what a file may claim without making arithmetic overflow."""

from hotice.checks import Range

MIN_LENGTH_M, MAX_LENGTH_M = 1e-6, 1e4
LENGTH = Range(least=MIN_LENGTH_M, most=MAX_LENGTH_M)
COORDINATE = Range(least=-MAX_LENGTH_M, most=MAX_LENGTH_M)

SMALL_M, MEDIUM_M, LARGE_M = (3.0, 2.0, 1.5), (4.0, 3.0, 1.5), (5.0, 5.0, 1.5)
"""Sizes of crops: the first and last are those of the paper's neighbours."""
