"""Options of one command from its command line, and its help with examples."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import tyro

from hotice.commands.line.catalog import Entry, examples
from hotice.commands.line.help_text import unbroken_help

Flat = tyro.conf.OmitArgPrefixes
"""Options on a command line carry no names of the groups they belong to."""


def parse(options: type, argv: Sequence[str], program: str, entry: Entry) -> Any:
    """Options as given. Raises `HoticeError`, or `SystemExit` after the help or where a word is not understood."""
    try:
        with unbroken_help():
            return tyro.cli(Flat[options], args=list(argv), prog=f"{program} {entry.name}", description=entry.says)
    except SystemExit as end:
        if not end.code and {"-h", "--help"} & set(argv):
            sys.stdout.write(examples(entry))
        raise


def completion(commands: dict[str, Callable], options: dict[str, type], argv: Sequence[str]) -> int:
    """Answers tyro's options `--tyro-print-completion` and `--tyro-write-completion` for all commands together."""
    known = {name: _told(function, options.get(name)) for name, function in commands.items()}
    with unbroken_help():
        tyro.extras.subcommand_cli_from_dict(known, args=list(argv), prog="hotice")
    return 0


def _told(function: Callable, options: type | None) -> Callable:
    """A function whose options tyro can read, in place of one that names their type for type checkers alone."""
    if options is None:
        return function

    def told(config: Any) -> None:
        pass

    told.__doc__, told.__annotations__ = function.__doc__, {"config": Flat[options]}
    return told
