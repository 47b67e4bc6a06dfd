"""Options of one command from its command line, and its help with examples."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tyro

from hotice.commands.line.catalog import Entry, examples
from hotice.commands.line.help_text import unbroken_help
from hotice.errors import UnknownName
from hotice.files import check_writable

Flat = tyro.conf.OmitArgPrefixes
"""Options on a command line carry no names of the groups they belong to."""
SHELLS = ("bash", "zsh", "tcsh", "fish")
"""Shells that tyro writes completion for; it asserts that it is asked for one of them."""


def parse(options: type, argv: Sequence[str], program: str, entry: Entry) -> Any:
    """Options as given. Raises `HoticeError`, or `SystemExit` after the help or where a word is not understood."""
    _check_completion(argv)
    try:
        with unbroken_help():
            return tyro.cli(Flat[options], args=list(argv), prog=f"{program} {entry.name}", description=entry.says)
    except SystemExit as end:
        if not end.code and {"-h", "--help"} & set(argv):
            sys.stdout.write(examples(entry))
        raise


def completion(commands: dict[str, Callable], options: dict[str, type], argv: Sequence[str]) -> int:
    """Answers tyro's options `--tyro-print-completion` and `--tyro-write-completion` for all commands together."""
    _check_completion(argv)
    known = {name: _told(function, options.get(name)) for name, function in commands.items()}
    with unbroken_help():
        tyro.extras.subcommand_cli_from_dict(known, args=list(argv), prog="hotice")
    return 0


def _check_completion(argv: Sequence[str]) -> None:
    """Raises `UnknownName` for another shell, `OutputError` for a file that cannot be written."""
    asked = argv[0].replace("_", "-") if argv else ""
    if len(argv) > 1 and asked in ("--tyro-print-completion", "--tyro-write-completion"):
        if argv[1] not in SHELLS:
            raise UnknownName("shell", argv[1], SHELLS)
        if asked == "--tyro-write-completion" and len(argv) > 2:
            check_writable(Path(argv[2]))


def _told(function: Callable, options: type | None) -> Callable:
    """A function whose options tyro can read, in place of one that names their type for type checkers alone."""
    if options is None:
        return function

    def told(config: Any) -> None:
        pass

    told.__doc__, told.__annotations__ = function.__doc__, {"config": Flat[options]}
    return told
