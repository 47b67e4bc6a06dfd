"""The runner: 50 times a second from what is sensed to joint targets in the guard's slot, by a trained policy.

Everything heavy is here, and may stall or die: the guard brakes then.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.runner.estimator import Estimate, Estimator
    from hotice.deploy.runner.runner import RobotRunner
    from hotice.policy.carry_policy import CarryPolicy
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["CarryPolicy", "Estimate", "Estimator", "RobotRunner"]
