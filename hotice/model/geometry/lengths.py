"""Longest lengths and distances of a scene: what a file may claim without making arithmetic overflow."""

from hotice.checks import Range

MIN_LENGTH_M, MAX_LENGTH_M = 1e-6, 1e4
LENGTH = Range(least=MIN_LENGTH_M, most=MAX_LENGTH_M)
COORDINATE = Range(least=-MAX_LENGTH_M, most=MAX_LENGTH_M)
