"""The processes of all branches: what they say, and another process for one that has died."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import wait
from pathlib import Path

from hotice.errors import HoticeError, OutputError
from hotice.learn.branches.branch import PATIENCE_S, POLL_S, Kind
from hotice.learn.branches.messages import Answer, Ready, Saved
from hotice.learn.branches.process import BranchProcess
from hotice.learn.train.config import TrainConfig
from hotice.owner import check_unowned

MOST_LOSSES = 3
"""A branch that died so often without a finished round in between is left alone."""


class Team:
    """Branches that run. To be closed by `end`, whatever happens.

    Args:
        kind: makes the runner of a branch.
        trials: how many a branch walks when it is asked to.
    """

    def __init__(self, kind: Kind, trials: int) -> None:
        self.kind, self.trials = kind, trials
        self.branches: list[BranchProcess] = []

    def start(self, configs: Sequence[TrainConfig]) -> None:
        """Starts a branch for each of these options, numbered in their order."""
        for number, config in enumerate(configs):
            self.branches.append(BranchProcess(number, self.kind, config, self.trials))

    def hear(self) -> Iterator[tuple[BranchProcess, Answer | None]]:
        """What branches have said by now, or say in the next moment, each with who said it; None: it has died.

        One that has died is to be started again (`again`) or left alone (`leave`) before the next call.
        """
        wait([branch.link for branch in self.branches], timeout=POLL_S)
        for branch in list(self.branches):
            for answer in branch.answers():
                if isinstance(answer, Ready):
                    branch.ready, branch.update = True, answer.update
                elif isinstance(answer, Saved):
                    branch.working, branch.update = False, answer.update
                yield branch, answer
            if branch.gone:
                yield branch, None

    def prepare(self, until: Callable[[BranchProcess], bool]) -> Iterator[tuple[BranchProcess, Answer]]:
        """What is said until it is so for every branch. Raises `HoticeError` where one dies before."""
        while not all(until(branch) for branch in self.branches):
            for branch, answer in self.hear():
                if answer is None:
                    raise HoticeError(f"branch {branch.number} cannot begin: {branch.how_it_ended()}")
                yield branch, answer

    def again(self, branch: BranchProcess, config: TrainConfig) -> None:
        """Starts another process in place of one that has died."""
        branch.end()
        branch.start(config)

    def leave(self, branch: BranchProcess) -> None:
        """Goes on without a branch."""
        branch.end()
        self.branches.remove(branch)

    def working(self) -> list[BranchProcess]:
        """Branches that have not answered their order to the end."""
        return [branch for branch in self.branches if branch.working]

    def end(self) -> None:
        """Lets all save and end, at the same time."""
        for branch in self.branches:
            branch.close()
        for branch in self.branches:
            branch.end()


def wait_until_unowned(folder: Path) -> None:
    """Waits for a branch of a run that was killed, which saves and ends by itself. Raises `OutputError`."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return check_unowned(folder)
        except OutputError:
            if time.monotonic() > deadline:
                raise
            time.sleep(POLL_S)
