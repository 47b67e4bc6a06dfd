"""How far the unseen scenes are from the training scenes: each one's largest similarity over the set (IV, unseen
scenes).

`python -m benchmarks.similarity [--unseen unseen50] [--training train75]`, sets or families as in `hotice evaluate`.
Prints the histogram, the time of the comparison, and the unseen scenes least and most like the training set.
`python -m benchmarks.similarity --policy student` compares to what a policy and its ancestors were trained on, group by
group.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from rich.progress import Progress
from rich.table import Table

from hotice.commands.unseen import GROUPS, compared
from hotice.console import PlainConsole
from hotice.fields import FieldBank, similarity_matrix
from hotice.learn import load_policy
from hotice.learn.checkpoints.trained_on import in_words
from hotice.learn.checkpoints.training_scenes import whole_record
from hotice.model.shipped import resolve_scenes

BINS = 12
BAR_WIDTH = 40


def of_policy(policy: str, unseen: list[str], console: PlainConsole) -> None:
    """Prints how far unseen scenes are from the training scenes of a policy's record, group by group."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = compared(resolve_scenes(unseen), whole_record(load_policy(policy, threads=1).meta, policy))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    training = result["training"]
    console.print(f"{policy}: trained on {in_words(training)}")
    for gone in training["left_out"]:
        console.print(f"left out: {gone['scenes']}: {gone['missing']} of {gone['count']}: {gone['reason']}")
    table = Table(title=f"largest similarity of unseen scenes to {training['compared']} training scenes")
    for name in ("group", "scenes", "least", "mean", "largest", "families"):
        table.add_column(name)
    for key, group in GROUPS.items():
        of = [point for point in result["points"] if point["group"] == key]
        if of:
            values = np.array([point["similarity"] for point in of])
            families = ", ".join(sorted({str(point["family"]) for point in of}))
            numbers = (f"{x:.3f}" for x in (values.min(), values.mean(), values.max()))
            table.add_row(group.title, str(len(of)), *numbers, families)
    console.print(table)
    for point in sorted(result["points"], key=lambda point: point["similarity"]):
        line = f"{point['name']} {point['similarity']:.3f} {point['nearest']} ({GROUPS[point['group']].title})"
        console.print(line, highlight=False)
    console.print(f"made, solved and compared in {wall:.1f} s ({cpu:.1f} s of one core)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--unseen", nargs="+", default=["unseen50"])
    parser.add_argument("--training", nargs="+", default=["train75"])
    parser.add_argument("--policy")
    args = parser.parse_args()
    console = PlainConsole(width=None if PlainConsole().is_terminal else 130)
    if args.policy is not None:
        of_policy(args.policy, args.unseen, console)
        return
    unseen, training = (FieldBank.build(resolve_scenes(names), progress=True) for names in (args.unseen, args.training))
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("comparing", total=1.0)
        wall, cpu = time.perf_counter(), time.process_time()
        matrix = similarity_matrix(unseen, training, progress=lambda share: progress.update(task, completed=share))
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    best, which = matrix.max(axis=1), matrix.argmax(axis=1)
    counts, edges = np.histogram(best, bins=BINS)
    table = Table(title=f"similarity of {len(best)} unseen scenes to {matrix.shape[1]} training scenes")
    table.add_column("largest similarity", justify="right")
    table.add_column("scenes", justify="right")
    table.add_column("")
    for count, low, high in zip(counts, edges, edges[1:], strict=False):
        table.add_row(f"{low:.3f} - {high:.3f}", str(count), "█" * round(BAR_WIDTH * count / counts.max()))
    console.print(table)
    order = np.argsort(best)
    for what, rows in (("least", order[:3]), ("most", order[:-4:-1])):
        names = ", ".join(f"{unseen.names[i]} ({best[i]:.3f}, {training.names[which[i]]})" for i in rows)
        console.print(f"{what} alike: {names}")
    console.print(f"range {best.min():.3f} .. {best.max():.3f}; compared in {wall:.1f} s ({cpu:.1f} s of one core)")


if __name__ == "__main__":
    main()
