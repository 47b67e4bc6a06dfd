"""`hotice watch` beside a training of this process: another process, which ends with it."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from hotice.errors import HoticeError

END_S = 2.0


@contextlib.contextmanager
def watching(run: Path, port: int) -> Iterator[str]:
    """The address of the page of a run that begins within the context. Raises `HoticeError`: it cannot be served."""
    command = [sys.executable, "-m", "hotice.commands.live.watch_process", str(run), str(port)]
    # a Ctrl-C at the terminal is for the training; who reads our end knows when this process has gone
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stdin is not None and process.stdout is not None
    try:
        url = process.stdout.readline().strip()
        if not url:
            raise HoticeError("the live page ended before it was ready: see the line above, or leave view out")
        yield url
    finally:
        process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(END_S)
        # in the midst of a walk it would not hear
        process.kill()
        process.wait()
        process.stdout.close()
