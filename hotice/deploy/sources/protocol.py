"""Protocol of a source: the newest valid sample and its age, whatever carried it; and its inbox."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from hotice.deploy.clock import Clock
from hotice.deploy.link.ticks import TickOrder
from hotice.deploy.messages.invalid import InvalidMessage, Reason

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, kw_only=True)
class Received(Generic[T_co]):
    """The newest sample of a source."""

    sample: T_co
    number: int
    """How many samples were taken, this one included; the same number is the same sample."""
    received_s: float
    """When it came, on the reader's clock [s]; where this is not known, the earliest that it can have come."""
    age_s: float
    """Since then [s]: over UDP an upper bound, at least the time between two reads. How long it was on its way is not
    in it, since no sender's clock is trusted."""


@dataclass(frozen=True, kw_only=True)
class SourceCounts:
    """What came from a source since it was opened."""

    taken: int = 0
    repeats: int = 0
    """Samples with the number of the one before."""
    backwards: int = 0
    """Samples with an older number; the fifth of a run is taken: its sender restarted."""
    refused: dict[Reason, int] = field(default_factory=dict)
    """Samples that did not open, by what was wrong."""


class Source(Protocol[T_co]):
    """The reader's end. Not to be shared by threads."""

    def newest(self) -> Received[T_co] | None:
        """The newest valid sample, taken without waiting; None before the first. Raises `LinkError` when closed."""
        ...

    def counts(self) -> SourceCounts: ...

    def close(self) -> None: ...


class Sender(Protocol):
    """The other end: sends samples as bytes."""

    def send(self, data: bytes) -> None: ...


class Numbered(Protocol):
    """A sample that its sender numbered, modulo 2**32."""

    @property
    def number(self) -> int: ...


N = TypeVar("N", bound=Numbered)


class SourceInbox(Generic[N]):
    """Opens, orders and counts what comes; keeps the newest."""

    def __init__(self, clock: Clock, opened: Callable[[bytes], N]) -> None:
        self._clock, self._opened = clock, opened
        self._newest: N | None = None
        self._received_s, self._taken = 0.0, 0
        self._order, self._orders = TickOrder(), Counter[str]()
        self._refused: Counter[Reason] = Counter()

    def offer(self, data: bytes, came_s: float) -> None:
        """Bytes as they came at `came_s` [s]; whatever is wrong with them is counted and they are dropped."""
        try:
            sample = self._opened(data)
        except InvalidMessage as error:
            self._refused[error.reason] += 1
            return
        order = self._order.judge(sample.number)
        self._orders[order] += 1
        if order == "new":
            self._newest, self._received_s = sample, came_s
            self._taken += 1

    def newest(self) -> Received[N] | None:
        if self._newest is None:
            return None
        age_s = self._clock.now() - self._received_s
        return Received(sample=self._newest, number=self._taken, received_s=self._received_s, age_s=age_s)

    def counts(self) -> SourceCounts:
        return SourceCounts(
            taken=self._taken,
            repeats=self._orders["repeat"],
            backwards=self._orders["backwards"],
            refused=dict(self._refused),
        )
