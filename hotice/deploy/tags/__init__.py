"""AprilTags on a box: where they are, how they are printed, found in pictures and solved for the box's pose.

OpenCV comes with the extra `deploy` and is imported when it is first needed.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.tags.box_pose import BoxPoseConfig, BoxPoser, BoxSighting
    from hotice.deploy.tags.bundle import TagBundle, TagFace, box_bundle
    from hotice.deploy.tags.cameras import BrokenFrame, FolderCamera, Frame, FrameSource
    from hotice.deploy.tags.detector import Detection, TagDetector
    from hotice.deploy.tags.realsense import RealSenseCamera
    from hotice.deploy.tags.sheet import write_sheets
    from hotice.deploy.tags.tag_box import TagBox
    from hotice.deploy.tags.watch import Watched, watch_tags
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "BoxPoseConfig",
    "BoxPoser",
    "BoxSighting",
    "BrokenFrame",
    "Detection",
    "FolderCamera",
    "Frame",
    "FrameSource",
    "RealSenseCamera",
    "TagBox",
    "TagBundle",
    "TagDetector",
    "TagFace",
    "Watched",
    "box_bundle",
    "watch_tags",
    "write_sheets",
]
