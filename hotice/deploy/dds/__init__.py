"""The link over DDS (Cyclone 11, extra `deploy`). Only modules of this folder import cyclonedds, where they use it."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.dds.battery import DdsBattery
    from hotice.deploy.dds.link import DdsLink, DdsRobot
    from hotice.deploy.dds.node import DdsNode
    from hotice.deploy.dds.service import DdsService
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["DdsBattery", "DdsLink", "DdsNode", "DdsRobot", "DdsService"]
