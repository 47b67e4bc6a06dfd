"""Picking an object up from a support: a phase machine over the whole-body QP.

settle -> crouch -> reach -> close -> squeeze -> lift (-> back, where the support is in the way) -> retreat (-> depart)
-> hold. A missed grasp opens the hands, plans anew and tries again. What cannot be mended ends in `abort`: hands off,
back to standing. The robot may stand anywhere: all is planned and done in G, the frame of its feet at the start
(`stance`).
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.pickup.config import PickupConfig
    from hotice.control.pickup.controller import Pickup
    from hotice.control.pickup.end_state import carry_at_end
    from hotice.control.pickup.footwork import Departure
    from hotice.control.pickup.memory import PickupMemory
    from hotice.control.pickup.phases import PHASES
    from hotice.control.pickup.stance import Stance
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Departure", "PHASES", "Pickup", "PickupConfig", "PickupMemory", "Stance", "carry_at_end"]
