"""Training scenes of a policy: of its run and of every run behind it, of teachers and parts of averages too.

The record is in `meta.json` of each checkpoint and in each exported policy. It names what was written on the command
line (sets, families with count and seed, files) and holds digests of the scenes that came of it, so the scenes can be
made again (`hotice.learn.checkpoints.training_scenes`) and known again. Its scenes are listed once, whatever number of
runs trained on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.scene_record import SHORT, TOLD_BY, SceneRecord
from hotice.model.scene import Scene
from hotice.model.shipped import resolve_item

TRAINED_ON = "trained_on"
"""Key of the record in `meta.json` and in the description of a policy."""
GIVEN = "(an environment made by a program)"
"""Stands for scenes that no command line names; they can be known again by digest, not made again."""
MAX_DIGESTS = 1000
"""A record keeps the digests of so many single scenes; beyond, its longest entries keep only the one over all their
scenes."""


@dataclass(frozen=True, kw_only=True)
class TrainedOn:
    """Entries of a line, and what is missing.

    records: oldest first, no two of the same scenes. unrecorded: SHA-256 of the tensors of checkpoints in the line that
    have no record, from before there was one.
    """

    records: tuple[SceneRecord, ...] = ()
    unrecorded: tuple[str, ...] = ()

    @classmethod
    def of_items(cls, items: Iterable[str], told_by: str = "run") -> TrainedOn:
        """The record of scenes as they are written on the command line. Raises `InvalidScene` or `UnknownName`."""
        return cls.of_resolved({item: resolve_item(item) for item in dict.fromkeys(items)}, told_by)

    @classmethod
    def of_resolved(cls, items: Mapping[str, Sequence[Scene]], told_by: str = "run") -> TrainedOn:
        """The record of items whose scenes are at hand."""
        record = cls()
        for item, scenes in items.items():
            record |= cls(records=(SceneRecord.of(item, scenes, told_by),))
        return record

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any], where: str = "") -> TrainedOn:
        """Record of a checkpoint; marked as missing for one older than records. Raises `CheckpointError`."""
        if TRAINED_ON in meta:
            return cls.from_json(meta[TRAINED_ON], where)
        return cls(unrecorded=(str(meta.get("sha256", "unknown")),))

    def __or__(self, other: TrainedOn) -> TrainedOn:
        """The union. Of two entries of the same scenes the one stays that a run wrote itself."""
        kept = {record.digest: record for record in self.records}
        for record in other.records:
            mine = kept.get(record.digest)
            if mine is None or TOLD_BY.index(record.told_by) < TOLD_BY.index(mine.told_by):
                kept[record.digest] = record
        unrecorded = tuple(dict.fromkeys((*self.unrecorded, *other.unrecorded)))
        return TrainedOn(records=_bounded(tuple(kept.values())), unrecorded=unrecorded)

    @property
    def whole(self) -> bool:
        """Whether no checkpoint of the line lacks a record."""
        return bool(self.records) and not self.unrecorded

    @property
    def families(self) -> dict[str, int]:
        """Scenes of each family that occurs, sorted; those of no known family under `unknown`."""
        count: dict[str, int] = {}
        for record in self.records:
            for family, scenes in record.families.items():
                count[family] = count.get(family, 0) + scenes
        return dict(sorted(count.items()))

    def holds(self, digest: str) -> bool:
        """Whether the scene of this digest is known to have been trained on."""
        return any(digest[:SHORT] in r.digests or (r.count == 1 and r.covers([digest])) for r in self.records)

    def to_json(self) -> dict[str, Any]:
        """The record, JSON-ready."""
        return {"scenes": [r.to_json() for r in self.records], "unrecorded": list(self.unrecorded)}

    @classmethod
    def from_json(cls, data: Any, where: str = "") -> TrainedOn:
        """Inverse of `to_json`. Raises `CheckpointError`, naming `where`, for what no record can be."""
        try:
            unrecorded = tuple(str(sha) for sha in data["unrecorded"])
            return cls(records=tuple(SceneRecord.from_json(r) for r in data["scenes"]), unrecorded=unrecorded)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CheckpointError(
                f"{where or 'checkpoint'}: {TRAINED_ON} is no record of training scenes: {type(error).__name__} "
                f"{error}: the file was changed, or written by another version"
            ) from None

    def summary(self) -> dict[str, Any]:
        """Summary for reports: sets and single scenes, scenes by family, entries that no run wrote itself."""
        told = {who: sum(r.told_by == who for r in self.records) for who in TOLD_BY[1:]}
        return {
            "scenes": sum(r.count for r in self.records),
            "sets": [r.scenes for r in self.records if r.kind == "set"],
            "families": self.families,
            **{f"told_by_{who}": n for who, n in told.items() if n},
            "unrecorded": len(self.unrecorded),
        }


def in_words(summary: Mapping[str, Any]) -> str:
    """A `TrainedOn.summary` as a sentence."""
    families = ", ".join(f"{name} {count}" for name, count in summary["families"].items())
    text = f"{summary['scenes']} scenes; sets: {', '.join(summary['sets']) or 'none'}; by family: {families or 'none'}"
    if summary.get("told_by_ledger"):
        text += f"; {summary['told_by_ledger']} entries from the training ledger"
    if summary.get("told_by_hand"):
        text += f"; {summary['told_by_hand']} entries named by hand"
    if summary["unrecorded"]:
        text += f"; not whole: {summary['unrecorded']} checkpoints before it have no record"
    return text


def _bounded(records: tuple[SceneRecord, ...]) -> tuple[SceneRecord, ...]:
    """Entries with at most `MAX_DIGESTS` digests of single scenes, the longest without theirs where there are more."""
    records_by_length = sorted(range(len(records)), key=lambda i: len(records[i].digests), reverse=True)
    total, result = sum(len(r.digests) for r in records), list(records)
    for i in records_by_length:
        if total <= MAX_DIGESTS:
            break
        total -= len(records[i].digests)
        result[i] = replace(records[i], digests=())
    return tuple(result)
