"""`hotice watch` beside a training of this process: another process, which ends with it."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from hotice.errors import HoticeError

END_S = 2.0


@contextlib.contextmanager
def watching(run: Path, port: int) -> Iterator[str]:
    """The address of the page of a run that begins within the context. Raises `HoticeError`: it cannot be served."""
    command = [sys.executable, "-m", "hotice.commands.live.watch_child", str(run), str(port)]
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


def main() -> int:
    """The other process. Arguments: folder of the run, port."""
    from hotice.commands.live.watch import watch
    from hotice.commands.live.watch_config import WatchConfig
    from hotice.commands.program import guarded

    ended = threading.Event()

    def end_with_parent() -> None:
        sys.stdin.buffer.read()
        ended.set()

    threading.Thread(target=end_with_parent, daemon=True).start()
    run, port = sys.argv[1:]
    config = WatchConfig(run=Path(run), port=int(port), wait=True)
    return guarded(lambda: watch(config, lambda url: print(url, flush=True), ended) or 0)


if __name__ == "__main__":
    sys.exit(main())
