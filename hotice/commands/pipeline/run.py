"""Runs the jobs of a pipeline in the order of their references, several at a time, here or on a Ray cluster.

What is done stays done: each job leaves a mark in its folder, so a pipeline that was stopped, or lost its machine, goes
on where it was. A job whose process dies is tried again and goes on from its newest checkpoint; one that ends with an
error of the user (status 2) is not, and the jobs that need it are left out while the others go on.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from rich.live import Live
from rich.table import Table
from rich.text import Text

from hotice.commands.configs import PipelineConfig
from hotice.commands.pipeline.file import Pipeline, load_pipeline
from hotice.commands.pipeline.jobs import USER_ERROR, Job, JobProcess
from hotice.console import PlainConsole
from hotice.errors import HoticeError
from hotice.files import check_folder, make_folder, output_file, write_text
from hotice.learn.train.signals import stop_on_signals

FORMAT = "hotice-pipeline-status/1"
STATUS = "status.json"
POLL_S = 0.2
COLOURS = {
    "done": "green",
    "running": "cyan",
    "failed": "red",
    "left out": "red",
    "waiting": "dim",
    "stopped": "yellow",
}


class Workers(Protocol):
    """Something that runs jobs."""

    def has_room(self) -> bool:
        """Whether another job may be started."""
        ...

    def start(self, job: Job) -> None:
        """Starts a job."""
        ...

    def ended(self) -> list[tuple[Job, int]]:
        """Jobs that ended since the last call, with their exit status (negative: killed, or its machine lost)."""
        ...

    def stop(self) -> None:
        """Asks all jobs to save and end, and waits for them."""
        ...


class LocalWorkers:
    """Processes of this machine."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.running: list[JobProcess] = []

    def has_room(self) -> bool:
        return len(self.running) < self.count

    def start(self, job: Job) -> None:
        self.running.append(JobProcess(job))

    def ended(self) -> list[tuple[Job, int]]:
        found = [(process, process.poll()) for process in self.running]
        self.running = [process for process, status in found if status is None]
        return [(process.job, status) for process, status in found if status is not None]

    def stop(self) -> None:
        for process in self.running:
            process.stop()


@dataclass(kw_only=True)
class Progress:
    """Where a job stands."""

    state: str = "waiting"
    attempts: int = 0
    began: float = 0.0
    seconds: float = 0.0
    words: str = ""


class Schedule:
    """States of all jobs: which may start, and what an ended one means for the others."""

    def __init__(self, pipeline: Pipeline, retries: int) -> None:
        self.pipeline, self.retries = pipeline, retries
        self.progress = {job.name: Progress(state="done" if job.done else "waiting") for job in pipeline.jobs}
        self.jobs: Mapping[str, Job] = {job.name: job for job in pipeline.jobs}

    def ready(self) -> list[Job]:
        """Jobs that wait for nothing but room."""
        return [
            job
            for job in self.pipeline.jobs
            if self.progress[job.name].state == "waiting" and all(self.progress[n].state == "done" for n in job.needs)
        ]

    def started(self, job: Job) -> None:
        """Notes that a job runs."""
        it = self.progress[job.name]
        it.state, it.attempts, it.began = "running", it.attempts + 1, time.monotonic()

    def ended(self, job: Job, status: int) -> None:
        """Notes how a job ended: it is done, to be tried again, or failed, and then nothing that needs it can run."""
        it = self.progress[job.name]
        it.seconds += time.monotonic() - it.began
        it.words = "" if status == 0 else f"status {status}: {job.last_words()}"
        if status == 0:
            it.state = "done"
        elif status != USER_ERROR and it.attempts <= self.retries:
            it.state = "waiting"
        else:
            it.state = "failed"
            self._leave_out_dependents()

    def stopped(self) -> None:
        """Notes that all running jobs were stopped."""
        for it in self.progress.values():
            if it.state == "running":
                it.state = "stopped"

    def count(self, *states: str) -> int:
        """Number of jobs in these states."""
        return sum(it.state in states for it in self.progress.values())

    def write(self) -> None:
        """Writes `status.json`."""
        rows = [
            {
                "name": job.name,
                "state": it.state,
                "attempts": it.attempts,
                "seconds": round(it.seconds, 1),
                "output": str(job.output),
                "needs": job.needs,
                "message": it.words,
            }
            for job in self.pipeline.jobs
            for it in [self.progress[job.name]]
        ]
        write_text(self.pipeline.out / STATUS, json.dumps({"format": FORMAT, "jobs": rows}, indent=1) + "\n")

    def table(self) -> Table:
        """States as a table."""
        table = Table("job", "command", "state", "attempts", "time [s]", f"message, or output in {self.pipeline.out}")
        for job in self.pipeline.jobs:
            it = self.progress[job.name]
            seconds = it.seconds + (time.monotonic() - it.began if it.state == "running" else 0.0)
            state = Text(it.state, style=COLOURS[it.state])
            words = it.words or str(job.output.relative_to(self.pipeline.out))
            table.add_row(job.name, job.command, state, str(it.attempts), f"{seconds:.0f}", words)
        return table

    def _leave_out_dependents(self) -> None:
        for job in self.pipeline.jobs:  # in the order of the graph: one pass reaches all
            if any(self.progress[n].state in ("failed", "left out") for n in job.needs):
                self.progress[job.name].state = "left out"


def run_pipeline(config: PipelineConfig) -> bool:
    """Runs a pipeline to its end; False when it was asked to stop. Raises `HoticeError` when a job failed."""
    pipeline = load_pipeline(config.config)
    check_folder(pipeline.out)
    output_file(pipeline.out / STATUS)
    schedule = Schedule(pipeline, config.retries)
    console = PlainConsole(stderr=True)
    with stop_on_signals() as stopping:
        workers = make_workers(config)
        make_folder(pipeline.out)
        with Live(schedule.table(), console=console, transient=True, refresh_per_second=2) as live:
            try:
                while not stopping.is_set() and (schedule.ready() or schedule.count("running")):
                    _turn(schedule, workers, console)
                    live.update(schedule.table())
                    time.sleep(POLL_S)
            finally:
                workers.stop()
    schedule.stopped()
    schedule.write()
    console.print(schedule.table())
    if failed := [name for name, it in schedule.progress.items() if it.state == "failed"]:
        raise HoticeError(
            f"{len(failed)} of {len(pipeline.jobs)} jobs failed ({', '.join(failed[:5])}): see {pipeline.out / STATUS} "
            "and log.txt in their folders; the same command goes on with them"
        )
    return not stopping.is_set()


def make_workers(config: PipelineConfig) -> Workers:
    """Processes of this machine, or a cluster. Raises `HoticeError` when Ray or the cluster is not there."""
    if config.cluster is None:
        return LocalWorkers(config.workers)
    from hotice.commands.pipeline.cluster import RayWorkers

    return RayWorkers(config.cluster)


def _turn(schedule: Schedule, workers: Workers, console: PlainConsole) -> None:
    """Takes in what ended, starts what can start, and says so."""
    events = []
    for job, status in workers.ended():
        schedule.ended(job, status)
        events.append((job, schedule.progress[job.name]))
    for job in schedule.ready():
        if not workers.has_room():
            break
        schedule.started(job)
        workers.start(job)
        events.append((job, schedule.progress[job.name]))
    if events:
        schedule.write()
    if not sys.stderr.isatty():
        for job, it in events:
            console.print(f"{job.name}: {it.state} {it.words}".strip(), soft_wrap=True)
