"""Command line of hotice, also `python -m hotice.learn`: training, evaluation, tables, replays, scenes."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

from hotice.errors import Stopped, UnknownName
from hotice.failures import INTERRUPTED, STOPPED, mendable, one_line

if TYPE_CHECKING:
    from hotice.commands.line.catalog import Entry


@dataclass(frozen=True)
class NoOptions:
    """Options of a command that has none."""


def main(argv: list[str] | None = None) -> int:
    """Runs a command; an error that the user can mend is printed on one line and gives status 2, Ctrl-C 130 or 75."""
    argv = sys.argv[1:] if argv is None else argv
    return guarded(lambda: _run(argv), argv[0] if argv else "")


def guarded(work: Callable[[], int], command: str = "") -> int:
    """Exit status of `work`; what ends it early is told on one line, unless it is a defect."""
    with _noted() as interrupted:
        return _guarded(work, command, interrupted)


def _guarded(work: Callable[[], int], command: str, interrupted: threading.Event) -> int:
    try:
        status = work()
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # the reader of a pipe has gone: nothing is wrong
        sys.stderr.close()
        return 0
    except Stopped as stopped:
        return _say(f"stopped: {stopped}", STOPPED)
    except KeyboardInterrupt:
        return _say("interrupted", INTERRUPTED)
    except Exception as error:
        if interrupted.is_set():  # compiled code that calls Python may swallow it, and fail later
            return _say("interrupted", INTERRUPTED)
        known = mendable(error, command)
        if known is None:
            raise
        return _say(str(known), 2)


@contextlib.contextmanager
def _noted() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets beside what it does anyhow."""
    event, before = threading.Event(), signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or before is not signal.default_int_handler:
        yield event
        return

    def note(number: int, frame: FrameType | None) -> None:
        event.set()
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


def _say(text: str, status: int) -> int:
    print(one_line(f"hotice: {text}"), file=sys.stderr)
    _drop_unwritten()
    return status


def _run(argv: list[str]) -> int:
    """Finds the command by the first word, and imports that one alone."""
    from hotice.commands.line import catalog

    if argv[:2] == ["deploy", "replay"]:
        from hotice.commands.deploy import replay

        return replay.main(argv[2:])
    if argv[:1] == ["scene"]:
        program, groups, argv, about = "hotice scene", catalog.SCENES, argv[1:], "Scenes: the rooms to carry through."
    elif argv[:1] == ["pickup"]:
        program, groups, argv, about = "hotice pickup", catalog.PICKUPS, argv[1:], catalog.ABOUT_PICKUPS
    else:
        program, groups, about = "hotice", catalog.COMMANDS, catalog.ABOUT
    if argv[:1] in ([], ["-h"], ["--help"]):
        print(catalog.overview(program, groups, about))
        return 0 if argv else 2
    if argv[0] == "--version":
        import hotice

        print(f"hotice {hotice.__version__}")
        return 0
    if argv[0].startswith("--tyro-"):
        return _complete(argv)
    entry = catalog.find(groups, argv[0])
    if entry is None:
        kind = "option" if argv[0].startswith("-") else f"{program} command".removeprefix("hotice ")
        raise UnknownName(kind, argv[0], catalog.names(groups))
    return _call(program, entry, argv[1:])


def _call(program: str, entry: Entry, argv: list[str]) -> int:
    from hotice.commands.line.options import OPTIONS, PICKUP_OPTIONS, SCENE_OPTIONS
    from hotice.commands.line.parse import parse

    if program == "hotice":
        from hotice.commands.table import COMMANDS as functions

        options = OPTIONS.get(entry.name)
    elif program == "hotice pickup":
        from hotice.commands.picks.group import COMMANDS as functions

        options = PICKUP_OPTIONS.get(entry.name)
    else:
        from hotice.commands.scene import COMMANDS as functions

        options = SCENE_OPTIONS.get(entry.name)
    if options is None:
        parse(NoOptions, argv, program, entry)
        return functions[entry.name]()
    return functions[entry.name](parse(options, argv, program, entry))


def _complete(argv: list[str]) -> int:
    from hotice.commands.line.options import OPTIONS
    from hotice.commands.line.parse import completion
    from hotice.commands.table import COMMANDS

    return completion(COMMANDS, dict(OPTIONS), argv)


def _drop_unwritten() -> None:
    """Discards buffered output where standard output cannot be written; Python would complain about it at exit."""
    try:
        sys.stdout.flush()
    except OSError:
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, sys.stdout.fileno())
            os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
