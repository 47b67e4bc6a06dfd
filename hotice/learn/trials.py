"""What came of trials, and where they are kept while an evaluation runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hotice.errors import InputError
from hotice.files import make_folder, read_bytes, write_text
from hotice.learn.wilson import wilson

CAUSES = ("robot_collision", "object_collision", "fall", "drop", "timeout", "unstable", "no_plan")
PLURAL = {
    "robot_collision": "robot_collisions", "object_collision": "object_collisions", "fall": "falls", "drop": "drops",
    "timeout": "timeouts", "unstable": "unstable", "no_plan": "no_plans",
}  # fmt: skip
MAX_FILE_BYTES = 256 * 2**20


@dataclass(frozen=True, kw_only=True)
class Trials:
    """Trials of one scene: outcome (of `OUTCOMES`, or `no_plan`), root to goal at the end [m], and duration [s] of each."""

    outcome: tuple[str, ...] = ()
    distance_m: tuple[float, ...] = ()
    time_s: tuple[float, ...] = ()

    @classmethod
    def joined(cls, parts: Iterable[Trials]) -> Trials:
        """All trials of all parts, in order."""
        parts = list(parts)
        return cls(
            outcome=tuple(o for p in parts for o in p.outcome),
            distance_m=tuple(d for p in parts for d in p.distance_m),
            time_s=tuple(t for p in parts for t in p.time_s),
        )

    @property
    def rollouts(self) -> int:
        """How many."""
        return len(self.outcome)

    @property
    def successes(self) -> int:
        """How many succeeded."""
        return self.outcome.count("success")

    @property
    def outcomes(self) -> dict[str, int]:
        """How many ended how."""
        return dict(Counter(self.outcome))

    def rates(self) -> dict[str, Any]:
        """Success rate with its 95 % Wilson interval, and mean distance [m]."""
        low, high = wilson(self.successes, self.rollouts)
        return {
            "success_rate": self.successes / max(1, self.rollouts),
            "success_interval_95": [round(low, 4), round(high, 4)],
            "mean_distance_m": sum(self.distance_m) / max(1, self.rollouts),
        }

    def summary(self) -> dict[str, Any]:
        """Rates, mean duration of successes [s] and failures by cause."""
        times = [t for t, o in zip(self.time_s, self.outcome, strict=True) if o == "success"]
        return {
            "rollouts": self.rollouts, **self.rates(), "mean_success_time_s": sum(times) / len(times) if times else None,
            **{PLURAL[c]: self.outcome.count(c) for c in CAUSES},
        }  # fmt: skip


class TrialStore:
    """Folder of an evaluation that is not over: `settings.json` and one file a scene, each rewritten as blocks end.

    Trials that are there count only when they were made with the same settings; otherwise they are removed, so that
    results of different policies, seeds or settings never mix.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], scenes: list[str]) -> None:
        self.folder, self.scenes = make_folder(folder), scenes
        self.blocks: dict[tuple[int, int], Trials] = {}
        text = json.dumps(settings, indent=1, sort_keys=True) + "\n"
        self.changed = self._differing(text)
        if self.changed:
            for file in self.folder.glob("scene-*.json"):
                file.unlink()
        else:
            for index in range(len(scenes)):
                self._load(index)
        write_text(self.folder / "settings.json", text)

    def add(self, scene: int, block: int, trials: Trials) -> None:
        """Keeps a block of a scene. Raises `OutputError`."""
        self.blocks[scene, block] = trials
        done = sorted(b for s, b in self.blocks if s == scene)
        content = {
            "name": self.scenes[scene], **Trials.joined(self.blocks[scene, b] for b in done).summary(),
            "blocks": {b: vars(self.blocks[scene, b]) for b in done},
        }  # fmt: skip
        write_text(self._file(scene), json.dumps(content) + "\n")

    def _file(self, scene: int) -> Path:
        return self.folder / f"scene-{scene:03d}.json"

    def _differing(self, text: str) -> list[str]:
        """Names of the settings that are not those of the trials in the folder."""
        if not (self.folder / "settings.json").exists():
            return []
        try:
            old, new = json.loads(read_bytes(self.folder / "settings.json", MAX_FILE_BYTES)), json.loads(text)
        except ValueError:
            return ["settings.json"]
        if not isinstance(old, dict):
            return ["settings.json"]
        return sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k))

    def _load(self, scene: int) -> None:
        file = self._file(scene)
        if not file.exists():  # none of this scene yet
            return
        try:
            for block, values in json.loads(read_bytes(file, MAX_FILE_BYTES))["blocks"].items():
                trials = Trials(**{name: tuple(v) for name, v in values.items()})
                if not len(trials.outcome) == len(trials.distance_m) == len(trials.time_s) > 0:
                    raise ValueError(f"block {block}: outcomes, distances and times differ in number")
                self.blocks[scene, int(block)] = trials
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{file}: is no file of trials (changed or damaged): remove it to run its trials anew"
            ) from None
