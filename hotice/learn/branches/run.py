"""A run of branches: has them train round by round, averages them, and goes on without one that is lost.

A lost branch (killed, out of memory, diverged) costs what it has done since the last average: that is left out of the
next one, from which it goes on in another process.
"""

from __future__ import annotations

import time

from hotice.errors import CheckpointError, HoticeError, InvalidConfig
from hotice.learn import distributed
from hotice.learn.branches.branch import Kind
from hotice.learn.branches.each import anew_config, branch_folder, first_config, resumed_config
from hotice.learn.branches.merges import Merges
from hotice.learn.branches.messages import Answer, Begin, Go, Ready, Report, Saved, Stop, Tried, Try
from hotice.learn.branches.process import BranchProcess
from hotice.learn.branches.rounds import Round, Rounds
from hotice.learn.branches.rows import Rows, logged
from hotice.learn.branches.team import MOST_LOSSES, Team, wait_until_unowned
from hotice.learn.checkpoints.checkpoint import list_checkpoints, read_meta
from hotice.learn.checkpoints.lineage import own_steps
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.train.config import TrainConfig, write_config
from hotice.learn.train.fit import check_kind
from hotice.learn.train.progress import LOG, Progress
from hotice.learn.train.resume import checked_options
from hotice.learn.train.runner import Runner, check_run_folder, check_start
from hotice.learn.train.signals import stop_on_signals
from hotice.owner import sole_owner
from hotice.progress import doing


def runner_of(kind: Kind, config: TrainConfig) -> Runner | BranchedRun:
    """What trains by a configuration: a runner, or a run of branches, each of them such a runner."""
    return BranchedRun(kind, config) if config.split.several else kind(config)


