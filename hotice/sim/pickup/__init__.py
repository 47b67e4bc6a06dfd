"""The pick-up task: picks of a book in fine physics, its tables, and the teacher that plays the book back."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.sim.pickup.bank import PickBank
    from hotice.sim.pickup.env import PickUpEnv
    from hotice.sim.pickup.snapshot import PickSnapshot
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["PickBank", "PickSnapshot", "PickUpEnv"]
