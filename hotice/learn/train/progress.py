"""Progress of a training run: a line, a table now and then, TensorBoard, and one JSON line per update."""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as RichProgress
from torch.utils.tensorboard import SummaryWriter

from hotice.console import PlainConsole
from hotice.errors import OutputError
from hotice.files import make_folder, output_file, write_bytes
from hotice.learn.train.config import TrainConfig, config_to_dict
from hotice.learn.train.trials import TrialResults
from hotice.learn.train.wandb_sync import wandb_run
from hotice.progress import in_words, left

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
LOG = "log.jsonl"


class Progress:
    """Context manager around a training run, of which `first` updates, `steps` environment steps, were done before.

    A run that goes on makes anew what was logged after its checkpoint: these rows, and these steps in TensorBoard, go.

    Raises `OutputError` when the log cannot be written; what is in it by then stays.
    """

    def __init__(self, config: TrainConfig, first: int, steps: int = 0) -> None:
        make_folder(config.out)
        self.config = config
        self.first_step = steps + 1 if config.resume else None
        self.console = PlainConsole(stderr=True)
        self.live = sys.stderr.isatty()
        self.bar = RichProgress(
            TextColumn("[bold]{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(),
            console=self.console,
            disable=not self.live,
            transient=True,
        )
        limit = config.updates if not config.max_minutes else None
        self.task = self.bar.add_task("training", total=limit, completed=first, text="")
        with self._writing():
            output_file(config.out / LOG)
            if config.resume:
                keep_rows(config.out / LOG, first)
            self.lines = open(config.out / LOG, "ab", buffering=0)  # noqa: SIM115 - closed in __exit__
        self.printed = 0.0
        self.first, self.begin = first, time.monotonic()

    def __enter__(self) -> Progress:
        self.excepthook, threading.excepthook = threading.excepthook, self._quiet
        try:
            with self._writing():
                self.sync = wandb_run(self.config)
                self.writer = SummaryWriter(str(self.config.out / "tensorboard"), purge_step=self.first_step)
                self.writer.add_text("configuration", _as_table(self.config), self.first_step or 0)
        except OutputError:
            self.lines.close()
            threading.excepthook = self.excepthook
            raise
        self.bar.start()
        return self

    def __exit__(self, kind: type | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self.bar.stop()
        self.lines.close()
        try:
            with self._writing():
                self.writer.close()
        except OutputError:
            if value is None:
                raise
        finally:
            threading.excepthook = self.excepthook
            if self.sync is not None:
                self.sync.finish(exit_code=int(kind is not None))

    def trials(self, steps: int, results: TrialResults, ways: Figure) -> None:
        """Shows and stores what trials gave after `steps` environment steps, with a picture. Raises `OutputError`."""
        log = results.log()
        with self._writing():
            for key, value in log.items():
                self.writer.add_scalar(key, value, steps)
            self.writer.add_figure("trials/ways", ways, steps)
            self.writer.flush()
        self.note(
            f"trials at {steps / 1e6:.2f} M steps: {log['trials/success']:.0%} of {len(results.outcome)}, "
            f"{log['trials/distance_m']:.2f} m"
        )

    def report(self, update: int, steps: int, minutes: float, log: dict[str, float]) -> None:
        """Shows and stores the numbers of an update. Raises `OutputError`."""
        row = {"update": update, "steps": steps, "minutes": round(minutes, 3)}
        rest = (json.dumps(row | {k: round(float(v), 5) for k, v in log.items()}) + "\n").encode()
        with self._writing():
            while rest:  # a disk that fills up takes a part first
                rest = rest[self.lines.write(rest) :]
            for key, value in log.items():
                self.writer.add_scalar(key, value, steps)
        text = f"{steps / 1e6:.2f} M steps, {log['steps_per_s']:.0f}/s, " + ", ".join(
            f"{k.removeprefix('share/')} {log[k]:.2f}" for k in SHOWN if k in log
        )
        text += self._left(update)
        self.bar.update(self.task, completed=update, text=text)
        if not self.live and time.monotonic() - self.printed > QUIET_S:
            self.note(f"update {update}: {text}")
            self.printed = time.monotonic()

    def _left(self, update: int) -> str:
        """When the run ends, by its limit of minutes or at the rate so far; empty where nothing limits it."""
        if self.config.max_minutes:
            seconds = 60.0 * self.config.max_minutes - (time.monotonic() - self.begin)
            return f", {in_words(max(seconds, 0.0))} left"
        if self.config.updates == TrainConfig.updates:
            return ""
        return left(update - self.first, self.config.updates - update, self.begin)

    def note(self, text: str) -> None:
        """Prints a line above the bar."""
        self.console.print(text, soft_wrap=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise OutputError(f"cannot write the log in {self.config.out}: {error.strerror or error}") from None

    def _quiet(self, args: threading.ExceptHookArgs) -> None:
        """TensorBoard writes in a thread of its own, and raises in ours what went wrong there: once is enough."""
        if not (isinstance(args.exc_value, OSError) and type(args.thread).__module__.startswith("tensorboard")):
            self.excepthook(args)


def keep_rows(path: Path, update: int) -> None:
    """Removes from a log the rows after `update`, which will be made anew, and one that was cut short."""
    if not path.exists():
        return
    lines = path.read_bytes().splitlines(keepends=True)
    kept = [line for line in lines if line.endswith(b"\n") and _update_of(line) <= update]
    if kept != lines:
        write_bytes(path, b"".join(kept))


def _update_of(line: bytes) -> float:
    try:
        return json.loads(line)["update"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return float("inf")


def _as_table(config: TrainConfig) -> str:
    """The configuration as a table in Markdown, nested names with dots."""
    rows: list[tuple[str, object]] = []

    def add(prefix: str, value: object) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                add(f"{prefix}.{name}" if prefix else name, inner)
        else:
            rows.append((prefix, value))

    add("", config_to_dict(config))
    return "| Option | Value |\n|---|---|\n" + "\n".join(f"| {name} | {value} |" for name, value in rows)
