"""Command line of hotice, also as `python -m hotice.learn`: training, students, evaluation, tables, replays, `hotice scene`."""

from __future__ import annotations

import sys


def main(argv: list[str] | None = None) -> int:
    """Runs a command; a `HoticeError` is printed on one line and gives status 2."""
    import tyro

    from hotice.errors import HoticeError

    argv = sys.argv[1:] if argv is None else argv
    try:
        if argv[:1] == ["scene"]:  # a group of its own, quick because it needs no torch
            from hotice import scene_commands

            return scene_commands.main(argv[1:])
        from hotice.learn import commands

        return (
            tyro.extras.subcommand_cli_from_dict(commands.COMMANDS, args=argv, prog="hotice", description=__doc__) or 0
        )
    except HoticeError as error:
        print(f"hotice: {error}".replace("\n", " "), file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of a pipe has gone: nothing is wrong
        sys.stderr.close()
        return 0


if __name__ == "__main__":
    sys.exit(main())
