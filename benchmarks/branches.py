"""Branches against one run: success over wall time, on the same cores.

    python -m benchmarks.branches --minutes 120 --points 6 --init runs/student --out branches -- --perturbed --scan

Trains the same thing in three ways, one after another, each for `--minutes` on `--cores` cores:

- `one`: one process, all environments, as many threads as cores;
- `often` and `seldom`: as many branches as cores, of one thread and an equal share of the environments each, averaged
  every `--often` and `--seldom` environment steps of a branch.

What stands behind `--` goes to all trainings. After each `1 / points` of the time the policy that the run would export
is evaluated, always in the same trials; neither that nor what comes before the first update counts as time. What is
done stays in `--out`, and the same command goes on: `table.md` has the last points with their 95 % intervals,
`curves.json` all of them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.arguments import a_count, a_seed, a_time
from hotice.errors import HoticeError
from hotice.files import make_folder, write_text
from hotice.learn.checkpoints.checkpoint import list_checkpoints, read_meta, resolve
from hotice.machine import usable_cores

FORMAT = "hotice-branches/1"


@dataclass(frozen=True, kw_only=True)
class Point:
    """A policy on the way. interval: 95 %, of the success rate."""

    minutes: float
    steps: int
    updates: int
    success_rate: float
    interval: tuple[float, float]
    mean_distance_m: float


def ways(args: argparse.Namespace) -> dict[str, list[str]]:
    """Options of each way to train. Raises `HoticeError` where environments cannot be shared out."""
    if args.num_envs % args.cores:
        raise HoticeError(
            f"num-envs is {args.num_envs}: a multiple of the {args.cores} cores is needed, whose branches share them"
        )
    of_each = ["--branches", str(args.cores), "--num-envs", str(args.num_envs // args.cores), "--threads", "1"]
    return {
        "one": ["--num-envs", str(args.num_envs), "--threads", str(args.cores)],
        "often": [*of_each, "--merge-every", str(args.often)],
        "seldom": [*of_each, "--merge-every", str(args.seldom)],
    }


def train(args: argparse.Namespace, run: Path, options: Sequence[str], minutes: float) -> None:
    """Goes on with a run until it has trained so long in all."""
    before = float(read_meta(resolve(run))["minutes"]) if list_checkpoints(run) else 0.0
    if before >= minutes:
        return
    command = "train" if args.init is None else "finetune"
    begin = [] if args.init is None else ["--init", str(args.init)]
    same = ["--scenes", *args.scenes, "--seed", str(args.seed), *begin, *args.training]
    _hotice(command, "--out", str(run), "--resume", *options, "--max-minutes", str(minutes - before), *same)


def evaluate(args: argparse.Namespace, run: Path, report: Path) -> dict:
    """Report on the newest policy of a run."""
    _hotice(
        "evaluate",
        *("--policy", str(run), "--scenes", *args.test_scenes, "--rollouts", str(args.rollouts)),
        *("--seed", str(args.seed), "--threads", str(args.cores), "--referees", "exact", "--out", str(report)),
        *args.evaluation,
    )
    return json.loads(report.read_text(encoding="utf-8"))


def curve(args: argparse.Namespace, name: str, options: Sequence[str]) -> list[Point]:
    """Trains and evaluates in turn, from where an earlier call came to."""
    points: list[Point] = []
    for number in range(args.points):
        done = args.out / f"{name}-{number}.json"
        if not done.is_file():
            train(args, args.out / name, options, args.minutes * (number + 1) / args.points)
            report = evaluate(args, args.out / name, args.out / f"{name}-{number}-report.json")
            meta = read_meta(resolve(args.out / name))
            point = Point(
                minutes=meta["minutes"],
                steps=meta["steps"],
                updates=meta["update"],
                success_rate=report["success_rate"],
                interval=tuple(report["success_interval_95"]),
                mean_distance_m=report["mean_distance_m"],
            )
            write_text(done, json.dumps(asdict(point)) + "\n")
        points.append(Point(**json.loads(done.read_text(encoding="utf-8"))))
    return points


def table(args: argparse.Namespace, curves: dict[str, list[Point]]) -> str:
    """The last point of each way, as Markdown."""
    averaged = {"one": "–", "often": f"{args.often:,}", "seldom": f"{args.seldom:,}"}
    lines = [
        f"{args.minutes:g} minutes on {args.cores} cores, {args.num_envs} environments in all; "
        f"{args.rollouts} trials in each of {', '.join(args.test_scenes)}, seed {args.seed}.",
        "",
        "| Run | Averaged every [steps] | Steps | Updates | Success | 95 % | Distance [m] |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, points in curves.items():
        p = points[-1]
        lines.append(
            f"| {name} | {averaged[name]} | {p.steps:,} | {p.updates} | {p.success_rate:.1%} | "
            f"{p.interval[0]:.1%} to {p.interval[1]:.1%} | {p.mean_distance_m:.3f} |"
        )
    return "\n".join(lines) + "\n"


def _hotice(*argv: str) -> None:
    """Runs a command. Raises `HoticeError` where it fails."""
    done = subprocess.run([sys.executable, "-m", "hotice.learn", *argv], stdout=subprocess.DEVNULL)
    if done.returncode:
        raise HoticeError(f"hotice {' '.join(argv)}: status {done.returncode}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=a_time, required=True, help="training time of each way")
    parser.add_argument("--points", type=a_count, default=6, help="evaluations on the way")
    parser.add_argument("--cores", type=a_count, default=usable_cores())
    parser.add_argument("--num-envs", type=a_count, default=1024, help="environments of all processes together")
    parser.add_argument("--often", type=a_count, default=100_000)
    parser.add_argument("--seldom", type=a_count, default=2_000_000)
    parser.add_argument("--init", type=Path, help="a student to go on from (finetune); none: from nothing")
    parser.add_argument("--scenes", nargs="+", default=["bench20"])
    parser.add_argument("--test-scenes", nargs="+", help="as --scenes where not given")
    parser.add_argument("--rollouts", type=a_count, default=50, help="trials a scene")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--no-perturbed", dest="evaluation", action="store_const", const=["--no-perturbed"], default=[])
    parser.add_argument("--out", type=Path, default=Path("branches"))
    arguments = sys.argv[1:] if arguments is None else arguments
    split = arguments.index("--") if "--" in arguments else len(arguments)
    args = parser.parse_args(arguments[:split])
    args.training, args.test_scenes = arguments[split + 1 :], args.test_scenes or args.scenes
    try:
        make_folder(args.out)
        curves = {name: curve(args, name, options) for name, options in ways(args).items()}
        told = {name: getattr(args, name) for name in ("minutes", "cores", "num_envs", "often", "seldom", "seed")}
        told |= {"scenes": args.scenes, "test_scenes": args.test_scenes, "rollouts": args.rollouts}
        told |= {"init": None if args.init is None else str(args.init), "training": args.training}
        points = {name: [asdict(p) for p in curve] for name, curve in curves.items()}
        content = {"format": FORMAT, "options": told, "curves": points}
        write_text(args.out / "curves.json", json.dumps(content, indent=1) + "\n")
        write_text(args.out / "table.md", table(args, curves))
    except HoticeError as error:
        print(f"branches: {error}", file=sys.stderr)
        return 2
    print(table(args, curves), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
