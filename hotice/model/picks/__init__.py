"""Picks as position targets over time, for planners, teachers, a playback and students."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.model.picks.book import BOOK_PHASES, PickBook, balance, balance_gains
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["BOOK_PHASES", "PickBook", "balance", "balance_gains"]
