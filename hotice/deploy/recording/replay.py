"""Replay of a runner's log: from the same messages the same targets, bit for bit, or where they differ first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from hotice.deploy.log.reader import Log, read_log
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.programs.prepare import Prepared, around_of, estimator_of, prepare
from hotice.deploy.recording.runner_log import kinds, width
from hotice.deploy.runner.runner import RobotRunner
from hotice.deploy.runner.ways import ToldWays
from hotice.deploy.sources.protocol import Received, SourceCounts
from hotice.deploy.sources.records import MoverSample, PoseSample, TagSample
from hotice.errors import InputError
from hotice.model.scene_digest import scene_digest
from hotice.policy import PolicyTask
from hotice.policy.action import next_action

T = TypeVar("T")
NAME = "runner"
"""Name of the runner's log."""


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """What came of a replay."""

    actions: int
    """Times that the policy acted."""
    actions_equal: int
    """Actions that the same observation gave again, bit for bit."""
    ticks: int
    """Targets that were to be made again from the messages; 0 for a ring whose beginning is gone."""
    ticks_equal: int
    """Targets that were made again, bit for bit."""
    first_difference_s: float | None
    """Time of the first that were not, or that the runner did not make, on the runner's clock [s]."""

    @property
    def same(self) -> bool:
        """Whether everything that was tried came out again."""
        equal = (self.actions_equal, self.ticks_equal) == (self.actions, self.ticks)
        return equal and self.first_difference_s is None


def replay_log(folder: str | Path, say: Callable[[str], None] = lambda text: None) -> Replayed:
    """Does again what a runner did. `say` is told what goes on.

    Raises:
        HoticeError: no such log, one with nothing to compare, or its policy, scene or version is another one now
    """
    log = read_log(folder, NAME)
    if log.torn_bytes:
        say(f"{log.torn_bytes} bytes of the log hold no whole entry and are left out: torn at its end, or damaged")
    options, made = prepared_again(log, folder, say)
    observations, actions = (log.entries[kind].records["values"] for kind in ("observation", "action"))
    limit = PolicyTask.from_meta(made.policy.meta, made.policy.name).action_limit
    equal = 0
    for observation, action in zip(observations, actions, strict=False):
        raw = made.policy.run(observation[None])[0].astype(float)
        equal += next_action(raw, limit).tobytes() == action.tobytes()
    ticks, same, when = (0, 0, None) if log.first_segment else _ticks(log, options, made)
    if not len(actions) and not ticks and when is None:
        raise InputError(
            f"{folder}: the log has nothing that can be made again: no actions, and no targets from its start"
        )
    return Replayed(actions=len(actions), actions_equal=equal, ticks=ticks, ticks_equal=same, first_difference_s=when)


def prepared_again(log: Log, folder: str | Path, say: Callable[[str], None]) -> tuple[RunnerOptions, Prepared]:
    """Options of a runner's log in a folder, and what was prepared for it; `say` is told what goes on.

    Raises:
        HoticeError: its policy, scene or version is another one now
    """
    try:
        options = RunnerOptions.of(log.about["options"])
        then = {what: log.about[what] for what in ("policy", "scene")}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder}: the log does not say what was run: {error!r}") from None
    made = prepare(options, say)
    for what, digest in digests(made).items():
        if then[what] != digest:
            raise InputError(f"{folder}: the {what} is another one than when the log was written")
    if dict(log.kinds) != kinds(width(made.policy), bool(made.moving)):
        raise InputError(f"{folder}: the log is of another version of hotice")
    return options, made


def digests(made: Prepared) -> dict[str, str]:
    """Fingerprints of policy and scene."""
    return {"policy": str(made.policy.meta["sha256"]), "scene": scene_digest(made.scene)}


def _ticks(log: Log, options: RunnerOptions, made: Prepared) -> tuple[int, int, float | None]:
    """Targets in the log, how many of them come out the same, and the time of the first that do not."""
    clock, poses, tags = _ToldClock(), _Told(PoseSample.decode), _Told(TagSample.decode)
    again = AroundAgain(log, options, made)
    status: list[np.ndarray] = []
    put: list[np.ndarray] = []
    estimator = estimator_of(made, poses, tags, options.pose_latency_s, options.tags_latency_s)
    runner = RobotRunner(
        made.policy,
        made.pf,
        made.carry,
        estimator,
        lambda: status[-1],
        lambda t: put.append(t.copy()),
        clock,
        again.around,
    )
    runner.warm()
    told = {source: _by_time(log, name) for source, name in ((poses, "pose"), (tags, "tags"))}
    targets = _by_time(log, "targets")
    same, first = 0, None
    for time_s, record in zip(*log.entries["status"], strict=True):
        status[:], put[:] = [record], []
        clock.time_s = float(time_s)
        for source, entries in told.items():
            if (entry := entries.get(time_s)) is not None:
                source.tell(entry)
        again.tell(time_s)
        runner.tick()
        logged = targets.get(time_s)
        if (logged is None) == (not put) and (logged is None or logged.tobytes() == put[0].tobytes()):
            same += logged is not None
        elif first is None:
            first = float(time_s)
    return len(targets), same, first


def _by_time(log: Log, kind: str) -> dict[float, Any]:
    times, records = log.entries[kind]
    return dict(zip(times.tolist(), records, strict=True))


class AroundAgain:
    """What moved about a runner, told again from its log; `around`: for the runner, None where nothing moves."""

    def __init__(self, log: Log, options: RunnerOptions, made: Prepared) -> None:
        self._movers, self._ways = _Told(MoverSample.decode), ToldWays(made.pf, made.moving)
        self.around = around_of(made, self._movers, self._ways if options.moving == "live" else None)
        self._samples, self._built = (_by_time(log, kind) if made.moving else {} for kind in ("movers", "ways"))

    @property
    def times_s(self) -> list[float]:
        """When something came [s], growing."""
        return sorted({*self._samples, *self._built})

    def tell(self, time_s: float) -> None:
        """What came with the tick of this time [s]; then `Around.look` is the tick's."""
        if (entry := self._samples.get(time_s)) is not None:
            self._movers.tell(entry)
        if (entry := self._built.get(time_s)) is not None:
            self._ways.tell(entry["poses"][: int(entry["count"])], float(entry["measured_s"]))


class _ToldClock:
    """A clock that is set, to the bit. See `Clock`."""

    time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        raise NotImplementedError("who replays does not sleep")


class _Told(Generic[T]):
    """A source that says what a log says. See `Source`."""

    def __init__(self, decode: Callable[[bytes], T]) -> None:
        self._decode = decode
        self._newest: Received[T] | None = None

    def tell(self, entry: np.ndarray) -> None:
        """An entry of the log."""
        self._newest = Received(
            sample=self._decode(entry["sample"].tobytes()),
            number=int(entry["number"]),
            received_s=float(entry["received_s"]),
            age_s=0.0,
        )

    def newest(self) -> Received[T] | None:
        return self._newest

    def counts(self) -> SourceCounts:
        return SourceCounts()

    def close(self) -> None:
        self._newest = None
