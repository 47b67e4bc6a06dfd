"""What moves, beside the fields of what stands still: distances, and fields of the moment."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.fields.moving.momentary import MomentaryPf, momentary_pf
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["MomentaryPf", "momentary_pf"]
