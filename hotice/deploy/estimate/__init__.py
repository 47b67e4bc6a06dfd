"""The estimator: from a robot's own state, localization and the tags on its box to what a policy reads.

Root, gravity and object are tracked by the functions that students are trained with (`hotice.policy.measuring`).
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.estimate.box import TaggedBox
    from hotice.deploy.estimate.pelvis import LidarPelvis
    from hotice.deploy.estimate.seen import SeenPose
    from hotice.deploy.estimate.tracking import TrackingEstimator
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["LidarPelvis", "SeenPose", "TaggedBox", "TrackingEstimator"]
