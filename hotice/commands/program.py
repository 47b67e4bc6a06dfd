"""Command line of hotice, also `python -m hotice.learn`: training, evaluation, tables, replays, scenes."""

from __future__ import annotations

import contextlib
import os
import sys

from hotice.failures import mendable, one_line


def main(argv: list[str] | None = None) -> int:
    """Runs a command; an error that the user can mend is printed on one line and gives status 2."""
    argv = sys.argv[1:] if argv is None else argv
    try:
        status = _run(argv)
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # the reader of a pipe has gone: nothing is wrong
        sys.stderr.close()
        return 0
    except Exception as error:
        known = mendable(error, argv[0] if argv else "")
        if known is None:
            raise
        print(one_line(f"hotice: {known}"), file=sys.stderr)
        _drop_unwritten()
        return 2


def _run(argv: list[str]) -> int:
    if argv[:1] == ["scene"]:  # a group of its own, quick because it needs no torch
        from hotice.commands import scene as scene_commands

        return scene_commands.main(argv[1:])
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
