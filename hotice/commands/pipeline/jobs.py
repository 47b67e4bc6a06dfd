"""One job of a pipeline: a command of `hotice` with its options, a folder of its own, and a mark when it is done.

The folder's name ends in a hash of command and options, those of the jobs before it included. A job that is changed
gets another folder; nothing is overwritten, and what is marked as done was done exactly so.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from hotice.commands.line.options import OPTIONS, field_names
from hotice.commands.line.parse import Flat
from hotice.errors import HoticeError, InvalidConfig, OutputError, UnknownName
from hotice.files import make_folder, output_file, write_text
from hotice.owner import try_lock

FORMAT = "hotice-job/1"
RESULT, LOG, LOCK = "result.json", "log.txt", "lock"
OUTPUTS: Mapping[str, str] = {
    "train": "",
    "distill": "",
    "finetune": "",
    "merge": "",
    "evaluate": "report.json",
    "export": "policy.onnx",
    "play": "replay.html",
}
"""Commands that can be jobs, and where in the job's folder their output goes (runs: the folder itself)."""
USER_ERROR = 2
"""Exit status that no repetition mends."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """A command to run. needs: names of jobs that come first. cpus, gpus: what a cluster sets aside for it."""

    name: str
    command: str
    argv: tuple[str, ...]
    needs: tuple[str, ...]
    folder: Path
    cpus: int = 1
    gpus: float = 0.0

    @property
    def output(self) -> Path:
        """File or folder that other jobs read."""
        return self.folder / OUTPUTS[self.command]

    @property
    def done(self) -> bool:
        """Whether it ran to its end before."""
        return (self.folder / RESULT).is_file()

    def last_words(self) -> str:
        """The last line that it printed."""
        try:
            lines = (self.folder / LOG).read_text(errors="replace").splitlines()
        except OSError:
            return ""
        return next((line.strip() for line in reversed(lines) if line.strip()), "")


class JobProcess:
    """A job in a process of its own, which goes on from the newest checkpoint where there is one.

    The process holds a lock on the folder as long as it lives, also when whoever started it was killed: a second one
    waits.
    """

    def __init__(self, job: Job) -> None:
        self.job = job
        self.process: subprocess.Popen[bytes] | None = None
        self.began = time.monotonic()
        make_folder(job.folder)
        self.poll()

    def poll(self) -> int | None:
        """Exit status (negative: the signal that ended it), or None while it runs; marks the job when it is done."""
        if self.process is None:
            self._begin()
            return None
        status = self.process.poll()
        if status == 0 and not self.job.done:
            mark = {
                "format": FORMAT,
                "name": self.job.name,
                "command": self.job.command,
                "argv": self.job.argv,
                "seconds": round(time.monotonic() - self.began, 1),
            }
            write_text(self.job.folder / RESULT, json.dumps(mark, indent=1) + "\n")
        return status

    def stop(self, patience_s: float = 60.0) -> None:
        """Asks it to save and end; kills it when it does not."""
        if self.process is None or self.process.poll() is not None:
            return
        self.process.terminate()
        try:
            self.process.wait(patience_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _begin(self) -> None:
        try:
            with (
                open(output_file(self.job.folder / LOCK), "a") as lock,
                open(output_file(self.job.folder / LOG), "ab") as log,
            ):
                if not try_lock(lock):
                    return
                self.process = subprocess.Popen(
                    [sys.executable, "-m", "hotice.learn", self.job.command, *self.job.argv],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    pass_fds=(lock.fileno(),),
                    start_new_session=True,
                    env={**os.environ, "OMP_NUM_THREADS": str(self.job.cpus)},
                )
                lock.truncate(0)
                lock.write(f"{self.process.pid}\n")
        except OSError as error:  # also of a lock that is written when it is closed
            self.stop()
            name = error.filename or self.job.folder / LOCK
            raise OutputError(f"job {self.job.name!r}: cannot write {name}: {error.strerror or error}") from None


def to_argv(options: Mapping[str, Any]) -> list[str]:
    """Options as command line arguments: `{"num_envs": 8, "perturbed": False}` -> `--num-envs 8 --no-perturbed`."""
    argv: list[str] = []
    for name, value in options.items():
        flag = name.replace("_", "-")
        if isinstance(value, bool):
            argv.append(f"--{flag}" if value else f"--no-{flag}")
        else:
            values = value if isinstance(value, Sequence) and not isinstance(value, str) else [value]
            argv += [f"--{flag}", *map(str, values)]
    return argv


def option_names(command: Any) -> set[str]:
    """Names of all options of a command. Raises `UnknownName` for a command that is no job."""
    if not isinstance(command, str) or command not in OUTPUTS:
        raise UnknownName("command of a job", command, OUTPUTS)
    return field_names(OPTIONS[command])


def check_argv(command: str, argv: Sequence[str]) -> None:
    """Raises `InvalidConfig` unless the command would accept these options."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            tyro.cli(Flat[OPTIONS[command]], args=list(argv))
    except SystemExit:
        words = " ".join(line.strip(" │╭╮╰╯─-") for line in said.getvalue().splitlines()).split(" Argument helptext")[0]
        raise InvalidConfig(f"{command}: {' '.join(words.split())}") from None
    except HoticeError as error:
        raise InvalidConfig(f"{command}: {error}") from None
