"""Logs of branches, update by update, as one row of the run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

SUMS = ("episodes", "steps_per_s", "unstable", "skipped_minibatches")
"""What branches do together; everything else is a mean."""
BY_EPISODES = ("share/", "length", "distance_m")
"""Means over episodes: branches weigh by how many ended."""
COUNTERS = ("update", "steps", "minutes")


def joined(logs: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """One row from the logs of one update of each branch; a number that some lack is that of the others."""
    row: dict[str, float] = {}
    for name in dict.fromkeys(name for log in logs for name in log):
        having = [log for log in logs if name in log]
        values = [float(log[name]) for log in having]
        weights = [float(log.get("episodes", 1.0)) if name.startswith(BY_EPISODES) else 1.0 for log in having]
        total = sum(v * w for v, w in zip(values, weights, strict=True))
        row[name] = sum(values) if name in SUMS else total / (sum(weights) or 1.0)
    return row


class Rows:
    """Logs of a round, given out row by row in order, once no branch that takes part is behind.

    Args:
        first: update that the round began at.
        steps: environment steps behind it.
        each: environment steps of one branch's update.
    """

    def __init__(self, first: int, steps: int, each: int) -> None:
        self.update, self.steps, self.each = first, steps, each
        self.logs: dict[int, dict[int, Mapping[str, float]]] = {}
        self.reached: dict[int, int] = {}

    def take_part(self, number: int, update: int) -> None:
        """Adds a branch, which has done all up to `update`."""
        self.reached[number] = update

    def add(self, number: int, update: int, log: Mapping[str, float]) -> None:
        """Takes in a branch's log of an update."""
        self.logs.setdefault(update, {})[number] = log
        self.reached[number] = max(update, self.reached.get(number, update))

    def leave_out(self, number: int) -> None:
        """Forgets a branch that was lost, but for rows that were given out."""
        self.reached.pop(number, None)
        for logs in self.logs.values():
            logs.pop(number, None)

    def whole(self) -> Iterator[tuple[int, int, dict[str, float]]]:
        """Update, environment steps behind it, and row, of all that are whole by now."""
        while self.reached and self.update < min(self.reached.values()):
            self.update += 1
            logs = self.logs.pop(self.update, {})
            self.steps += self.each * len(self.reached)
            if logs:
                row = joined([logs[number] for number in sorted(logs)])
                yield self.update, self.steps, row | {"branches": float(len(self.reached))}


def logged(path: Path, after: int, until: int) -> Iterator[tuple[int, dict[str, float]]]:
    """Updates and logs from a branch's `log.jsonl`, without its counters; rows that are none are left out."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines() if path.is_file() else []
    for line in lines:
        try:
            row = json.loads(line)
            update = int(row["update"])
            numbers = {name: float(value) for name, value in row.items() if name not in COUNTERS}
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
        if after < update <= until:
            yield update, numbers
