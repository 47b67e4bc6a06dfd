"""Jobs on a Ray cluster. Ray is optional: `pip install "ray>=2.40"` on every machine, with hotice and a shared folder.

A task is one attempt: it starts the job's process on whatever machine has room and waits for it. When the machine is
lost Ray reports so, and the pipeline submits the job again, which goes on from its newest checkpoint in the shared
folder.
"""

from __future__ import annotations

import logging
import os
import signal
import time
from typing import Any

from hotice.commands.pipeline.jobs import Job, JobProcess
from hotice.errors import HoticeError

LOST = -signal.SIGKILL
POLL_S = 0.5


class RayWorkers:
    """Tasks of a Ray cluster, each with the cores and GPUs that its job asks for.

    Raises `HoticeError` when Ray is not installed or no cluster answers at `address` ("auto": this machine's).
    """

    def __init__(self, address: str) -> None:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        try:
            import ray
        except ImportError:
            raise HoticeError('--cluster needs Ray, which is not installed: pip install "ray>=2.40"') from None
        self.ray = ray
        try:
            ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR, ignore_reinit_error=True)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise HoticeError(
                f"no Ray cluster at {address!r}: {str(error).splitlines()[0]} (start one with `ray start --head`)"
            ) from None
        self.task = ray.remote(max_retries=0)(attempt)
        self.running: dict[Any, Job] = {}

    def has_room(self) -> bool:
        return True

    def start(self, job: Job) -> None:
        self.running[self.task.options(num_cpus=job.cpus, num_gpus=job.gpus, name=job.name).remote(job)] = job

    def ended(self) -> list[tuple[Job, int]]:
        if not self.running:
            return []
        ready, _ = self.ray.wait(list(self.running), num_returns=len(self.running), timeout=POLL_S)
        return [(self.running.pop(task), self._status(task)) for task in ready]

    def stop(self) -> None:
        for task in self.running:
            self.ray.cancel(task)
        if self.running:
            self.ray.wait(list(self.running), num_returns=len(self.running), timeout=90.0)

    def _status(self, task: Any) -> int:
        try:
            return self.ray.get(task)
        except self.ray.exceptions.RayTaskError as error:
            raise HoticeError(f"a job could not be started: {str(error).splitlines()[-1]}") from None
        except self.ray.exceptions.RayError:
            return LOST


def attempt(job: Job) -> int:
    """Runs a job's process to its end, on a machine of the cluster; stops it when the task is cancelled."""
    process = JobProcess(job)
    try:
        while (status := process.poll()) is None:
            time.sleep(POLL_S)
        return status
    finally:
        process.stop()
