"""Errors that hotice raises on purpose.

Every message says what came, what is allowed and, where it helps, how to mend it. The command line prints the message
of a `HoticeError` on one line and exits with status 2; anything else is a defect and keeps its traceback.
"""

from collections.abc import Iterable

__all__ = [
    "CarryInfeasible",
    "CheckpointError",
    "DivergedError",
    "FieldsNotBuilt",
    "HoticeError",
    "InputError",
    "InvalidConfig",
    "InvalidMap",
    "InvalidObject",
    "InvalidScene",
    "InvalidState",
    "InvalidStation",
    "MissingExtra",
    "NotAvailable",
    "OutOfMemory",
    "OutputError",
    "PickInfeasible",
    "SimulationError",
    "Stopped",
    "UnknownName",
    "UnreachableGoal",
]


class HoticeError(Exception):
    """Base of every error that a user of hotice can mend."""


class UnknownName(HoticeError):
    """A name that is not in a table: says which names are, the nearest one, and `otherwise` what else may be given."""

    def __init__(self, kind: str, name: object, known: Iterable[object], otherwise: str = "") -> None:
        from difflib import get_close_matches

        known = sorted(map(str, known))
        near = "".join(f", did you mean {each}?" for each in get_close_matches(str(name)[:80], known, 1, 0.75))
        names = ", ".join(known) or "none"
        super().__init__(f"unknown {kind} {name!r}{near}: known are {names}{f', or {otherwise}' if otherwise else ''}")


class InvalidScene(HoticeError):
    """A scene file or scene that cannot be used."""


class InvalidObject(HoticeError):
    """A carried object with an impossible shape, size or mass."""


class InvalidState(HoticeError):
    """A configuration of robot and object of the wrong size, not finite, or without the object that is asked about."""


class UnreachableGoal(HoticeError):
    """A scene in which no free path joins start and goal; says why."""


class FieldsNotBuilt(HoticeError):
    """Fields of a scene that changes are not to be had: not in time, not of this scene, or their process has ended."""


class CarryInfeasible(HoticeError):
    """No carry state exists for this object and posture; says why."""


class PickInfeasible(HoticeError):
    """An object that cannot be picked up from where it is; says why."""


class PutDownInfeasible(PickInfeasible):
    """An object that cannot be put down where it was to stand; says why."""


class InvalidConfig(HoticeError):
    """A configuration value outside its allowed range."""


class CheckpointError(HoticeError):
    """A checkpoint or policy file that is missing, truncated, tampered with or of another layout."""


class OutputError(HoticeError):
    """An output path that cannot be written."""


class InputError(HoticeError):
    """An input file that is missing, not a regular file, too large or unreadable."""


class InvalidMap(HoticeError):
    """A point cloud or mesh that cannot be read or made into a scene."""


class SimulationError(HoticeError):
    """Physics that cannot go on: a buffer that overflowed, too many states that diverged, a process that died."""


class DivergedError(HoticeError):
    """Training that cannot go on: weights or gradients that are not finite."""


class OutOfMemory(HoticeError):
    """Memory of the machine or of its GPU that ran out; says what to lower."""


class Stopped(KeyboardInterrupt):
    """A command that the user stopped after it had saved what was done; says how to go on. No error of the command."""


class MissingExtra(HoticeError, ImportError):
    """A part of hotice whose optional packages are not installed; says which extra brings them."""

    def __init__(self, part: str, package: str, extra: str) -> None:
        super().__init__(f"{part} needs {package}, which is not installed: pip install 'hotice[{extra}]'")


class NotAvailable(HoticeError):
    """A plant, controller or combination that this version does not have; says which exist."""


class InvalidStation(HoticeError):
    """A diagram that cannot run: a port left unconnected, or parts that do not belong together."""
