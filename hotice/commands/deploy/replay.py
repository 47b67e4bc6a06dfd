"""`hotice deploy replay LOG`: makes the targets and actions of a runner's log again, and compares them bit for bit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from hotice.console import PlainConsole
from hotice.errors import HoticeError


class ReplayDiffers(HoticeError):
    """A log whose targets or actions do not come out again."""


@dataclass(frozen=True, kw_only=True)
class ReplayConfig:
    """One replay."""

    log: tyro.conf.Positional[Path]
    """Folder of a log of `hotice deploy`."""


def main(argv: list[str]) -> int:
    """Runs the command. Raises `HoticeError`, `ReplayDiffers` too."""
    config = tyro.cli(ReplayConfig, args=argv, prog="hotice deploy replay", description=__doc__)
    from hotice.deploy.recording import replay_log

    console = PlainConsole()
    found = replay_log(config.log, lambda text: console.print(text, soft_wrap=True))
    whole = f"{found.ticks_equal} of {found.ticks} targets from the messages"
    if not found.ticks:
        whole = "targets not tried: the log's beginning is gone, and with it what was tracked"
    console.print(
        f"{found.actions_equal} of {found.actions} actions from what the policy read; {whole}", soft_wrap=True
    )
    if found.actions_equal < found.actions or found.ticks_equal < found.ticks:
        when = "" if found.first_difference_s is None else f", first at {found.first_difference_s:.3f} s"
        raise ReplayDiffers(f"the log comes out otherwise{when}: another machine or library, or a damaged log")
    return 0
