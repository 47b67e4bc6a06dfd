"""The process of a branch, seen from the run: orders to it, answers of it, and how it ended."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal

from hotice.learn.branches.branch import PATIENCE_S, PRINTED, Kind, run_branch
from hotice.learn.branches.messages import Answer, Failed, Order
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.signals import without_ctrl_c

START = "spawn"
"""Way in which processes are started."""


class BranchProcess:
    """A branch that runs.

    number: from 0. ready: it has been built. working: it has an order that it has not answered to the end. update: how
    many are in its newest checkpoint, as far as is known. losses: how often it died since it last finished a round.
    """

    def __init__(self, number: int, kind: Kind, config: TrainConfig, trials: int) -> None:
        self.number, self.kind, self.trials = number, kind, trials
        self.losses = 0
        self.start(config)

    def start(self, config: TrainConfig) -> None:
        """Starts the process, or another one in its place."""
        self.config, self.words, self.update = config, "", 0
        self.ready = self.working = self.gone = False
        context = multiprocessing.get_context(START)
        self.link, theirs = context.Pipe()
        arguments = self.kind, config, theirs, self.trials
        self.process = context.Process(target=run_branch, args=arguments, name=f"branch-{self.number}")
        with without_ctrl_c():
            self.process.start()
        theirs.close()

    def tell(self, order: Order) -> None:
        """Gives an order; one that has died meanwhile is told nothing, which its pipe says."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.link.send(order)

    def answers(self) -> list[Answer]:
        """What it has said since the last call; sets `gone` once it has ended and said its last."""
        found: list[Answer] = []
        try:
            while self.link.poll():
                answer = self.link.recv()
                if isinstance(answer, Failed):
                    self.words = answer.words
                else:
                    found.append(answer)
        except (EOFError, OSError):
            self.gone = True
        return found

    def how_it_ended(self) -> str:
        """Words for how it ended; waits until it has."""
        self.process.join(PATIENCE_S)
        code = self.process.exitcode
        if self.words:
            return self.words
        if code is not None and code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"status {code}, see {self.config.out / PRINTED}"

    def close(self) -> None:
        """Lets it save and end."""
        self.link.close()

    def end(self) -> None:
        """Waits until it has ended; kills it where it takes too long, or has nothing to save yet."""
        self.close()
        if not self.ready:
            self.process.kill()
        self.process.join(PATIENCE_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
