"""The runner's log: all that it read at each tick, and all that it made of it; enough to do it again, bit for bit."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import numpy as np

from hotice.deploy.clock import Clock
from hotice.deploy.log.writer import LogWriter
from hotice.deploy.runner.runner import RobotRunner
from hotice.deploy.slot.records import STATUS, TARGETS
from hotice.deploy.sources.protocol import Received, Source, SourceCounts
from hotice.deploy.sources.records import MOVERS, POSE, TAGS
from hotice.model.g1 import ACTIONS
from hotice.model.scene import MAX_MOVING
from hotice.policy import PolicySession
from hotice.policy.percept import Percept

T = TypeVar("T")


def received_type(sample: np.dtype) -> np.dtype:
    """Type of a sample as its source gave it: its bytes, how many were taken, and when it came [s]."""
    return np.dtype([("number", "<u8"), ("received_s", "<f8"), ("sample", sample)])


ESTIMATE = np.dtype([("percept", "<f8", Percept.SIZE), ("pose_age_s", "<f8"), ("box_age_s", "<f8"), ("disputed", "u1")])


WAYS = np.dtype([("measured_s", "<f8"), ("count", "<u4"), ("poses", "<f8", (MAX_MOVING, 7))])
"""Ways that a tick went by for the first time: those among movers at these poses in W, seen then [s]."""


def kinds(observation: int, moving: bool = False) -> dict[str, np.dtype | None]:
    """Kinds of entries, each with the time of its tick.

    Args:
        observation: `width` of what the policy reads.
        moving: whether something moves in the scene.
    """
    about_movers: dict[str, np.dtype | None] = {"movers": received_type(MOVERS), "ways": WAYS}
    return (about_movers if moving else {}) | {
        "status": STATUS,
        "pose": received_type(POSE),
        "tags": received_type(TAGS),
        "estimate": ESTIMATE,
        "observation": np.dtype([("values", "<f4", (observation,))]),
        "action": np.dtype([("values", "<f8", (ACTIONS,))]),
        "targets": TARGETS,
    }


def width(policy: PolicySession) -> int:
    """Numbers that a policy reads."""
    return sum(count for _, count in policy.layout)


class RunnerLog:
    """Stands between a runner and all that it reads and writes; make the runner of these, then `after` each tick."""

    def __init__(self, log: LogWriter, clock: Clock) -> None:
        self._log, self._clock = log, clock
        self._tick_s, self._ways_s = 0.0, -np.inf

    def now(self) -> float:
        """A clock's: the time of the tick, which the runner asks for once. See `Clock`."""
        self._tick_s = self._clock.now()
        return self._tick_s

    def sleep(self, seconds: float) -> None:
        """See `Clock`."""
        self._clock.sleep(seconds)

    def status_of(self, read: Any) -> Any:
        """Reads the guard's status, logged."""

        def logged() -> np.ndarray | None:
            status = read()
            if status is not None:
                self._log.write("status", self._tick_s, status)
            return status

        return logged

    def put_of(self, put: Any) -> Any:
        """Puts targets, logged."""

        def logged(targets: np.ndarray) -> None:
            put(targets)
            self._log.write("targets", self._tick_s, targets)

        return logged

    def source(self, name: str, source: Source[T]) -> LoggedSource[T]:
        """A source ("pose", "tags" or "movers"), logged."""
        return LoggedSource(name, source, self)

    def take(self, name: str, received: Received[Any]) -> None:
        """Logs a new sample."""
        dtype = self._log.kinds[name]
        assert dtype is not None and dtype.names is not None
        entry = np.zeros((), dtype)
        entry["number"], entry["received_s"] = received.number, received.received_s
        entry["sample"] = np.frombuffer(received.sample.encode(), dtype["sample"])[0]
        self._log.write(name, self._tick_s, entry)

    def after(self, runner: RobotRunner) -> None:
        """Logs what the tick made."""
        estimate, policy, built = runner.estimate, runner.policy, runner.around and runner.around.built
        if built and built.measured_s != self._ways_s:
            self._ways_s = built.measured_s
            entry = np.zeros((), WAYS)
            entry["measured_s"], entry["count"] = built.measured_s, len(built.poses)
            entry["poses"][: len(built.poses)] = built.poses
            self._log.write("ways", self._tick_s, entry)
        if estimate is not None:
            entry = np.zeros((), ESTIMATE)
            entry["percept"], entry["disputed"] = estimate.percept.vector, estimate.disputed
            entry["pose_age_s"], entry["box_age_s"] = estimate.pose_age_s, estimate.box_age_s
            self._log.write("estimate", self._tick_s, entry)
        if runner.acted and policy.observation is not None:
            self._log.write("observation", self._tick_s, policy.observation)
            self._log.write("action", self._tick_s, policy.action)


class LoggedSource(Generic[T]):
    """See `Source`; each sample is logged once."""

    def __init__(self, name: str, source: Source[T], log: RunnerLog) -> None:
        self._name, self._source, self._log = name, source, log
        self._number = 0

    def newest(self) -> Received[T] | None:
        received = self._source.newest()
        if received is not None and received.number != self._number:
            self._number = received.number
            self._log.take(self._name, received)
        return received

    def counts(self) -> SourceCounts:
        return self._source.counts()

    def close(self) -> None:
        self._source.close()
