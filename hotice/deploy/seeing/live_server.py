"""The live page's process: `python -m hotice.deploy.seeing.live_server DESCRIPTOR HOST PORT`, started by `LiveView`.

Standard input holds what the run is about as JSON; moments come over the socket DESCRIPTOR, whose end is the end. The
first line of standard output says {"url": …} or {"error": …}.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from hotice.deploy.seeing.live_frames import Newest, Painter
from hotice.deploy.seeing.moments import MOMENT
from hotice.documents import parse_json
from hotice.errors import HoticeError
from hotice.replay.html import live_page

LOOPBACK = "127.0.0.1"
EVENTS = "events"
WAIT_S, WRITE_S = 1.0, 5.0
"""A reader hears something at least so often; one that takes nothing for so long is left [s]."""
MOST_READERS = 8


class LiveServer(ThreadingHTTPServer):
    """Serves the page at / and frames at /events. Raises `HoticeError` where the port is taken."""

    daemon_threads = True

    def __init__(self, page: str, newest: Newest, host: str = LOOPBACK, port: int = 0) -> None:
        self.page, self.newest = page.encode(), newest
        self.readers = threading.BoundedSemaphore(MOST_READERS)
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            raise HoticeError(
                f"{host}:{port} cannot be used for the live page: {error.strerror or error}; choose another port, or 0"
            ) from None

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server_address[0]}:{self.server_address[1]}/"

    def named(self, host: str | None) -> bool:
        """Whether a request's Host is this server: on loopback a page of another name must not read it."""
        if self.server_address[0] != LOOPBACK:
            return True
        port = self.server_address[1]
        return host in (f"{LOOPBACK}:{port}", f"localhost:{port}")


class _Handler(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = WRITE_S

    def do_GET(self) -> None:
        if not self.server.named(self.headers.get("Host")):
            self.send_error(403, "another host's name")
        elif self.path == "/":
            self._head("text/html; charset=utf-8", {"Content-Length": str(len(self.server.page))})
            self.wfile.write(self.server.page)
        elif self.path == f"/{EVENTS}":
            self._serve_frames()
        else:
            self.send_error(404)

    def _serve_frames(self) -> None:
        if not self.server.readers.acquire(blocking=False):
            self.send_error(503, f"{MOST_READERS} pages look at it already")
            return
        try:
            self._head("text/event-stream", {})
            number, newest = 0, self.server.newest
            while True:
                number, text = newest.after(number, WAIT_S)
                if text is None and newest.over:
                    self.wfile.write(b"event: over\ndata: {}\n\n")
                    return
                # a comment, so that one who has gone is noticed
                self.wfile.write(b":\n\n" if text is None else f"data: {text}\n\n".encode())
        except (ConnectionError, TimeoutError):
            self.close_connection = True
        finally:
            self.server.readers.release()

    def _head(self, kind: str, more: dict[str, str]) -> None:
        self.send_response(200)
        fixed = {"Content-Type": kind, "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        for name, value in (fixed | {"X-Frame-Options": "DENY"} | more).items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


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
