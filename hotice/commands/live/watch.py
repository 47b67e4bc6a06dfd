"""`hotice watch`: a run that is trained, on a page: its curves, and walks of each new checkpoint to play.

Nothing reaches the training: its log and checkpoints are read, at a low priority, by one thread. While no page
asks for walks none are made.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

from hotice.commands.live.newest_walks import CONFIG, NewestWalks
from hotice.commands.live.run_log import RunLog
from hotice.commands.live.watch_config import WatchConfig
from hotice.errors import HoticeError
from hotice.files import is_file
from hotice.replay import RolloutRecord
from hotice.replay.html import Steering, watched_page
from hotice.replay.scene_view import start_solids
from hotice.replay.serving import EVENTS, LiveServer, Newest
from hotice.sim.physics.threads import use_threads

LOOK_S = 1.0
"""Time between two looks at the run [s]."""
NICE = 10
"""Niceness: whoever trains has ten times its share of a core that both want."""
WAITING = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="1">
<link rel="icon" href="data:,"><title>hotice watch</title></head><body><p>The run has not begun yet.</p></body></html>
"""


def watch(config: WatchConfig, say: Callable[[str], Any], ended: threading.Event | None = None) -> None:
    """Serves the page until it is interrupted or `ended`; `say` gets its address. Raises `HoticeError`."""
    ended = ended or threading.Event()
    walks = None if config.wait and not is_file(config.run / CONFIG) else _walks(config)
    os.nice(NICE)
    use_threads(1)
    newest = Newest()
    with LiveServer(WAITING, newest, port=config.port) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        say(server.url)
        try:
            while walks is None and not ended.wait(LOOK_S):
                walks = _walks(config) if is_file(config.run / CONFIG) else None
            if walks is not None:
                _Watch(config.run, walks, server).go_on(ended)
        finally:
            newest.end()
            server.shutdown()


def _walks(config: WatchConfig) -> NewestWalks:
    return NewestWalks(config.run, config.rollouts, config.seed)


class _Watch:
    """One page: `version` counts the sets of walks that it has shown."""

    def __init__(self, run: Path, walks: NewestWalks, server: LiveServer) -> None:
        self._run, self._walks, self._server = run, walks, server
        self._log, self.version = RunLog(run), 0
        self._said = "no checkpoint yet: the robot stands where it will start"
        self._show([start_solids(scene) for scene in walks.scenes])

    def go_on(self, ended: threading.Event) -> None:
        """Looks at the run again and again."""
        while not ended.wait(LOOK_S):
            self._tell()
            checkpoint = self._walks.newest()
            # a page asks anew each time that it is loaded
            if checkpoint not in (None, self._walks.seen) and self._server.looked_at.is_set():
                self._walk(checkpoint)

    def _walk(self, checkpoint: Path) -> None:
        records: list[RolloutRecord] = []
        try:
            for record in self._walks.walk(checkpoint):
                records.append(record)
                self._tell(f"{checkpoint.name} walks: {len(records)} of {len(self._walks.scenes)} scenes")
        except HoticeError as error:
            self._said = f"{checkpoint.name} is not shown: {error}"
            return
        self._said, self.version = f"{checkpoint.name}, without exploration", self.version + 1
        self._server.looked_at.clear()
        self._show(records)

    def _show(self, records: list[RolloutRecord]) -> None:
        folder = files("hotice.commands.live")
        html, css, js = ((folder / f"watch.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js"))
        facts = {"events": EVENTS, "version": self.version, "watches": str(self._run)}
        steering = Steering(title="hotice watch", html=html, css=css, js=js, facts=facts)
        self._server.page = watched_page(records, steering).encode()

    def _tell(self, said: str | None = None) -> None:
        self._log.look()
        last, age_s = self._log.last, self._log.age_s
        self._server.newest.put(
            {
                "version": self.version,
                "said": said or self._said,
                "age": None if age_s is None else round(age_s),
                "last": {name: last.get(name) for name in ("update", "steps", "minutes", "steps_per_s")},
                "curves": self._log.curves(),
                "families": self._log.families(),
            }
        )
