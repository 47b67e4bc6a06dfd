"""Decisions of a station, made before its diagram: configuration, table, departure, rehearsals."""
