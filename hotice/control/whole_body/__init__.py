"""Whole-body control: dynamics terms, tasks, contacts and the quadratic program that weighs them."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.control.whole_body.contacts import Contacts
    from hotice.control.whole_body.qp import QpConfig, QpMemory, WholeBodyQp
    from hotice.control.whole_body.solvers import SOLVERS, Solver
    from hotice.control.whole_body.tasks import Targets
    from hotice.control.whole_body.terms import FRAMES, Terms
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Contacts", "FRAMES", "QpConfig", "QpMemory", "SOLVERS", "Solver", "Targets", "Terms", "WholeBodyQp"]
