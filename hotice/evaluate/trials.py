"""Results of trials, and their storage while an evaluation runs."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from hotice import checks
from hotice.checks import shown
from hotice.documents import read_json
from hotice.errors import HoticeError, InputError
from hotice.files import make_folder, write_text

CAUSES = ("robot_collision", "object_collision", "fall", "drop", "timeout", "unstable", "no_plan", "walked_into")
PLURAL = {
    "robot_collision": "robot_collisions",
    "object_collision": "object_collisions",
    "fall": "falls",
    "drop": "drops",
    "timeout": "timeouts",
    "unstable": "unstable",
    "no_plan": "no_plans",
    "walked_into": "walked_into",
}
SETTINGS = "settings.json"
MAX_FILE_BYTES = 256 * 2**20
ONLY_MOVING = ("walked_into",)
"""Causes that there are only where something moves: scenes without have no count of them."""
DEEP_M = 0.005
"""Contacts within the robot that are deeper are counted apart: so far two links may yield to each other in the
simulation."""


OPTIONAL = ("distance_at_limit_m", "standing", "stayed", "points", "self_depth_m")
"""Fields of `Trials` that may be empty: earlier versions lacked them, and `points` where the exact referee was
alone."""


@dataclass(frozen=True, kw_only=True)
class Trials:
    """Trials of one scene: outcome (`OUTCOMES` or `no_plan`), root to goal at the end [m], duration [s] of each.

    distance_at_limit_m: root to goal at the time limit, of failures at their end. standing, stayed: whether the robot
    has arrived and goes on standing there, see `hotice.evaluate.referees.afterwards`. points: outcome by the points
    rule.
    self_depth_m: how deep parts of the robot were in each other at most.
    """

    outcome: tuple[str, ...] = ()
    distance_m: tuple[float, ...] = ()
    time_s: tuple[float, ...] = ()
    distance_at_limit_m: tuple[float, ...] = ()
    standing: tuple[bool, ...] = ()
    stayed: tuple[bool, ...] = ()
    points: tuple[str, ...] = ()
    self_depth_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            if len(values) != len(self.outcome) and (values or name not in OPTIONAL):
                raise ValueError(f"{len(self.outcome)} outcomes, {len(values)} values of {name}")

    @classmethod
    def joined(cls, parts: Iterable[Trials]) -> Trials:
        """All trials of all parts, in order; what a part lacks, all lack."""
        parts = [p for p in parts if p.rollouts]
        known = [f.name for f in fields(cls) if all(getattr(p, f.name) for p in parts)]
        return cls(**{name: tuple(v for p in parts for v in getattr(p, name)) for name in known})

    def rounded(self, digits: int) -> Trials:
        """The same with distances of so many digits."""
        names = ("distance_m", "distance_at_limit_m", "self_depth_m")
        return replace(self, **{name: tuple(round(d, digits) for d in getattr(self, name)) for name in names})

    @property
    def rollouts(self) -> int:
        """How many."""
        return len(self.outcome)

    @property
    def successes(self) -> int:
        """Number of successes."""
        return self.outcome.count("success")

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of trials by outcome."""
        return dict(Counter(self.outcome))

    def rates(self) -> dict[str, Any]:
        """Success rate, 95 % Wilson interval, mean distance [m]; also at the time limit and by the points rule.

        Of the arrivals, the shares that stand at the limit and that have stayed for a second. None: nobody looked, or
        arrived.
        """
        limit, arrived = self.distance_at_limit_m, self.successes
        return {
            **_rate(self.successes, self.rollouts),
            "mean_distance_m": sum(self.distance_m) / max(1, self.rollouts),
            "mean_distance_at_limit_m": sum(limit) / len(limit) if limit else None,
            "standing_share": sum(self.standing) / arrived if self.standing and arrived else None,
            "stayed_share": sum(self.stayed) / arrived if self.stayed and arrived else None,
            "points": self._by_points(),
            "self_contact": self._within(),
        }

    def _within(self) -> dict[str, float] | None:
        """Share of trials with contact within the robot, with one deeper than `DEEP_M`, and the deepest of all [m]."""
        depth = self.self_depth_m
        if not depth:
            return None
        share = {
            name: sum(d > least for d in depth) / len(depth) for name, least in (("share", 0.0), ("deep_share", DEEP_M))
        }
        return share | {"deepest_m": max(depth)}

    def _by_points(self) -> dict[str, Any] | None:
        if not self.points:
            return None
        counts = {PLURAL[c]: self.points.count(c) for c in CAUSES if c not in ONLY_MOVING}
        return _rate(self.points.count("success"), len(self.points)) | counts

    def summary(self, moving: bool = False) -> dict[str, Any]:
        """Rates, mean duration of successes [s], failures by cause; `moving`: of a scene in which something moves."""
        times = [t for t, o in zip(self.time_s, self.outcome, strict=True) if o == "success"]
        return {
            "rollouts": self.rollouts,
            **self.rates(),
            "mean_success_time_s": sum(times) / len(times) if times else None,
            **{PLURAL[c]: self.outcome.count(c) for c in CAUSES if moving or c not in ONLY_MOVING or c in self.outcome},
        }


