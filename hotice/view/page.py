"""The page's own part: a panel to steer by, beside the viewer of replay pages."""

from __future__ import annotations

from importlib.resources import files

from hotice.replay.html import Steering
from hotice.view.session import Session

TITLE = "hotice live view"


def steering_of(session: Session, orders: str) -> Steering:
    """The panel for a session; `orders`: path to which the page sends them."""
    folder = files("hotice.view")
    html, css, js = ((folder / f"steer.{kind}").read_text(encoding="utf-8") for kind in ("html", "css", "js"))
    low, high = session.scene.bounds_m
    facts = {
        "orders": orders,
        "obstacles": [obstacle.name for obstacle in session.scene.obstacles],
        "policies": list(session.known.policies),
        "low": low,
        "high": high,
    }
    return Steering(title=TITLE, html=html, css=css, js=js, facts=facts)
