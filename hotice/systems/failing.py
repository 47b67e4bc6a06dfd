"""Exceptions of controllers that become faults, and their messages."""

from __future__ import annotations

from hotice.errors import HoticeError

CONTROLLER_ERRORS = (HoticeError, ArithmeticError, ValueError, LookupError, RuntimeError)
"""What a controller raises when it cannot answer: errors of hotice, numbers and matrices that cannot be (LinAlgError is
a ValueError), tables without an entry, solvers and libraries that give up (RuntimeError). Others, as TypeError and
AttributeError, are defects of a program: they end the simulation with their traceback."""


def message_of(error: Exception) -> str:
    """An exception on one line, with its kind; letters that no text file holds, as of odd file names, are escaped."""
    line = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return line.encode(errors="backslashreplace").decode()