def _rate(successes: int, trials: int) -> dict[str, Any]:
    low, high = success_interval(successes, trials)
    return {"success_rate": successes / max(1, trials), "success_interval_95": [round(low, 4), round(high, 4)]}


def success_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson score interval of a rate (Wilson 1927); (0, 1) without trials."""
    from scipy.stats import binomtest

    if trials == 0:
        return 0.0, 1.0
    found = binomtest(successes, trials).proportion_ci(0.95, "wilson")
    return float(found.low), float(found.high)


def read_trials(folder: Path) -> dict[str, Trials]:
    """Trials that an evaluation kept in `folder`, OUT.trials, by scene. Raises `InputError`."""
    files = sorted(folder.glob("scene-*.json"))
    if not files:
        raise InputError(
            f"{folder}: no file scene-*.json: the folder OUT.trials of `hotice evaluate --out OUT` is needed"
        )
    sizes = block_sizes(_read_settings(folder))
    found = {}
    for file in files:
        name, blocks = _read_blocks(file, sizes)
        found[name] = Trials.joined(blocks[b] for b in sorted(blocks))
    return found


class BlockSizes(NamedTuple):
    """Blocks of a scene's trials: `rollouts` in all, `batch` in each block, fewer in the last."""

    rollouts: int
    batch: int

    def __contains__(self, block: object) -> bool:
        return isinstance(block, int) and 0 <= block * self.batch < self.rollouts

    def size(self, block: int) -> int:
        """Number of trials of a block."""
        return min(self.batch, self.rollouts - block * self.batch)


def block_sizes(settings: Any) -> BlockSizes | None:
    """Number of trials of each block of a scene by the settings of an evaluation; None where they do not say."""
    try:
        return BlockSizes(*(checks.whole(n, settings[n], checks.COUNT, InputError) for n in BlockSizes._fields))
    except (InputError, KeyError, TypeError):
        return None


def _read_settings(folder: Path) -> Any:
    """Settings of the evaluation whose trials are in a folder; None where there are none that can be read."""
    try:
        return read_json(folder / SETTINGS, MAX_FILE_BYTES)
    except InputError:
        return None


def _read_blocks(file: Path, sizes: BlockSizes | None) -> tuple[str, dict[int, Trials]]:
    """Name of the scene and its trials by block. Raises `InputError`, also for values that no trial can have."""
    try:
        content = read_json(file, MAX_FILE_BYTES)
        blocks = {_block(b, sizes): _trials(values, b, sizes) for b, values in content["blocks"].items()}
        return str(content.get("name", file.stem)), blocks
    except (ValueError, KeyError, TypeError, AttributeError, InputError, InvalidTrials) as error:
        why = f" ({error})" if isinstance(error, InvalidTrials) else ""
        raise InputError(
            f"{file}: is no file of trials, changed or damaged{why}: remove it to run its trials anew"
        ) from None


