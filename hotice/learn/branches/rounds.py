"""Rounds of a run of branches, on disk: the average that each begins from, and what the run shows of it.

    RUN/merged/checkpoint-N      the average that a round begins from, and the outer step's velocity
    RUN/branch-K/checkpoint-N    a branch, which names the average that it trains from
    RUN/checkpoint-N             the same average, or that of a round that was left half-way, to be evaluated

A round is closed by writing the next average; until that is there, whole, everything goes on from the last one. A run
that stops half-way shows the average of where its branches are, from which no branch goes on.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from hotice.errors import CheckpointError
from hotice.learn.branches.branch import BRANCH
from hotice.learn.branches.each import branch_folder
from hotice.learn.branches.mean import mean_meta, mean_tensors, spread
from hotice.learn.branches.outer import OuterStep
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint, read_meta, save_checkpoint
from hotice.learn.checkpoints.lineage import BRANCHES, MERGED, own_steps
from hotice.learn.train.config import TrainConfig, config_to_dict

MERGED_FOLDER = "merged"
VELOCITY = "outer."
WEIGHTS = "net.nets."
ADOPTED = "adopted"
"""Stands for the average before one that was no average: a checkpoint of one process."""
Loaded = tuple[dict[str, Tensor], dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Round:
    """A round: the checkpoint that it begins from, its SHA-256, and updates, environment steps and minutes before."""

    average: Path
    sha256: str
    before: str | None
    update: int
    steps: int
    minutes: float

    @classmethod
    def of(cls, average: Path) -> Round:
        """The round that begins from a checkpoint of `RUN/merged`. Raises `CheckpointError`."""
        meta = read_meta(average)
        try:
            before, sha256 = meta[BRANCHES]["before"], meta["sha256"]
        except (KeyError, TypeError):
            raise CheckpointError(f"{average}: is no average of branches that a round begins from") from None
        counters = int(meta["update"]), int(meta["steps"]), float(meta["minutes"])
        return cls(
            average=average, sha256=sha256, before=before, update=counters[0], steps=counters[1], minutes=counters[2]
        )


@dataclass(frozen=True, kw_only=True)
class Closed:
    """The round after one that was closed, and how far weights went: see `hotice.learn.branches.mean.spread`."""

    round: Round
    way: float
    apart: float


class Rounds:
    """The files of a run of branches. `config`: of the run."""

    def __init__(self, config: TrainConfig) -> None:
        self.config, self.out, self.merged = config, config.out, config.out / MERGED_FOLDER

    # where a run stands ---------------------------------------------------------------------------------------------

    def found(self) -> Round | None:
        """The round that a run goes on with; that of a run of one process begins at its checkpoint. None: a new run."""
        shown, averages = list_checkpoints(self.out), list_checkpoints(self.merged)
        if not (self.config.resume and shown):
            return None
        told = read_meta(shown[-1]).get(BRANCHES)
        if told and averages:
            last = Round.of(averages[-1])
            if told["round"] in (last.sha256, last.before):
                return last
        return self._adopt(shown[-1])

    def state_of(self, number: int, this: Round) -> dict[str, Any] | None:
        """Meta of a branch's checkpoint where that is in this round, or at its beginning; None: it has none."""
        there = list_checkpoints(branch_folder(self.out, number))
        if not there:
            return None
        meta = read_meta(there[-1])
        told = meta.get(BRANCH)
        if not isinstance(told, dict) or "round" not in told:
            return None
        within = told["round"] == this.sha256
        return meta if within or (told["round"] == this.before and meta["update"] == this.update) else None

    def forget(self, number: int) -> None:
        """Removes the checkpoints of a branch that begins anew."""
        for folder in list_checkpoints(branch_folder(self.out, number)):
            shutil.rmtree(folder, ignore_errors=True)

    def forget_all(self) -> None:
        """Removes what an earlier run, whose own checkpoints are gone, may have left."""
        shutil.rmtree(self.merged, ignore_errors=True)
        for folder in self.out.glob("branch-*"):
            for checkpoint in list_checkpoints(folder):
                shutil.rmtree(checkpoint, ignore_errors=True)

    # from round to round --------------------------------------------------------------------------------------------

    def begin(self) -> Round:
        """The first round of a new run, from the checkpoint that branch 0 has written before its first update."""
        first = self._parts([0])
        return self._write(mean_tensors([first[0][0]]), [first[0][1]], [0], None, 0, 0, 0.0)

    def close(self, this: Round, numbers: Sequence[int], update: int, steps: int, minutes: float) -> Closed:
        """The next round: averages branches that are at the same update, and takes the outer step."""
        parts = self._parts(numbers)
        tensors, metas = mean_tensors([t for t, _ in parts]), [m for _, m in parts]
        before, _ = load_checkpoint(this.average)
        step, mean = OuterStep.of(self.config.split), {k: v for k, v in tensors.items() if k.startswith(WEIGHTS)}
        velocity = {k.removeprefix(VELOCITY): v for k, v in before.items() if k.startswith(VELOCITY)}
        after, moving = step(before, mean, velocity)
        tensors |= after | {VELOCITY + name: value for name, value in moving.items()}
        for name in (n for n in after if n.endswith(".log_std") and not self.config.split.plain):
            # what every step of the optimiser sees to
            tensors[name] = tensors[name].clamp(min=math.log(self.config.ppo.min_std))
        way, apart = spread(before, [t for t, _ in parts])
        return Closed(
            round=self._write(tensors, metas, numbers, this.sha256, update, steps, minutes), way=way, apart=apart
        )

    def show(self, this: Round, numbers: Sequence[int], steps: int, minutes: float) -> Path:
        """Writes the average of where branches are, in the middle of a round, as the checkpoint of the run."""
        parts = self._parts(numbers)
        tensors, metas = mean_tensors([t for t, _ in parts]), [m for _, m in parts]
        update = min(int(meta["update"]) for meta in metas)
        told = {"averaged": list(numbers), "updates": [int(m["update"]) for m in metas], "round": this.sha256}
        return save_checkpoint(self.out, update, tensors, self._meta(metas, told, steps, minutes))

    def show_begin(self, this: Round) -> Path:
        """Writes the average that a round begins from as the checkpoint of the run."""
        tensors, meta = load_checkpoint(this.average)
        tensors = {k: v for k, v in tensors.items() if not k.startswith(VELOCITY)}
        own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
        own[BRANCHES] = {**own[BRANCHES], "round": this.sha256}
        return save_checkpoint(self.out, this.update, tensors, own)

    def show_if_behind(self, this: Round) -> None:
        """Makes up for what a kill between an average and its showing left out."""
        told = read_meta(list_checkpoints(self.out)[-1]).get(BRANCHES)
        if told and told["round"] != this.sha256:
            self.show_begin(this)

    def _parts(self, numbers: Sequence[int]) -> list[Loaded]:
        return [load_checkpoint(branch_folder(self.out, number)) for number in numbers]

    def _write(
        self,
        tensors: dict[str, Tensor],
        metas: list[dict[str, Any]],
        numbers: Sequence[int],
        before: str | None,
        update: int,
        steps: int,
        minutes: float,
    ) -> Round:
        told = {"averaged": list(numbers), "updates": [update] * len(numbers), "before": before}
        meta = self._meta(metas, told, steps, minutes)
        this = Round.of(save_checkpoint(self.merged, update, tensors, meta))
        self.show_begin(this)
        return this

    def _meta(self, metas: list[dict[str, Any]], told: dict[str, Any], steps: int, minutes: float) -> dict[str, Any]:
        counters = {"steps": steps, "minutes": minutes, "config": config_to_dict(self.config)}
        return {**mean_meta(metas), **counters, BRANCHES: {"count": self.config.split.branches, **told}}

    def _adopt(self, checkpoint: Path) -> Round:
        """The round that begins at a checkpoint of one process, or at one whose round is gone."""
        tensors, meta = load_checkpoint(checkpoint)
        told = {"averaged": [0], "updates": [meta["update"]], "before": ADOPTED}
        own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update", MERGED)}
        own |= {"steps": own_steps(meta), "ranks": 1, BRANCHES: {"count": self.config.split.branches, **told}}
        shutil.rmtree(self.merged, ignore_errors=True)
        return Round.of(save_checkpoint(self.merged, int(meta["update"]), mean_tensors([tensors]), own))