class BranchedRun:
    """A run of several branches.

    Args:
        kind: makes the runner of a branch.
        config: of the run; `num_envs`, `threads`, `updates` and `merge_every` count for each branch.

    Raises `InvalidConfig`, `CheckpointError` or `MissingExtra` for what cannot be, before anything is started.
    """

    round: Round
    rows: Rows

    def __init__(self, kind: Kind, config: TrainConfig) -> None:
        if distributed.wanted() > 1:
            raise InvalidConfig(
                f"branches is {config.split.branches}, and torchrun has started {distributed.wanted()} ranks: "
                "leave out one of the two"
            )
        self.kind, self.config = kind, config
        self.update, self.steps, self.minutes = 0, 0, 0.0
        if check_start(config):
            newest = list_checkpoints(config.out)[-1]
            meta = read_meta(newest)
            try:
                check_kind(newest, meta, DualPpo.kind)
                self.config = checked_options(config, newest, meta)
                self.update, self.steps, self.minutes = meta["update"], own_steps(meta), meta["minutes"]
            except (KeyError, TypeError) as error:
                raise CheckpointError(f"{newest}: is no checkpoint of this version: {error}") from None
        self.rounds, self.team = Rounds(self.config), Team(kind, self.config.trials)
        self.notices: list[str] = []
        self.saved: dict[int, int] = {}
        self.lost: dict[int, str] = {}
        self.trying: int | None = None
        self.over = False

    def train(self) -> bool:
        """Runs until the limit of updates or minutes; saves at the end, also when interrupted: then False.

        Raises `OutputError` where the folder holds another run, whose checkpoints would outlive the new ones, or is
        another process's; `HoticeError` where a branch cannot begin, or all are lost at once.
        """
        check_run_folder(self.config, self.update)
        with sole_owner(self.config.out):
            check_run_folder(self.config, self.update)
            write_config(self.config)
            if self.update >= self.config.updates:
                return True
            try:
                self._start()
                self._prepare()
                return self._train()
            finally:
                self.team.end()

    # the beginning --------------------------------------------------------------------------------------------------

    def _start(self) -> None:
        """Starts all branches, each where it was."""
        numbers = range(self.config.split.branches)
        for number in numbers:
            wait_until_unowned(branch_folder(self.config.out, number))
        found = self.rounds.found()
        if found is None:
            self.rounds.forget_all()
            configs = [first_config(self.config, number) for number in numbers]
        else:
            self.round = found
            configs = [self._config_of(number) for number in numbers]
        self.new = found is None
        self.team.start(configs)

    def _prepare(self) -> None:
        """Waits until all are built; in a new run, branch 0 gives the weights that all begin from."""
        with doing(f"preparing scenes, fields and objects of {len(self.team.branches)} branches"):
            for branch, answer in self.team.prepare(lambda b: b.ready):
                if isinstance(answer, Ready) and answer.notice:
                    self.notices.append(f"branch {branch.number}: {answer.notice}")
            if self.new:
                self._order(self.team.branches[0], Begin())
                for _ in self.team.prepare(lambda b: not b.working):
                    pass
                self.round = self.rounds.begin()
            else:
                self.rounds.show_if_behind(self.round)

    def _config_of(self, number: int) -> TrainConfig:
        """Options of a branch that goes on from where it was saved, or from the average where it was not."""
        meta = self.rounds.state_of(number, self.round)
        if meta is not None:
            return resumed_config(self.config, number, meta)
        self.notices.append(f"branch {number}: begins from the average of update {self.round.update}")
        return self._anew(number)

    def _anew(self, number: int) -> TrainConfig:
        self.rounds.forget(number)
        return anew_config(self.config, number, self.round.average, self.round.update)

    # the loop -------------------------------------------------------------------------------------------------------

    def _train(self) -> bool:
        cfg = self.config
        self.begin, self.minutes_before = time.monotonic(), self.minutes
        self.merges = Merges(cfg.out, self.round.update)
        with Progress(cfg, self.update, self.steps) as self.progress, stop_on_signals() as self.signalled:
            for words in self.notices:
                self.progress.note(words)
            while self.update < cfg.updates and not self.over:
                self._do_round()
                if not self.signalled.is_set():
                    self._ask_for_trials()
            while self.trying is not None and not self.signalled.is_set():
                self._hear()
        return not self.signalled.is_set()

    def _do_round(self) -> None:
        """Trains a round, or as much of it as there is time for; sets `over` where that is all."""
        while not all(branch.ready for branch in self.team.branches):
            if self.signalled.is_set():
                self.over = True
                return
            self._hear()
        each = self.config.num_envs * self.config.ppo.steps
        self.rows, self.saved, self.lost = Rows(self.round.update, self.round.steps, each), {}, {}
        # with other options than before, a branch may be further already
        end = max([self.round.update + self.config.split.updates(each), *(b.update for b in self.team.branches)])
        for branch in self.team.branches:
            self._go(branch, min(end, self.config.updates))
        while self.team.working():
            self._hear()
            if not self.over and (self.signalled.is_set() or self._late()):
                self.over = True
                for branch in self.team.working():
                    branch.tell(Stop())
        if self.signalled.is_set():
            self.progress.note("asked to stop: saving")
        self._close(end)

    def _go(self, branch: BranchProcess, until: int) -> None:
        """Sends a branch off; what it did of this round before it was started is in its log."""
        update = max(branch.update, self.round.update)
        self.rows.take_part(branch.number, update)
        for number, log in logged(branch.config.out / LOG, self.round.update, update):
            self.rows.add(branch.number, number, log)
        self._order(branch, Go(average=self.round.average, until=until))

    def _close(self, end: int) -> None:
        """Averages the branches that got through a round; of one that was left half-way it shows where they are."""
        numbers = sorted(self.saved)
        if not numbers:
            words = "; ".join(f"branch {number}: {how}" for number, how in sorted(self.lost.items()))
            raise HoticeError(
                f"all branches were lost after update {self.round.update} ({words}): what {self.config.out} shows is "
                "kept, and --resume goes on from it"
            )
        self._report()
        self.minutes = self._minutes()
        steps = self.rows.steps + self.rows.each * sum(update - self.rows.update for update in self.saved.values())
        if min(self.saved.values()) < end:
            self.rounds.show(self.round, numbers, steps, self.minutes)
            self.update, self.steps = min(self.saved.values()), steps
            return
        closed = self.rounds.close(self.round, numbers, end, steps, self.minutes)
        self.round, self.update, self.steps = closed.round, end, steps
        self.merges.add(closed, numbers, self.lost)
        for branch in self.team.branches:
            branch.losses = 0 if branch.number in self.saved else branch.losses

    def _ask_for_trials(self) -> None:
        """Has the first branch that is there walk the trials, before it goes on."""
        ready = [branch for branch in self.team.branches if branch.ready]
        if self.config.trials and ready and self.trying is None:
            self.trying = ready[0].number
            ready[0].tell(Try(checkpoint=list_checkpoints(self.config.out)[-1], steps=self.steps))

    # answers --------------------------------------------------------------------------------------------------------

    def _order(self, branch: BranchProcess, order: Begin | Go) -> None:
        branch.working = True
        branch.tell(order)

    def _hear(self) -> None:
        for branch, answer in self.team.hear():
            if answer is None:
                self._lose(branch)
            else:
                self._take(branch, answer)
        self._report()

    def _take(self, branch: BranchProcess, answer: Answer) -> None:
        if isinstance(answer, Report):
            self.rows.add(branch.number, answer.update, answer.log)
        elif isinstance(answer, Saved):
            self.saved[branch.number] = answer.update
        elif isinstance(answer, Tried):
            self.trying = None
            self.progress.trials(answer.steps, answer.results, answer.ways)

    def _report(self) -> None:
        """Shows and stores what all branches have done by now."""
        for update, steps, row in self.rows.whole():
            if update > self.update:
                self.progress.report(update, steps, self._minutes(), row)

    def _lose(self, branch: BranchProcess) -> None:
        """Goes on without a branch that has died until the next average, and starts it again from there."""
        how, number = branch.how_it_ended(), branch.number
        self.trying = None if self.trying == number else self.trying
        branch.losses += 1
        if number in self.saved:
            words = f"branch {number} died after its round ({how})"
        else:
            self.lost[number] = how
            self.rows.leave_out(number)
            words = f"branch {number} was lost ({how}): left out of the next average"
        if self.over:
            self.team.leave(branch)
            self.progress.note(words)
            return
        if branch.losses > MOST_LOSSES:
            self.team.leave(branch)
            self.progress.note(f"{words}; lost {branch.losses} times in a row, it is left alone until --resume")
            return
        self.progress.note(f"{words}; started again from there")
        self.team.again(branch, self._config_of(number) if number in self.saved else self._anew(number))

    def _minutes(self) -> float:
        return self.minutes_before + (time.monotonic() - self.begin) / 60.0

    def _late(self) -> bool:
        return 0 < self.config.max_minutes <= self._minutes() - self.minutes_before
