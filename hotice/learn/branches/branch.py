"""One branch in its process: an ordinary training run in a folder of its own, which trains when it is told to.

It ends when the run that started it closes the pipe, or has died: then it saves first. Signals are the run's business.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import torch

from hotice.errors import OutputError
from hotice.failures import mendable
from hotice.files import make_folder, output_file
from hotice.learn.branches.messages import Answer, Begin, Failed, Go, Ready, Report, Saved, Stop, Tried, Try
from hotice.learn.checkpoints.average import AveragedPolicy
from hotice.learn.checkpoints.checkpoint import load_checkpoint, read_meta, resolve
from hotice.learn.checkpoints.lineage import ANCESTORS, BRANCHES
from hotice.learn.train.config import TrainConfig, write_config
from hotice.learn.train.fit import load_networks, same_version
from hotice.learn.train.progress import Progress
from hotice.learn.train.resume import keep_rates
from hotice.learn.train.runner import Runner
from hotice.learn.train.trials import Trials
from hotice.learn.train.ways_picture import ways_figure
from hotice.owner import sole_owner

PATIENCE_S, POLL_S = 60.0, 0.2
"""Time that a process has to save and end; how often it is looked for what others do [s]."""
PRINTED = "log.txt"
"""What the process prints, in the branch's folder."""
BRANCH = "branch"
"""Key of the round that a branch is in, in `meta.json` of its checkpoints."""
Kind = Callable[[Any], Runner]


def run_branch(kind: Kind, config: TrainConfig, link: Connection, trials: int) -> None:
    """What the process of a branch does; `trials`: how many it walks when it is asked to."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    _print_to(make_folder(config.out) / PRINTED)
    if config.device.startswith("cuda:"):
        torch.cuda.set_device(config.device)
    try:
        with owned_when_free(config.out):
            # nothing is said before this branch is ready: the run has gone while this process was starting
            if link.poll():
                return
            Branch(kind(config), link, trials).serve()
    except Exception as error:
        known = mendable(error, "train")
        if known is None:
            raise
        print(f"hotice: {known}", file=sys.stderr)
        with contextlib.suppress(OSError):  # nobody is there to be told
            link.send(Failed(words=str(known)))
        sys.exit(2)


@contextlib.contextmanager
def owned_when_free(folder: Path) -> Iterator[None]:
    """Owns a branch's folder as soon as one of a run that was killed, which saves and ends by itself, lets go of it.

    Raises `OutputError`.
    """
    deadline = time.monotonic() + PATIENCE_S
    with contextlib.ExitStack() as stack:
        while True:
            try:
                stack.enter_context(sole_owner(folder))
                break
            except OutputError:
                if time.monotonic() > deadline:
                    raise
                time.sleep(POLL_S)
        yield


class Branch:
    """A run that obeys orders. `round`: SHA-256 of the average that it trains from, None before the first."""

    def __init__(self, runner: Runner, link: Connection, trials: int) -> None:
        self.runner, self.link, self.trials = runner, link, trials
        self.round: str | None = None
        if runner.config.resume:
            self._in_round(read_meta(resolve(runner.config.out))[BRANCH]["round"])
        self.left = False
        self._trials: Trials | None = None

    def serve(self) -> None:
        """Obeys until the other end of the pipe is closed."""
        runner = self.runner
        write_config(runner.config)
        with Progress(runner.config, runner.update, runner.steps) as self.progress:
            self._tell(Ready(update=runner.update, notice=runner.notice))
            while not self.left:
                try:
                    order = self.link.recv()
                except EOFError:
                    return
                if isinstance(order, Begin):
                    runner.save()
                    self._tell(Saved(update=runner.update))
                elif isinstance(order, Go):
                    self._enter(order.average)
                    self._train(order.until)
                elif isinstance(order, Try):
                    self._try(order)

    def _train(self, until: int) -> None:
        """Trains up to an update, or until it is asked to stop, and saves."""
        runner, begin, before = self.runner, time.monotonic(), self.runner.minutes
        while runner.update < until:
            log = runner.learn_once()
            runner.minutes = before + (time.monotonic() - begin) / 60.0
            self.progress.report(runner.update, runner.steps, runner.minutes, log)
            self._tell(Report(update=runner.update, log=log))
            if self._asked_to_stop():
                break
            if runner.due() and runner.update < until:
                runner.save()
        runner.save()
        self._tell(Saved(update=runner.update))

    def _enter(self, average: Path) -> None:
        """Takes over an average, unless this branch is in its round already."""
        runner = self.runner
        tensors, meta = load_checkpoint(average, runner.env.device)
        if self.round == meta["sha256"]:
            return
        told = meta[BRANCHES]
        follows = runner.update == meta["update"] and self.round == told["before"]
        with same_version(average):
            load_networks(runner, average, tensors, meta)
            runner.average.restart(runner.net)
            runner.average.load_state(tensors)
            runner.stages.load_state(tensors)
            keep_rates(runner, tensors["curriculum"], meta["scenes"])
            if not follows:
                runner.algo.load_optimizer(tensors, meta)
                runner.update = int(meta["update"])
            runner.ancestors = dict(meta.get(ANCESTORS, {}))
        self._in_round(meta["sha256"])

    def _in_round(self, sha256: str | None) -> None:
        self.round = sha256
        self.runner.notes[BRANCH] = {"round": sha256}

    def _try(self, order: Try) -> None:
        runner = self.runner
        if self._trials is None:
            self._trials = Trials(runner.env, replace(runner.config, trials=self.trials))
        tensors, _ = load_checkpoint(order.checkpoint, runner.env.device)
        net = deepcopy(runner.net)
        net.load_state_dict({k.removeprefix("net."): v for k, v in tensors.items() if k.startswith("net.")})
        average = AveragedPolicy(net, runner.config.average)
        average.load_state(tensors)
        results = self._trials.run(net, average)
        self._tell(Tried(steps=order.steps, results=results, ways=ways_figure(results, runner.env.bank)))

    def _tell(self, answer: Answer) -> None:
        try:
            self.link.send(answer)
        except (BrokenPipeError, ConnectionResetError):
            self.left = True

    def _asked_to_stop(self) -> bool:
        if not self.left and self.link.poll():
            try:
                return isinstance(self.link.recv(), Stop)
            except EOFError:
                self.left = True
        return self.left


def _print_to(path: Path) -> None:
    """Has all that this process prints, also from compiled code, written to the end of a file."""
    file = os.open(output_file(path), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.dup2(file, stream.fileno())
    os.close(file)
