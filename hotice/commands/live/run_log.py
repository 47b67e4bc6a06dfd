"""The log of a run as it grows: curves of bounded length, and the arrivals by family of the newest updates."""

from __future__ import annotations

import json
import math
import time
from collections import defaultdict, deque
from pathlib import Path
from typing import Any

from hotice.learn.train.progress import LOG

MOST_POINTS = 400
"""Points of a curve; twice as many are averaged in pairs."""
NEWEST = 20
"""Updates over which families are averaged: few episodes end in each."""
CURVES = {"reward": "reward", "success": "share/reached"}
"""Name of a curve, and of its numbers in the log."""
Point = dict[str, float | None]


class RunLog:
    """Reads on where it stopped; a log that was cut, as by a run that goes on from a checkpoint, is read anew."""

    def __init__(self, run: Path) -> None:
        self._path = run / LOG
        self._begin()

    def _begin(self) -> None:
        self._read, self._file, self._rest = 0, -1, b""
        self._each = 1
        self._points: list[Point] = []
        self._open: list[Point] = []
        self._families: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=NEWEST))
        self.last: dict[str, float] = {}
        """Numbers of the newest update; empty: there is none yet."""

    def look(self) -> None:
        """Takes in what was written since the last call; nothing where there is no log."""
        try:
            with open(self._path, "rb") as file:
                about = self._path.stat()
                if about.st_ino != self._file or about.st_size < self._read:
                    self._begin()
                    self._file = about.st_ino
                file.seek(self._read)
                lines = (self._rest + file.read()).split(b"\n")
                self._read = file.tell()
        except FileNotFoundError:
            return
        self._rest = lines.pop()
        for line in lines:
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            row = json.loads(line)
        except (ValueError, RecursionError):
            return
        if not isinstance(row, dict):
            return
        self.last = {name: value for name, value in row.items() if _is_number(value)}
        if "steps" not in self.last:
            return
        self._open.append({"steps": self.last["steps"]} | {name: self.last.get(key) for name, key in CURVES.items()})
        if len(self._open) == self._each:
            self._points.append(_mean(self._open))
            self._open = []
        if len(self._points) == 2 * MOST_POINTS:
            self._points = [_mean(self._points[i : i + 2]) for i in range(0, len(self._points), 2)]
            self._each *= 2
        for name, value in self.last.items():
            if name.startswith("family/"):
                self._families[name.removeprefix("family/")].append(value)

    @property
    def age_s(self) -> float | None:
        """Time since the newest update was written [s]; None where there is no log."""
        try:
            return max(0.0, time.time() - self._path.stat().st_mtime)
        except FileNotFoundError:
            return None

    def curves(self) -> dict[str, list[float | None]]:
        """Environment steps, and the numbers of each curve there; None where there is none."""
        points = self._points + ([_mean(self._open)] if self._open else [])
        return {name: [point[name] for point in points] for name in ("steps", *CURVES)}

    def families(self) -> list[tuple[str, float]]:
        """Share of arrivals in each family of scenes, over its `NEWEST` newest updates."""
        return [(name, sum(values) / len(values)) for name, values in sorted(self._families.items())]


def _mean(points: list[Point]) -> Point:
    means: Point = {}
    for name in points[0]:
        known = [value for point in points if (value := point[name]) is not None]
        means[name] = sum(known) / len(known) if known else None
    return means


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