class InvalidTrials(HoticeError):
    """Values in a file of trials that no trial can have."""


def _block(name: str, sizes: BlockSizes | None) -> int:
    if not name.isascii() or not name.isdecimal() or (sizes is not None and int(name) not in sizes):
        raise InvalidTrials(f"block {shown(name)} is not one of this evaluation")
    return int(name)


def _trials(values: dict[str, Any], block: str, sizes: BlockSizes | None) -> Trials:
    """Trials of a block. Raises `InvalidTrials`, or `ValueError` and `TypeError` for other names and lengths."""
    trials = Trials(**{name: tuple(column) for name, column in values.items()})
    for name, column in vars(trials).items():
        for i, value in enumerate(column):
            _check_value(f"block {block}: {name}[{i}]", name, value)
    wanted = max(1, trials.rollouts) if sizes is None else sizes.size(int(block))
    if trials.rollouts != wanted:
        raise InvalidTrials(f"block {block} holds {trials.rollouts} trials, {wanted} are needed")
    return trials


def _check_value(where: str, name: str, value: object) -> None:
    if name in ("outcome", "points"):
        checks.one_of(where, value, ("success", *CAUSES), InvalidTrials)
    elif name in ("standing", "stayed"):
        checks.flag(where, value, InvalidTrials)
    # what was measured may be as small as floats are
    elif not (isinstance(value, float) and 0.0 <= value < 1.0):
        checks.number(where, value, checks.NOT_NEGATIVE, InvalidTrials)


class TrialStore:
    """Folder of an evaluation that is not over: `settings.json` and one file a scene, each rewritten as blocks end.

    Trials that are there count only when they were made with the same settings; otherwise they are removed, so that
    results of different policies, seeds or settings never mix. Nothing is written or removed before the first new
    block: an evaluation that is refused leaves all as it was.
    """

    def __init__(self, folder: Path, settings: dict[str, Any], scenes: list[str]) -> None:
        self.folder, self.scenes = folder, scenes
        self.blocks: dict[tuple[int, int], Trials] = {}
        self._sizes = block_sizes(settings)
        self._settings: str | None = json.dumps(settings, indent=1, sort_keys=True) + "\n"
        self.changed = self._differing(self._settings)
        if not self.changed:
            for index in range(len(scenes)):
                self._load(index)

    def add(self, scene: int, block: int, trials: Trials) -> None:
        """Keeps a block of a scene. Raises `OutputError`."""
        if self._settings is not None:
            self._begin(self._settings)
            self._settings = None
        self.blocks[scene, block] = trials
        done = sorted(b for s, b in self.blocks if s == scene)
        content = {
            "name": self.scenes[scene],
            **Trials.joined(self.blocks[scene, b] for b in done).summary(),
            "blocks": {b: vars(self.blocks[scene, b]) for b in done},
        }
        write_text(self._file(scene), json.dumps(content) + "\n")

    def _begin(self, settings: str) -> None:
        """Makes the folder one of these settings."""
        make_folder(self.folder)
        if self.changed:
            for file in self.folder.glob("scene-*.json"):
                file.unlink()
        write_text(self.folder / SETTINGS, settings)

    def _file(self, scene: int) -> Path:
        return self.folder / f"scene-{scene:03d}.json"

    def _differing(self, text: str) -> list[str]:
        """Names of the settings that are not those of the trials in the folder."""
        if not (self.folder / SETTINGS).exists():
            return []
        try:
            old, new = read_json(self.folder / SETTINGS, MAX_FILE_BYTES), json.loads(text)
        except InputError:
            return [SETTINGS]
        if not isinstance(old, dict):
            return [SETTINGS]
        return sorted(k for k in old.keys() | new.keys() if old.get(k) != new.get(k))

    def _load(self, scene: int) -> None:
        file = self._file(scene)
        if not file.exists():  # none of this scene yet
            return
        _, blocks = _read_blocks(file, self._sizes)
        self.blocks |= {(scene, block): trials for block, trials in blocks.items()}
