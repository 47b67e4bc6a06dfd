"""A live page on this machine alone: the page, and frames as server-sent events, the newest for each reader."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
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


@dataclass(frozen=True, kw_only=True)
class Taker:
    """What takes orders from the page.

    `path`: to which it sends them; `most_bytes`: of one; `take` may be called by several threads at once, and raises
    `HoticeError` with what is told to whoever sent it.
    """

    path: str
    most_bytes: int
    take: Callable[[bytes], None]


class LiveServer(ThreadingHTTPServer):
    """Serves the page at / and frames at /events. Raises `HoticeError` where the port is taken.

    `taker`: takes orders, but only from the page itself; `looked_at`: set when the first page looks.
    """

    daemon_threads = True

    def __init__(
        self, page: str, newest: Newest, host: str = LOOPBACK, port: int = 0, taker: Taker | None = None
    ) -> None:
        self.page, self.newest, self.taker, self.looked_at = page.encode(), newest, taker, threading.Event()
        self.readers = threading.BoundedSemaphore(MOST_READERS)
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            raise HoticeError(
                f"{host}:{port} cannot be used for the live page: {error.strerror or error}; choose another port, or 0"
            ) from None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Says nothing of readers that have gone: a page may be left at any time."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

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

    def do_POST(self) -> None:
        taker, host, length = self.server.taker, self.headers.get("Host"), self.headers.get("Content-Length", "")
        if not self.server.named(host) or self.headers.get("Origin") != f"http://{host}":
            # browsers say of every order which page it is from: that of another site may send them, too
            self.send_error(403, "orders are taken from this page alone")
        elif taker is None or self.path != f"/{taker.path}":
            self.send_error(404)
        elif self.headers.get("Content-Type") != "application/json":
            self.send_error(415, "an order is application/json")
        elif not (length.isascii() and length.isdecimal() and len(length) < 10 and int(length) <= taker.most_bytes):
            self.send_error(413, f"an order has at most {taker.most_bytes} bytes")
        else:
            self._take(taker, int(length))

    def _take(self, taker: Taker, length: int) -> None:
        answer, status = {}, 200
        try:
            taker.take(self.rfile.read(length))
        except HoticeError as error:
            answer, status = {"error": str(error)}, 400
        except (ConnectionError, TimeoutError):
            self.close_connection = True
            return
        body = json.dumps(answer).encode()
        self._head("application/json", {"Content-Length": str(len(body))}, status)
        self.wfile.write(body)

    def _serve_frames(self) -> None:
        if not self.server.readers.acquire(blocking=False):
            self.send_error(503, f"{MOST_READERS} pages look at it already")
            return
        try:
            self.server.looked_at.set()
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

    def _head(self, kind: str, more: dict[str, str], status: int = 200) -> None:
        self.send_response(status)
        fixed = {"Content-Type": kind, "Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        for name, value in (fixed | {"X-Frame-Options": "DENY"} | more).items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass
