"""A check of a robot before it moves: what it sends is observed for some seconds and held against what is needed."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.checkup.joint_order import joint_rows
    from hotice.deploy.checkup.rows import Row, all_rows
    from hotice.deploy.checkup.watch import Observed, watch_robot
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["Observed", "Row", "all_rows", "joint_rows", "watch_robot"]
