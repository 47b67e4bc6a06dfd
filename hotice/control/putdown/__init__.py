"""Putting an object down on a support: a pick-up's plan run backwards, over the whole-body QP.

catch -> settle (-> approach) -> raise (-> ahead, where the support was in the way) -> adjust -> lower -> unload ->
let_go -> open -> withdraw -> rise -> done. The robot stands, or marches on the spot, anywhere near with the object in
its hands; feet that are not where the plan has them step there. What goes wrong before the object stands ends in
`abort`: hands off, standing.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.putdown.config import PutDownConfig
    from hotice.control.putdown.controller import PutDown
    from hotice.control.putdown.phases import PUT_DOWN_PHASES
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["PUT_DOWN_PHASES", "PutDown", "PutDownConfig"]
