"""Writes by hand what a checkpoint was trained on, for one that was trained before runs kept a record of it:

`python -m tools.record_training CHECKPOINT --scenes open_floor bench20 family:beam:20 [--behind CHECKPOINT …]
[--told-by hand]`

`--scenes`: as its `hotice train` was given, by default as its `meta.json` says; `--behind`: what it began from, its
teachers and the parts of an average, whose records are taken over. Only `meta.json` changes. Export the policy again
afterwards.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from hotice.files import write_text
from hotice.learn.checkpoints.checkpoint import META, read_meta, resolve
from hotice.learn.checkpoints.scene_record import TOLD_BY
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn, in_words


def record(folder: Path, trained_on: TrainedOn) -> None:
    """Puts a record in the place of that of a checkpoint. Raises `CheckpointError` or `OutputError`."""
    meta = read_meta(folder)
    write_text(folder / META, json.dumps(meta | {TRAINED_ON: trained_on.to_json()}, indent=1) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--scenes", nargs="+")
    parser.add_argument("--behind", nargs="*", type=Path, default=[])
    parser.add_argument("--told-by", choices=TOLD_BY[1:], default="hand")
    args = parser.parse_args()
    folder = resolve(args.checkpoint)
    trained_on = TrainedOn()
    for behind in map(resolve, args.behind):
        trained_on |= TrainedOn.of_meta(read_meta(behind), str(behind))
    trained_on |= TrainedOn.of_items(args.scenes or read_meta(folder)["config"]["scenes"], args.told_by)
    record(folder, trained_on)
    print(f"{folder}: trained on {in_words(trained_on.summary())}")


if __name__ == "__main__":
    main()
