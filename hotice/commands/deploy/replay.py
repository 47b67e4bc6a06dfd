"""`hotice deploy replay LOG`: makes the targets and actions of a runner's log again, and compares them bit for bit.

With `--html` or `--mcap` it writes these files of the log, and compares nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from hotice.commands.line.catalog import Entry
from hotice.commands.line.parse import parse
from hotice.console import PlainConsole
from hotice.errors import HoticeError
from hotice.files import check_writable


class ReplayDiffers(HoticeError):
    """A log whose targets or actions do not come out again."""


@dataclass(frozen=True, kw_only=True)
class ReplayConfig:
    """One replay."""

    log: tyro.conf.Positional[Path]
    """Folder of a log of `hotice deploy`."""
    html: Path | None = None
    """Write a replay page: one .html file that needs nothing else."""
    mcap: Path | None = None
    """Write an .mcap file for Foxglove and the like: estimate, guidance, targets, modes, faults (extra `mcap`)."""


EXAMPLES = ("hotice deploy replay LOG", "hotice deploy replay LOG --html replay.html --mcap replay.mcap")


def main(argv: list[str]) -> int:
    """Runs the command. Raises `HoticeError`, `ReplayDiffers` too."""
    config = parse(ReplayConfig, argv, "hotice deploy", Entry("replay", __doc__ or "", EXAMPLES))
    console = PlainConsole()
    if config.html is not None or config.mcap is not None:
        _write(config, console)
        return 0
    from hotice.deploy.recording import replay_log

    found = replay_log(config.log, lambda text: console.print(text, soft_wrap=True))
    whole = f"{found.ticks_equal} of {found.ticks} targets from the messages"
    if not found.ticks:
        whole = "targets not tried: the log's beginning is gone, and with it what was tracked"
    console.print(
        f"{found.actions_equal} of {found.actions} actions from what the policy read; {whole}", soft_wrap=True
    )
    if not found.same:
        when = "" if found.first_difference_s is None else f", first at {found.first_difference_s:.3f} s"
        raise ReplayDiffers(f"the log comes out otherwise{when}: another machine or library, or a damaged log")
    return 0


def _write(config: ReplayConfig, console: PlainConsole) -> None:
    from hotice.deploy.seeing import read_run, rollout_record, write_mcap
    from hotice.replay import write_html

    for path in (config.html, config.mcap):
        if path is not None:
            check_writable(path)
    run = read_run(config.log, lambda text: console.print(text, soft_wrap=True))
    began_s, ended_s = run.moments["time_s"][[0, -1]]
    what = f"{len(run.moments)} moments in {ended_s - began_s:.2f} s, {len(run.events)} events"
    console.print(f"{run.scene.name}, {run.policy}: {what}", soft_wrap=True)
    if config.mcap is not None:
        console.print(str(write_mcap(run, config.mcap)), soft_wrap=True)
    if config.html is not None:
        console.print(str(write_html([rollout_record(run)], config.html)), soft_wrap=True)
