"""What a training run shows: a line of progress, a table now and then, TensorBoard, and one JSON line an update."""

from __future__ import annotations

import json
import sys
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress
from torch.utils.tensorboard import SummaryWriter

from hotice.files import make_folder
from hotice.learn.config import TrainConfig

SHOWN = (
    "reward",
    "length",
    "share/reached",
    "share/fall",
    "share/drop",
    "share/robot_collision",
    "share/object_collision",
)
QUIET_S = 30.0


class Progress:
    """Context manager around a training run."""

    def __init__(self, config: TrainConfig, first: int) -> None:
        make_folder(config.out)
        self.config = config
        self.console = Console(stderr=True)
        self.live = sys.stderr.isatty()
        self.bar = RichProgress(
            TextColumn("[bold]{task.description}"), BarColumn(), TextColumn("{task.fields[text]}"), TimeElapsedColumn(),
            console=self.console, disable=not self.live, transient=True,
        )  # fmt: skip
        limit = config.updates if not config.max_minutes else None
        self.task = self.bar.add_task("training", total=limit, completed=first, text="")
        self.writer = SummaryWriter(str(config.out / "tensorboard"))
        self.lines = open(config.out / "log.jsonl", "a")  # noqa: SIM115 - closed in __exit__
        self.printed = 0.0

    def __enter__(self) -> Progress:
        self.bar.start()
        return self

    def __exit__(self, kind: type | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.bar.stop()
        self.writer.close()
        self.lines.close()

    def report(self, update: int, steps: int, minutes: float, log: dict[str, float]) -> None:
        """Shows and stores the numbers of an update."""
        for key, value in log.items():
            self.writer.add_scalar(key, value, steps)
        row = {"update": update, "steps": steps, "minutes": round(minutes, 3)}
        self.lines.write(json.dumps(row | {k: round(float(v), 5) for k, v in log.items()}) + "\n")
        self.lines.flush()
        text = f"{steps / 1e6:.2f} M steps, {log['steps_per_s']:.0f}/s, " + ", ".join(
            f"{k.removeprefix('share/')} {log[k]:.2f}" for k in SHOWN if k in log
        )
        self.bar.update(self.task, completed=update, text=text)
        if not self.live and time.monotonic() - self.printed > QUIET_S:
            self.note(f"update {update}: {text}")
            self.printed = time.monotonic()

    def note(self, text: str) -> None:
        """Prints a line above the bar."""
        self.console.print(text, highlight=False, soft_wrap=True)
