"""A live page on this machine alone: the page, and frames as server-sent events, the newest for each reader."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from hotice.errors import HoticeError

LOOPBACK = "127.0.0.1"
EVENTS = "events"
WAIT_S, WRITE_S = 1.0, 5.0
"""A reader hears something at least so often; one that takes nothing for so long is left [s]."""
MOST_READERS = 8


class Newest:
    """The newest frame as text; readers wait for one that they have not had, and miss what they are too slow for."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number, self._text, self.over = 0, "", False

    def put(self, frame: dict[str, Any]) -> None:
        """Makes a frame the newest."""
        text = json.dumps(frame, separators=(",", ":"), allow_nan=False)
        with self._changed:
            self._number, self._text = self._number + 1, text
            self._changed.notify_all()

    def end(self) -> None:
        """No more will come."""
        with self._changed:
            self.over = True
            self._changed.notify_all()

    def after(self, number: int, timeout_s: float) -> tuple[int, str | None]:
        """The newest and its number; None where there was none beyond `number` in time, or it is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._number > number or self.over, timeout_s)
            return (self._number, self._text) if self._number > number else (number, None)


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
