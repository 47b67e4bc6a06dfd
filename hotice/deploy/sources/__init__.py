"""Inputs beside the robot's own messages: poses of localization and of what moves, corners of tags; checked records."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.sources.memory import MemorySource
    from hotice.deploy.sources.protocol import Received, Sender, Source, SourceCounts
    from hotice.deploy.sources.records import MoverSample, PoseSample, TagSample
    from hotice.deploy.sources.udp import UdpSender, UdpSource
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "MemorySource",
    "MoverSample",
    "PoseSample",
    "Received",
    "Sender",
    "Source",
    "SourceCounts",
    "TagSample",
    "UdpSender",
    "UdpSource",
]
