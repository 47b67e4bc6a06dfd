"""AprilTags on a box: where they are, how they are printed, found in pictures and solved for the box's pose.

OpenCV comes with the extra `deploy`; bundle, verdicts and sources of pictures in a folder of arrays need NumPy alone.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.tags.box_pose import BoxPoseConfig, BoxPoser, BoxSighting
    from hotice.deploy.tags.bundle import TagBundle, TagFace, box_bundle
    from hotice.deploy.tags.detector import Detection, TagDetector
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["BoxPoseConfig", "BoxPoser", "BoxSighting", "Detection", "TagBundle", "TagDetector", "TagFace", "box_bundle"]
