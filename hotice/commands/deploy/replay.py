"""`hotice robot-replay`: the log of a robot as a replay page and as an MCAP file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from hotice.console import PlainConsole
from hotice.errors import InvalidConfig
from hotice.files import check_writable


@dataclass(frozen=True, kw_only=True)
class RobotReplayConfig:
    """The log of one run, and what is made of it. Raises `InvalidConfig`."""

    log: Annotated[Path, tyro.conf.Positional]
    """Folder of the log."""
    html: Path | None = None
    """Replay page: one .html file that needs nothing else."""
    mcap: Path | None = None
    """MCAP file, for Foxglove and the like: estimate, guidance, targets, modes, faults (extra `mcap`)."""

    def __post_init__(self) -> None:
        if self.html is None and self.mcap is None:
            raise InvalidConfig("nothing to write: give --html page.html, --mcap run.mcap or both")


def robot_replay(config: RobotReplayConfig) -> None:
    """Writes what is asked for and says where. Raises `HoticeError`."""
    from hotice.deploy.seeing import read_run, rollout_record, write_mcap
    from hotice.replay import write_html

    for path in (config.html, config.mcap):
        if path is not None:
            check_writable(path)
    run = read_run(config.log)
    console = PlainConsole()
    began_s, ended_s = run.moments["time_s"][[0, -1]]
    console.print(
        f"{run.scene.name}, {run.policy}: {len(run.moments)} moments in {ended_s - began_s:.2f} s, "
        f"{len(run.events)} events",
        soft_wrap=True,
    )
    if config.html is not None:
        console.print(str(write_html([rollout_record(run)], config.html)), soft_wrap=True)
    if config.mcap is not None:
        console.print(str(write_mcap(run, config.mcap)), soft_wrap=True)
