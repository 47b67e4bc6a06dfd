"""`hotice play --view`: a simulation in the browser, to drag obstacles in and to push the robot."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hotice.commands.configs import PlayConfig
from hotice.console import PlainConsole
from hotice.errors import HoticeError, InvalidConfig
from hotice.files import is_folder
from hotice.model.objects import Box
from hotice.model.shipped import resolve_scenes
from hotice.policy import open_policy, shipped_policies
from hotice.progress import doing
from hotice.task.policy_task import PolicyTask

if TYPE_CHECKING:
    from hotice.policy.carry_policy import Network
    from hotice.view.session import Session

CARRIED = Box((0.3, 0.3, 0.25), 1.5)
"""What is carried at first; the page changes it."""
LOOK_S = 2.0
"""Time between two looks for a new checkpoint [s]."""


def play_view(config: PlayConfig) -> None:
    """Shows one scene until Ctrl-C. Raises `HoticeError`."""
    from hotice.fields.live import LiveField
    from hotice.view.serve import serve
    from hotice.view.session import Choice, Session

    scenes = resolve_scenes(config.scenes)
    if len(scenes) != 1:
        raise InvalidConfig(f"{len(scenes)} scenes are given: a live view shows one")
    policies = openers(config.policy)
    with doing("policy"):
        first = policies[config.policy]()
    task, said = PolicyTask.from_meta(first.meta, first.name), PlainConsole()
    with doing("fields"):
        live = LiveField(scenes[0].at(0.0), task.resolution_m, task.margin_m)
    with live:
        choice = Choice(
            policies=policies, policy=config.policy, carried=CARRIED, noise=config.perturbed, seed=config.seed
        )
        session = Session(scenes[0], live, choice)
        if is_folder(config.policy):
            threading.Thread(target=Follower(Path(config.policy), session, said.print).follow, daemon=True).start()
        serve(session, port=config.view_port, say=said.print)


def openers(policy: str) -> Mapping[str, Callable[[], Network]]:
    """Functions that open a policy, by the names that a page offers: shipped ones, and what was asked for."""
    known = dict.fromkeys([policy, *shipped_policies()])
    return {name: partial(_from_folder if is_folder(name) else open_policy, name) for name in known}


def _from_folder(path: str) -> Network:
    """The newest checkpoint of a run, or a checkpoint."""
    from hotice.commands.live.torch_network import TorchNetwork

    return TorchNetwork.load(Path(path))


class Follower:
    """Looks for new checkpoints of a run that goes on."""

    def __init__(self, run: Path, session: Session, say: Callable[[str], Any]) -> None:
        self._run, self._session, self._say = run, session, say
        self._seen = self._newest()

    def _newest(self) -> list[Path]:
        from hotice.learn.checkpoints.checkpoint import list_checkpoints

        return list_checkpoints(self._run)[-1:]

    def look(self) -> None:
        """Has the newest checkpoint walk, if it is new; one that cannot be read is told, and the one before stays."""
        newest = self._newest()
        if newest in ([], self._seen):
            return
        self._seen = newest
        try:
            self._session.order(_from_folder(str(newest[0])))
            self._say(f"loaded {newest[0]}")
        except HoticeError as error:
            self._say(f"{newest[0]} is not shown: {error}")

    def follow(self) -> None:
        """Looks again and again."""
        while True:
            time.sleep(LOOK_S)
            self.look()
