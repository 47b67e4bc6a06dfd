"""Writers and readers of messages as bytes, on one topic each."""

from __future__ import annotations

from typing import Any

from hotice.deploy.dds.cyclone import cyclone
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.link.protocol import LinkError

TAKEN_AT_ONCE = 32


class Writer:
    """Publishes bytes on a topic as the vendor's programs do: reliable, the newest kept."""

    def __init__(self, node: DdsNode, topic: str, data_type: Any) -> None:
        dds, participant = cyclone(), _open(node)
        self._type, self._error = data_type, dds.core.DDSException
        policies = dds.qos.Policy
        qos = dds.qos.Qos(policies.DataRepresentation(use_cdrv0_representation=True))
        self._writer: Any = dds.pub.DataWriter(participant, dds.topic.Topic(participant, topic, data_type), qos=qos)

    def write(self, data: bytes) -> None:
        """A whole message, header included. Raises `LinkError`."""
        if self._writer is None:
            raise LinkError("this link is closed")
        try:
            self._writer.write(self._type(data))
        except self._error as error:
            raise LinkError(f"the message was not sent: {error}") from None

    @property
    def readers(self) -> int:
        """Number of readers known to listen."""
        return self._writer.get_publication_matched_status().current_count

    def close(self) -> None:
        self._writer = None


class Reader:
    """Takes bytes from a topic without waiting; best effort as the vendor's, the newest `depth` kept."""

    def __init__(
        self, node: DdsNode, topic: str, data_type: Any, *, depth: int = 1, foreign_only: bool = False
    ) -> None:
        dds, participant = cyclone(), _open(node)
        self._error = dds.core.DDSException
        policies = dds.qos.Policy
        chosen = [policies.History.KeepLast(depth), policies.Reliability.BestEffort]
        chosen.append(policies.DataRepresentation(use_cdrv0_representation=True))
        if foreign_only:
            chosen.append(policies.IgnoreLocal.Participant)
        topic_ = dds.topic.Topic(participant, topic, data_type)
        self._reader: Any = dds.sub.DataReader(participant, topic_, qos=dds.qos.Qos(*chosen))

    def take(self) -> list[bytes]:
        """Samples since the last call that were not overtaken, oldest first. Raises `LinkError`."""
        if self._reader is None:
            raise LinkError("this link is closed")
        try:
            samples = self._reader.take(N=TAKEN_AT_ONCE)
        except self._error as error:
            raise LinkError(f"messages cannot be taken: {error}") from None
        return [sample.data for sample in samples if sample.sample_info.valid_data]

    @property
    def writers(self) -> int:
        """Number of writers known to send."""
        return self._reader.get_subscription_matched_status().current_count

    def close(self) -> None:
        self._reader = None


def _open(node: DdsNode) -> Any:
    if node.participant is None:
        raise LinkError("the node is closed")
    return node.participant
