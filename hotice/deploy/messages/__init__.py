"""The robot's own messages as NumPy records and as bytes on the wire. No network here."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.messages.checks import open_bms, open_imu, open_low_cmd, open_low_state, seal
    from hotice.deploy.messages.hg import JOINTS, LOW_CMD, LOW_STATE
    from hotice.deploy.messages.invalid import InvalidMessage
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "InvalidMessage",
    "JOINTS",
    "LOW_CMD",
    "LOW_STATE",
    "open_bms",
    "open_imu",
    "open_low_cmd",
    "open_low_state",
    "seal",
]
