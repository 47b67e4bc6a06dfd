"""`merges.jsonl` of a run: one line an average, with who was lost on the way."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from hotice.errors import OutputError
from hotice.files import output_file
from hotice.learn.branches.rounds import Closed
from hotice.learn.train.progress import keep_rows

MERGES = "merges.jsonl"


class Merges:
    """The file in the folder `out`; lines after `update`, which will be made anew, go."""

    def __init__(self, out: Path, update: int) -> None:
        self.path = output_file(out / MERGES)
        keep_rows(self.path, update)

    def add(self, closed: Closed, numbers: Sequence[int], lost: Mapping[int, str]) -> None:
        """Writes down an average of the branches `numbers`, and how others ended. Raises `OutputError`."""
        row = {
            "update": closed.round.update,
            "steps": closed.round.steps,
            "minutes": round(closed.round.minutes, 3),
            "averaged": list(numbers),
            "lost": {str(number): how for number, how in sorted(lost.items())},
            "way": closed.way,
            "apart": closed.apart,
        }
        try:
            with open(self.path, "ab") as file:
                file.write((json.dumps(row) + "\n").encode())
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror or error}") from None
