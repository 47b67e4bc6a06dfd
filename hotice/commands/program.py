"""Command line of hotice, also `python -m hotice.learn`: training, evaluation, tables, replays, scenes."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

from hotice.errors import Stopped
from hotice.failures import INTERRUPTED, STOPPED, mendable, one_line


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
    if argv[:1] == ["scene"]:  # a group of its own, quick because it needs no torch
        from hotice.commands import scene as scene_commands

        return scene_commands.main(argv[1:])
    if argv[:1] == ["pickup"]:
        from hotice.commands.picks import group

        return group.main(argv[1:])
    if argv[:2] == ["deploy", "replay"]:
        from hotice.commands.deploy import replay

        return replay.main(argv[2:])
    import tyro

    from hotice.commands import table as commands
    from hotice.commands.help_text import unbroken_help

    with unbroken_help():
        return (
            tyro.extras.subcommand_cli_from_dict(commands.COMMANDS, args=argv, prog="hotice", description=__doc__) or 0
        )


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
