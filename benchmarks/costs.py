"""Cost of each perturbation: the same trials of a policy again, each time without one source or parameter.

    python -m benchmarks.costs --policy student --scenes bench20 --rollouts 20 [--only physics gain] [--out costs.json]

Base: protocol `robot`, perturbed. A line switches one source off (`--without` of `hotice evaluate`), makes one
part of what is sensed exact, sets one parameter of the dynamics to the middle of its range, or takes one part of the
protocol from `paper`. Robots, starts
and objects stay the same trial by trial, so the difference is paired: gain ± 1.96 standard errors of it, won: trials
lost before, lost: trials won before. Noise and pushes of a block are drawn for all its trials at once, so they repeat
as long as the same trials run. Exact referee only.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from hotice.console import PlainConsole
from hotice.errors import HoticeError, UnknownName
from hotice.evaluate import Conditions, EvaluateConfig, Trials
from hotice.evaluate.scorer import Scorer, score_block
from hotice.evaluate.seeds import TrialSeeds
from hotice.files import write_text
from hotice.learn.policy import load_policy
from hotice.model.dynamics import FRICTIONS, PAPER_DYNAMICS, ROBOT_DYNAMICS, ROBOT_NOMINAL, DynamicsConfig
from hotice.progress import counted
from hotice.sim.physics.threads import one_thread
from hotice.task.config import TaskConfig
from hotice.task.perturbations import SOURCES
from hotice.task.protocols import PROTOCOLS
from hotice.task.sensing import SensingConfig

BASE = "all perturbations"
SENSES: Mapping[str, tuple[str, ...]] = {
    "root's place": ("root_pos_m",),
    "root's heading": ("root_yaw_rad",),
    "root": ("root_pos_m", "root_yaw_rad", "root_hz", "root_tracking"),
    "joints": ("joint_pos_rad", "joint_vel_rad_s"),
    "tilt": ("gravity", "gyro_rad_s"),
}
"""Parts of what is sensed that a line makes exact: fields of `SensingConfig`."""


@dataclass(frozen=True, kw_only=True)
class Sharper(Conditions):
    """Conditions in which fields of `SensingConfig` are exact."""

    exact: tuple[str, ...]

    def task(self, trained: dict[str, Any]) -> TaskConfig:
        """See `Conditions.task`."""
        task, exact = super().task(trained), SensingConfig()
        return replace(task, sensing=replace(task.sensing, **{name: getattr(exact, name) for name in self.exact}))


def variants() -> Mapping[str, Conditions]:
    """Conditions by name, `BASE` first."""
    robot, paper = PROTOCOLS["robot"], PROTOCOLS["paper"]

    def own(**parts: object) -> Conditions:
        return Conditions(protocol=replace(robot, **parts))

    out = {BASE: Conditions()} | {f"without {name}": Conditions(without=(name,)) for name in SOURCES}
    for field in fields(DynamicsConfig):
        middle = getattr(ROBOT_NOMINAL, field.name)
        if field.name in FRICTIONS:
            # a range without width: the other draws stay the same
            middle = middle or (0.5 * sum(getattr(ROBOT_DYNAMICS, field.name)),) * 2
        out[f"dynamics.{field.name} nominal"] = own(dynamics=replace(ROBOT_DYNAMICS, **{field.name: middle}))
    for name in ("palm_friction", "sole_friction", "torso_com_m"):
        changed = replace(ROBOT_DYNAMICS, **{name: getattr(PAPER_DYNAMICS, name)})
        out[f"paper's {name}"] = own(dynamics=changed)
    out |= {f"sensing.{name} exact": Sharper(exact=names) for name, names in SENSES.items()}
    palms = replace(ROBOT_DYNAMICS, palm_friction=PAPER_DYNAMICS.palm_friction)
    coarse = {"physics_dt_s": paper.physics_dt_s, "elliptic": paper.elliptic}
    return out | {"paper's physics, and its palms": own(**coarse, dynamics=palms)}


def score(job: tuple[EvaluateConfig, str, int]) -> Trials:
    """Trials of one scene under one variant."""
    config, name, number = job
    scorer, policy = Scorer.of(config), load_policy(config.policy or "", threads=1)
    scene = scorer.scenes[number]
    which = TrialSeeds.of(config.seed, scene).objects(config.rollouts, len(scorer.states))
    with one_thread():
        states = [scorer.states[k] for k in which]
        return score_block(policy, scene, states, config.seed, variants()[name], judges=("exact",))


def compared(base: Trials, other: Trials) -> dict[str, float]:
    """Success of `other`, its gain over the same trials of `base` with the standard error of that, and its parts."""
    pairs = [(a == "success", b == "success") for a, b in zip(base.outcome, other.outcome, strict=True)]
    count, won, lost = len(pairs), pairs.count((False, True)), pairs.count((True, False))
    gain = (won - lost) / count
    error = math.sqrt(max(0.0, (won + lost) / count - gain**2) / count)
    distance = sum(other.distance_m) / count
    return {
        "success": other.successes / count,
        "gain": gain,
        "error": error,
        "won": won,
        "lost": lost,
        "distance_m": distance,
    }


def measure(
    config: EvaluateConfig, names: Sequence[str], processes: int, out: Path | None
) -> dict[str, dict[str, float]]:
    """Results by variant, `BASE` first; `out` is written after each variant, so that what is done is not lost."""
    scenes = len(Scorer.of(config).scenes)
    results: dict[str, dict[str, float]] = {}
    base = None
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        for name in counted(names, "variants", len(names)):
            trials = Trials.joined(pool.map(score, [(config, name, scene) for scene in range(scenes)]))
            base = trials if base is None else base
            results[name] = compared(base, trials)
            if out:
                write_text(out, json.dumps(results, indent=1) + "\n")
    return results


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", default="student")
    parser.add_argument("--scenes", nargs="+", default=["bench20"])
    parser.add_argument("--rollouts", type=a_count, default=20, help="trials a scene")
    parser.add_argument("--shape", default="box", help="of the carried objects")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--processes", type=a_count, default=1)
    parser.add_argument("--only", nargs="+", default=[], help="variants whose name contains one of these")
    parser.add_argument("--out", type=Path, help="results as JSON")
    args = parser.parse_args(arguments)
    known = variants()
    try:
        unknown = [word for word in args.only if not any(word in name for name in known)]
        if unknown:
            raise UnknownName("variant", unknown[0], known)
        names = [n for n in known if n == BASE or not args.only or any(word in n for word in args.only)]
        config = EvaluateConfig(
            policy=args.policy,
            scenes=tuple(args.scenes),
            rollouts=args.rollouts,
            seed=args.seed,
            shapes=(args.shape,),
            referees=("exact",),
        )
        results = measure(config, names, args.processes, args.out)
    except HoticeError as error:
        print(f"costs: {error}", file=sys.stderr)
        return 2
    table = Table("", "Success", "Gain [points]", "Won", "Lost", "Distance [m]")
    for name, r in results.items():
        gain = "" if name == BASE else f"{100 * r['gain']:+.1f} ± {196 * r['error']:.1f}"
        table.add_row(name, f"{r['success']:.1%}", gain, str(r["won"]), str(r["lost"]), f"{r['distance_m']:.3f}")
    PlainConsole(width=None if sys.stdout.isatty() else 120).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
