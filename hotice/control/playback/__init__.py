"""Pick-ups as position targets: made from a plan without forces, played back at 50 Hz with a balance of their own."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.playback.course import PLAYED, plan_book
    from hotice.control.playback.player import Player
    from hotice.control.playback.statics import static_torque
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["PLAYED", "Player", "plan_book", "static_torque"]
