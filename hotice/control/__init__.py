"""Control by a model, without learning: whole-body control, picking an object up, walking with it.

Importing this package costs numpy only; Pinocchio, CasADi and the QP solvers are imported where they are used.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.controller import Command, Controller, Measurement
    from hotice.control.plant import TorquePlant
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Command", "Controller", "Measurement", "TorquePlant"]
