"""The walking baseline: 2 m on the open floor, then the scenes of bench20 by category.

    python -m benchmarks.walk [--rollouts 100] [--scenes bench20] [--scene-rollouts 5] [--seed 0]

Success as the project scores policies (paper, V-A): the root comes within 0.1 m of the goal before any fall, drop or
collision of robot or object, exact geometry in every physics step; starts are spread by 3 cm and 0.1 rad, objects are
the evaluator's. The baseline walks slower than the policies, so each trial goes on to the horizon and is scored twice:
at 5 s, as the paper does, and at the horizon. The state is exact: no noise, delays or pushes.
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from hotice.console import PlainConsole
from hotice.control import TorquePlant
from hotice.control.walk import WalkConfig
from hotice.errors import HoticeError
from hotice.evaluate import Trials, run_trial, success_interval
from hotice.evaluate.config import PAPER_S
from hotice.evaluate.walk_trials import Trial
from hotice.fields import build_hod_pf
from hotice.model import CarryState, ObjectRange, Scene, builder, solve_carry
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.shipped import resolve_scenes
from hotice.task.rules import GOAL_M

PHYSICS_S, FINE_S = 0.005, 0.002
SETTLED_S = 1.0


def start_qpos(state: CarryState, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """Where the evaluator starts: the carry state at the scene's start, spread."""
    x, y, yaw = scene.start
    x, y = np.array([x, y]) + rng.uniform(-0.03, 0.03, 2)
    yaw = yaw + rng.uniform(-0.1, 0.1)
    turn = quat_from_yaw(yaw)
    qpos = state.qpos()
    offset = qpos[27:30] - qpos[:3]
    qpos[:2] = x, y
    qpos[3:7] = quat_mul(turn, qpos[3:7])
    qpos[27:30] = qpos[:3] + quat_rotate(turn, offset)
    qpos[30:34] = quat_mul(turn, qpos[30:34])
    qpos[7:19] += rng.uniform(-0.02, 0.02, 12)
    qpos[[2, 29]] += 0.008
    return qpos


def standing(scene: Scene, state: CarryState, seed: int, fine: bool) -> TorquePlant:
    """Robot, object and obstacles at a start drawn with a seed of its own."""
    dt = FINE_S if fine else PHYSICS_S
    model = builder.build_model(state.carried, scene, wrist_pos=state.wrist_pos, timestep_s=dt, elliptic=fine)
    plant = TorquePlant(model)
    plant.reset(start_qpos(state, scene, np.random.default_rng(seed)))
    return plant


def category(name: str) -> str:
    """`bench20/06_beam_across` -> `beam_across`."""
    return name.rsplit("/", 1)[-1].lstrip("0123456789_") or name


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rollouts", type=a_count, default=100, help="trials on the open floor")
    parser.add_argument("--scenes", nargs="*", default=["bench20"])
    parser.add_argument("--scene-rollouts", type=a_count, default=5, help="trials a scene")
    parser.add_argument("--horizon", type=float, default=12.0, help="longest trial [s]")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--fine", action="store_true", help="2 ms steps and elliptic cones")
    args = parser.parse_args()
    console, config = PlainConsole(width=150), WalkConfig()
    rng, ranges = np.random.default_rng(args.seed), ObjectRange()
    states: list[CarryState] = []
    while len(states) < max(args.rollouts, args.scene_rollouts):
        try:
            states.append(solve_carry(ranges.sample(rng)))
        except HoticeError:
            continue
    results: dict[str, list[Trial]] = {}
    for names, rollouts, stay in ((["open_floor"], args.rollouts, SETTLED_S), (args.scenes, args.scene_rollouts, 0.0)):
        for scene in resolve_scenes(names) if rollouts and names else []:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                pf = build_hod_pf(scene)
            trials = []
            for i in range(rollouts):
                seed = args.seed + i
                plant = standing(scene, states[i], seed, args.fine)
                trials.append(
                    run_trial(plant, scene, pf, states[i], config, args.horizon, first_foot=seed % 2, stay_s=stay)
                )
            results[scene.name] = trials
            causes = {o: [t.outcome for t in trials].count(o) for o in sorted({t.outcome for t in trials})}
            console.print(f"{scene.name}: {causes}", highlight=False)
    report(console, results, args.horizon)


def report(console: PlainConsole, results: dict[str, list[Trial]], horizon_s: float) -> None:
    """Two tables: by scene at 5 s and at the horizon, and by category."""
    groups = {}
    for name, trials in results.items():
        groups.setdefault(category(name), []).extend(trials)
    for title, rows in (("by scene", results), ("by category", groups)):
        table = Table(
            title=f"walking baseline, {title}: success and mean distance when scored "
            f"at {PAPER_S:g} s and at {horizon_s:g} s"
        )
        for column in (
            "scene",
            "trials",
            f"{PAPER_S:g} s",
            f"{horizon_s:g} s",
            "95 %",
            "m, 5 s",
            f"m, {horizon_s:g} s",
            "s",
            "m/s",
            "fall",
            "drop",
            "robot",
            "object",
            "late",
            "no plan",
            "fault",
        ):
            table.add_column(column, justify="right")
        for name, trials in rows.items():
            add_row(table, name, trials, horizon_s)
        if len(rows) > 1:
            add_row(table, "all scenes", [t for n, ts in rows.items() if n != "open_floor" for t in ts], horizon_s)
        console.print(table)
    spent = [t.step_ms for ts in results.values() for t in ts if t.step_ms > 0]
    if spent:
        console.print(f"controller {np.mean(spent):.2f} ms a step (mean of trials)")


def add_row(table: Table, name: str, trials: list[Trial], horizon_s: float) -> None:
    """One row of the report."""
    if not trials:
        return
    scored = []
    for horizon in (PAPER_S, horizon_s):
        outcome, distance, seconds = zip(*(t.at(horizon) for t in trials), strict=True)
        scored.append(Trials(outcome=outcome, distance_m=distance, time_s=seconds))
    short, full = scored
    low, high = success_interval(full.successes, full.rollouts)
    times = [t.time_s for t in trials if t.outcome == "success"]
    mean = float(np.mean(times)) if times else float("nan")
    counts = full.outcomes
    table.add_row(
        name.removeprefix("bench20/"),
        str(full.rollouts),
        f"{short.successes / short.rollouts:.0%}",
        f"{full.successes / full.rollouts:.0%}",
        f"{low:.0%}-{high:.0%}",
        f"{np.mean(short.distance_m):.2f}",
        f"{np.mean(full.distance_m):.2f}",
        f"{mean:.2f}",
        f"{(2.0 - GOAL_M) / mean:.2f}",
        *(str(counts.get(k, 0)) for k in ("fall", "drop", "robot_collision", "object_collision", "timeout", "no_plan")),
        str(sum(t.faults for t in trials)),
    )


if __name__ == "__main__":
    main()
