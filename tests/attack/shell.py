"""A shell for attacks: runs command lines in a worker process and says what they did."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from hotice.caches import cache_root

LIMIT_S = 180.0
"""A line that takes longer waits for something; how long it may compute: `worker.CPU_S`."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a command line did. status: exit status; None: it hung or its process died. left: paths that are new."""

    status: int | None
    out: str
    err: str
    left: tuple[str, ...]

    def faults(self, allowed: tuple[int, ...] = (2,)) -> list[str]:
        """All that is wrong with it: another status, a traceback, more or less than one message, files left."""
        lines = [line for line in self.err.splitlines() if line.strip()]
        one = len(lines) == 1 and lines[0].startswith("hotice: ")
        box = bool(lines) and lines[0].startswith("╭─") and lines[-1].startswith("╰─")
        wrong = {
            f"status {self.status}": self.status not in allowed,
            "a traceback": "Traceback" in self.err + self.out,
            f"{len(lines)} lines": self.status not in (None, 0, 1) and not one and not box,
            "memory ran out": "out of memory" in self.err,
            f"left {', '.join(self.left)}": self.status != 0 and bool(self.left),
        }
        return [what for what, found in wrong.items() if found]


class Shell:
    """Worker that is started when it is first needed, and again when it died. `folder`: its own, for what it writes."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.process = folder, None
        self.temporary = folder / "temporary"
        self.temporary.mkdir(parents=True)

    def __call__(self, argv: list[str], cwd: Path, limit_s: float = LIMIT_S) -> Outcome:
        if self.process is None:
            self._start()
        before = self._files(cwd)
        request = {"argv": argv, "cwd": str(cwd), "limit_s": limit_s}
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        left = tuple(sorted(self._files(cwd) - before))
        if answer:
            return Outcome(**json.loads(answer), left=left)
        self.close()
        said = {name: (self.folder / name).read_text(errors="replace") for name in ("out", "err")}
        return Outcome(status=None, **said, left=left)

    def close(self) -> None:
        """Ends the worker."""
        if self.process is not None:
            self.process.stdin.close()
            self.process.wait(30)
            self.process.stdout.close()
            self.process = None

    def _start(self) -> None:
        environment = {
            **os.environ,
            "TMPDIR": str(self.temporary),
            "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR") or str(cache_root().parent),
            "HOTICE_CACHE": str(self.folder / "cache"),
            "OMP_NUM_THREADS": "1",
            "COLUMNS": "200",
        }
        self.process = subprocess.Popen(
            [
                sys.executable,
                str(Path(__file__).with_name("worker.py")),
                str(self.folder / "out"),
                str(self.folder / "err"),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )

    def _files(self, cwd: Path) -> set[str]:
        return {str(path) for folder in (cwd, self.temporary) for path in folder.rglob("*")}
