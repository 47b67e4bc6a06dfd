"""The battery over DDS: the controller's end, and the robot's for simulated robots."""

from __future__ import annotations

import numpy as np

from hotice.deploy.dds.idl_types import packed_type
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.dds.ports import Reader, Writer
from hotice.deploy.messages.cdr import encode
from hotice.deploy.messages.checks import open_bms
from hotice.deploy.messages.hg import BMS_STATE
from hotice.deploy.messages.invalid import InvalidMessage

TOPIC = "rt/lf/bmsstate"


class DdsBattery:
    """Reads the battery's state."""

    def __init__(self, node: DdsNode) -> None:
        self._reader = Reader(node, TOPIC, packed_type(BMS_STATE))
        self._newest: np.ndarray | None = None
        self.refused = 0
        """Messages that did not open."""

    def charge(self) -> float | None:
        """Charge [percent] of the newest message that opened, None before the first. Raises `LinkError`."""
        for data in self._reader.take():
            try:
                self._newest = open_bms(data)
            except InvalidMessage:
                self.refused += 1
        return None if self._newest is None else float(self._newest["soc"])

    def close(self) -> None:
        self._reader.close()


class DdsBatteryEnd:
    """Publishes the battery of a simulated robot."""

    def __init__(self, node: DdsNode) -> None:
        self._writer = Writer(node, TOPIC, packed_type(BMS_STATE))

    def publish(self, record: np.ndarray) -> None:
        """Sends a BmsState (). Raises `LinkError`."""
        self._writer.write(encode(BMS_STATE, record))

    def close(self) -> None:
        self._writer.close()
