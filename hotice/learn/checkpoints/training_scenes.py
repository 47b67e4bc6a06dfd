"""The scenes that a policy was trained on, made again from its record, each checked against its digest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hotice.errors import CheckpointError, HoticeError, InvalidConfig
from hotice.learn.checkpoints.scene_record import SHORT, SceneRecord
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn
from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest
from hotice.model.shipped import resolve_item


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """Training scenes that could not be made again: the entry's text, how many of how many, and why."""

    scenes: str
    missing: int
    count: int
    reason: str


@dataclass(frozen=True, kw_only=True)
class TrainingScenes:
    """Scenes of a record, each once, and what of it is not there."""

    scenes: tuple[Scene, ...]
    left_out: tuple[LeftOut, ...] = ()

    @classmethod
    def of(cls, trained_on: TrainedOn) -> TrainingScenes:
        """Makes the scenes again. Raises `CheckpointError` where not one of them can be."""
        kept: dict[str, Scene] = {}
        left_out = []
        for record in trained_on.records:
            scenes, missing = _again(record)
            kept |= {digest: scene for digest, scene in scenes.items() if digest not in kept}
            left_out += missing
        if not kept:
            reason = left_out[0].reason if left_out else "the record is empty"
            raise CheckpointError(f"none of the training scenes can be made again: {reason}")
        return cls(scenes=tuple(kept.values()), left_out=tuple(left_out))


def whole_record(
    meta: dict[str, Any], policy: str, named: tuple[str, ...] = (), option: str = "trained-on"
) -> TrainedOn:
    """The record of a policy, or that of the scenes `named` by hand where its own is missing or not whole.

    Raises `CheckpointError` without a whole record, `InvalidConfig` where scenes are named beside one.
    """
    own = TrainedOn.from_json(meta[TRAINED_ON], policy) if TRAINED_ON in meta else TrainedOn()
    if own.whole:
        if named:
            raise InvalidConfig(
                f"{option} is {', '.join(named)}, but {policy} carries a whole record of its training scenes: "
                "leave it out"
            )
        return own
    if named:
        return TrainedOn(records=(own | TrainedOn.of_items(named, "hand")).records)
    lacks = "carries no record of its training scenes"
    if own.unrecorded:
        lacks = f"carries a record with gaps: {len(own.unrecorded)} checkpoints before it have none"
        lacks += f" ({', '.join(sha[:12] for sha in own.unrecorded)})"
    raise CheckpointError(
        f"{policy}: {lacks}, so nobody can say what it has not seen: name all scenes that it and its ancestors were "
        f"trained on as --{option}, or write the record into its checkpoint (python -m tools.record_training) and "
        "export it again"
    )


def _again(record: SceneRecord) -> tuple[dict[str, Scene], list[LeftOut]]:
    """Scenes of an entry by digest, only those that are what they were, and what is missing."""
    try:
        scenes = resolve_item(record.scenes)
    except HoticeError as error:
        return {}, [LeftOut(scenes=record.scenes, missing=record.count, count=record.count, reason=str(error))]
    digests = [scene_digest(scene) for scene in scenes]
    found = dict(zip(digests, scenes, strict=True))
    if record.covers(digests):
        return found, []
    same = {digest: scene for digest, scene in found.items() if digest[:SHORT] in record.digests}
    missing = record.count - len({d[:SHORT] for d in same})
    reason = "they are others now: the generator or the files changed since"
    return same, [LeftOut(scenes=record.scenes, missing=missing, count=record.count, reason=reason)]
