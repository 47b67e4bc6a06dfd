"""The process of `hotice.commands.live.watch_child`. Arguments: folder of the run, port; prints the page's address."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

from hotice.commands.live.watch import watch
from hotice.commands.live.watch_config import WatchConfig
from hotice.commands.program import guarded


def main() -> int:
    """Exit status of a page that is served until standard input ends, as it does when who started this has gone."""
    ended = threading.Event()

    def end_with_parent() -> None:
        sys.stdin.buffer.read()
        ended.set()

    threading.Thread(target=end_with_parent, daemon=True).start()
    run, port = sys.argv[1:]
    return guarded(lambda: _serve(WatchConfig(run=Path(run), port=int(port), wait=True), ended))


def _serve(config: WatchConfig, ended: threading.Event) -> int:
    watch(config, lambda url: print(url, flush=True), ended)
    return 0


if __name__ == "__main__":
    sys.exit(main())
