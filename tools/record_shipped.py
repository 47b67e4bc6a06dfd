"""Writes what `carry` and `teacher` were trained on, from the training ledger: `python -m tools.record_shipped`.

They were trained before runs kept a record. `RUNS` repeats hotice/policies/LEDGER.md: the scenes of each run in the
line, and what it began from or learnt from. The records go into the descriptions of the .onnx files, marked `ledger`;
weights stay what they are. Scenes that the last run's own configuration names are marked `run`.

The generator gives the same scenes today as when they were trained on: the graded families (open, pipe, step, gap,
pillars, table_edge, beam, hanging, combo) have not changed since the first run, nor have the others since the sets were
shipped.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import onnx

from hotice.errors import CheckpointError
from hotice.files import write_bytes
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn, in_words
from hotice.policy.policy_file import KEY, POLICIES, content_hash, read_onnx_meta


def _scenes(*named: str, **families: int) -> tuple[str, ...]:
    return (*named, *(f"family:{name}:{count}" for name, count in families.items()))


WALK = _scenes("open_floor", open=24, pipe=14, step=12, gap=14, pillars=12, table_edge=12, beam=18, hanging=10, combo=8)
WALK3 = _scenes(
    "open_floor", open=16, pipe=14, step=10, gap=12, pillars=16, table_edge=12, beam=20, hanging=10, combo=8
)
WALK4 = _scenes(
    "open_floor", open=16, pipe=14, step=10, gap=12, pillars=16, table_edge=16, beam=20, hanging=10, combo=8
)
STU1 = _scenes(
    "open_floor",
    "train75",
    open=12,
    pipe=10,
    step=8,
    gap=8,
    pillars=10,
    table_edge=12,
    beam=14,
    hanging=8,
    combo=8,
    one_pipe=10,
    one_step=10,
    two_pipes=6,
    beam_across=10,
    lamps=8,
    combination=10,
)
STU4 = _scenes(
    "open_floor",
    "train75",
    open=8,
    pipe=14,
    step=12,
    gap=6,
    pillars=10,
    table_edge=10,
    beam=14,
    hanging=8,
    combo=8,
    one_pipe=14,
    one_step=14,
    two_pipes=8,
    beam_across=12,
    lamps=8,
    combination=10,
)
STU10 = _scenes(
    "open_floor",
    "bench20",
    "train75",
    open=4,
    pipe=6,
    step=6,
    pillars=5,
    table_edge=4,
    beam=8,
    one_pipe=6,
    one_step=6,
    two_pipes=6,
    beam_across=6,
    combination=6,
    slalom=6,
    gauntlet=6,
    two_steps=4,
)
CLEAN1 = _scenes(
    "open_floor",
    "bench20",
    "train75",
    open=4,
    pipe=6,
    step=6,
    pillars=5,
    table_edge=4,
    beam=20,
    one_pipe=6,
    one_step=6,
    two_pipes=6,
    beam_across=16,
    combination=10,
    slalom=6,
    gauntlet=6,
    two_steps=4,
)

RUNS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "walk1": (WALK, ()),
    "walk2": (WALK, ("walk1",)),
    "walk3": (WALK3, ("walk2",)),
    "walk4": (WALK4, ("walk3",)),
    "stu1": (STU1, ("walk4",)),
    "stu2": (STU1, ("stu1",)),
    "stu3": (STU1, ("stu2",)),
    "stu4": (STU4, ("stu3",)),
    "stu6": (STU4, ("stu4",)),
    "scan1": (STU4, ("stu6",)),
    "scan2": (STU4, ("scan1",)),
    "scan3": (STU4, ("scan2",)),
    "stu7": (STU4, ("scan3",)),
    "stu8": (STU4, ("stu7",)),
    "stu10": (STU10, ("stu8",)),
    "stu11": (STU10, ("stu10",)),
    "stu13": (STU10, ("stu11",)),
    "clean1": (CLEAN1, ("stu11", "stu13")),
    "dag1": (CLEAN1, ("clean1",)),
    "ft1": (CLEAN1, ("dag1",)),
    "ft2": (CLEAN1, ("ft1",)),
    "ft3": (CLEAN1, ("ft1",)),
    "rob1": (CLEAN1, ("ft1", "ft2", "ft3")),
}
"""Scenes of each run of the ledger that a shipped policy descends from, and the runs that it began from or learnt
from."""
SHIPPED = {"carry": "walk4", "teacher": "rob1"}
"""Run that each of these policies is. `student` has a record of its own: a run that kept one went on from it."""


@cache
def line(run: str) -> TrainedOn:
    """What a run and all behind it were trained on, by the ledger."""
    scenes, behind = RUNS[run]
    record = TrainedOn()
    for before in behind:
        record |= line(before)
    return record | _of(scenes)


@cache
def _of(scenes: tuple[str, ...]) -> TrainedOn:
    return TrainedOn.of_items(scenes, "ledger")


def rewrite(path: Path, meta: dict) -> None:
    """Gives an .onnx policy another description; raises `CheckpointError` unless its graph stays what it was."""
    content = path.read_bytes()
    read_onnx_meta(content, path)
    model = onnx.load_model_from_string(content)
    del model.metadata_props[:]
    before = model.SerializeToString(deterministic=True)
    described = {**meta, "sha256": content_hash(model, meta)}
    model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(described)))
    content = model.SerializeToString()
    read_onnx_meta(content, path)
    again = onnx.load_model_from_string(content)
    del again.metadata_props[:]
    if again.SerializeToString(deterministic=True) != before:
        raise CheckpointError(f"{path}: its graph would not stay what it is")
    write_bytes(path, content)


def main() -> None:
    for name, run in SHIPPED.items():
        trained_on, path = line(run), POLICIES / f"{name}.onnx"
        meta = {k: v for k, v in read_onnx_meta(path.read_bytes(), path).items() if k != "sha256"}
        trained_on |= TrainedOn.of_items(meta["trained"]["scenes"], "run")
        meta |= {TRAINED_ON: trained_on.to_json()}
        meta["trained"] |= {"on": trained_on.summary()}
        rewrite(path, meta)
        print(f"{name}: {len(json.dumps(meta[TRAINED_ON])) / 1000:.1f} kB, {in_words(trained_on.summary())}")


if __name__ == "__main__":
    main()
