"""Records of rollouts, as arrays, a self-contained web page, and pictures."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.replay.events import RolloutEvent
    from hotice.replay.explorer import field_explorer
    from hotice.replay.html import write_html
    from hotice.replay.import_picture import write_import_picture
    from hotice.replay.maps import draw_map
    from hotice.replay.picture import film_strip, write_overview
    from hotice.replay.rollout import RolloutRecord
    from hotice.replay.scene_view import scene_page
    from hotice.replay.shown import InvalidRollout
    from hotice.replay.slices import draw_descent, draw_slice
    from hotice.replay.video import write_video
    from hotice.task.rules import OUTCOMES
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "InvalidRollout",
    "OUTCOMES",
    "RolloutEvent",
    "RolloutRecord",
    "draw_descent",
    "draw_map",
    "draw_slice",
    "field_explorer",
    "film_strip",
    "scene_page",
    "write_html",
    "write_import_picture",
    "write_overview",
    "write_video",
]
