"""The live page's process: `python -m hotice.deploy.seeing.live_server DESCRIPTOR HOST PORT`, started by `LiveView`.

Standard input holds what the run is about as JSON; moments come over the socket DESCRIPTOR, whose end is the end. The
first line of standard output says {"url": …} or {"error": …}.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
from typing import Any

import numpy as np

from hotice.deploy.seeing.live_frames import Painter
from hotice.deploy.seeing.moments import MOMENT
from hotice.documents import parse_json
from hotice.errors import HoticeError
from hotice.replay.html import live_page
from hotice.replay.serving import EVENTS, LiveServer, Newest


def receive(source: socket.socket, painter: Painter, newest: Newest) -> None:
    """Moments to frames until the other end closes; of several that wait the last is drawn."""
    while data := source.recv(MOMENT.itemsize):
        try:
            while more := source.recv(MOMENT.itemsize, socket.MSG_DONTWAIT):
                data = more
        except BlockingIOError:
            pass
        newest.put(painter.frame(np.frombuffer(data, MOMENT)[0]))
    newest.end()


def main(argv: list[str]) -> int:
    """Serves until the runner has gone."""
    source, host, port = socket.socket(fileno=int(argv[0])), argv[1], int(argv[2])
    newest = Newest()
    try:
        painter = Painter(_mapping(parse_json("what the run is about", sys.stdin.buffer.read())))
        server = LiveServer(live_page(painter.first(), EVENTS), newest, host, port)
    except HoticeError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        return 2
    print(json.dumps({"url": server.url}), flush=True)
    serving = threading.Thread(target=server.serve_forever, daemon=True)
    serving.start()
    receive(source, painter, newest)
    server.shutdown()
    return 0


def _mapping(said: Any) -> dict[str, Any]:
    wanted = ("scene", "meshes", "carried", "policy", "task")
    if not isinstance(said, dict) or any(name not in said for name in wanted):
        raise HoticeError(f"what the run is about has to say {', '.join(wanted)}")
    return said


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
