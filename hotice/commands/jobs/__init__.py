"""Whole jobs on the command line."""
