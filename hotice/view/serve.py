"""A session in real time, with its page for the browsers of this machine."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

from hotice.replay.html import live_page
from hotice.replay.serving import EVENTS, LiveServer, Newest, Taker
from hotice.view.frames import Painter
from hotice.view.orders import MOST_BYTES, read_order
from hotice.view.page import steering_of
from hotice.view.session import Session

CALM_STEPS = 10
"""Control steps after which a frame is sent though nothing has changed: the page sees that somebody is there."""
SLIP_S = 0.2
"""So much is made up for by steps without pauses; of more, time slips: the robot lives slower than the world."""
PACE_S = 1.0
"""Over which the pace is measured [s]."""
ORDERS = "orders"


def serve(session: Session, *, port: int, say: Callable[[str], None]) -> None:
    """Shows a session until it is interrupted; the robot begins to walk when the first page looks.

    Raises `HoticeError`: the port is taken; the process that builds fields has ended.
    """
    newest, painter = Newest(), Painter(session)
    newest.put(painter.frame())
    page = live_page(painter.first(), EVENTS, steering_of(session, ORDERS))
    taker = Taker(path=ORDERS, most_bytes=MOST_BYTES, take=lambda text: session.order(read_order(text, session.known)))
    with LiveServer(page, newest, port=port, taker=taker) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        say(f"live view: {server.url} (Ctrl-C ends)")
        try:
            while not server.looked_at.wait(0.5):
                pass
            _live(session, painter, newest)
        finally:
            newest.end()
            server.shutdown()


def _live(session: Session, painter: Painter, newest: Newest) -> None:
    due_s = looked_s = time.monotonic()
    calm = lived = 0
    shown: dict[str, Any] = {}
    while True:
        session.tick()
        lived, frame = lived + 1, painter.frame()
        calm = calm + 1 if frame == shown else 0
        if calm % CALM_STEPS == 0:
            newest.put(shown := frame)
        period_s, now_s = session.walk.task.control_dt_s, time.monotonic()
        if now_s - looked_s >= PACE_S:
            painter.pace, looked_s, lived = min(1.0, lived * period_s / (now_s - looked_s)), now_s, 0
        due_s += period_s
        if now_s - due_s > SLIP_S:
            due_s = now_s
        time.sleep(max(0.0, due_s - now_s))
