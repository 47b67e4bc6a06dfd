"""What a model can do without learning: whole-body control, picking an object up, walking with it.

Importing this package costs numpy only; Pinocchio, CasADi and the QP solvers are imported where they are used.
"""

from hotice.control.controller import Command, Controller, Measurement

__all__ = ["Command", "Controller", "Measurement"]
