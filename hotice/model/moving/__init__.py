"""Obstacles that move: their motions, and a walking person."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.model.moving.motion import Motion, WayPoint
    from hotice.model.moving.occupancy import Occupancy, OccupancyConfig
    from hotice.model.moving.person import walking_person
    from hotice.model.moving.still import only_still
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Motion", "Occupancy", "OccupancyConfig", "WayPoint", "only_still", "walking_person"]
