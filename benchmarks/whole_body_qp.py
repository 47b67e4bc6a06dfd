"""How long does the whole-body QP take? Over the states of one pick-up, with the object in hand for half of the time.

    python -m benchmarks.whole_body_qp [--solver proxqp osqp osqp:1e-4] [--repeat 3] [--elapsed]

A solver may be given a tolerance of its own; torques are compared with those of the first.

The states, tasks and contacts of every step are recorded from a simulated pick-up with noise, then solved again in
their order from a warm start, alone. Time is that of the process (what other processes take does not count); --elapsed
uses the clock on the wall. Use one core: OMP_NUM_THREADS=1 taskset -c 0.
"""

from __future__ import annotations

import argparse
import copy
import time

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count
from benchmarks.pickup import NEAR_M, Trial, run
from hotice.console import PlainConsole
from hotice.control.pick_plan import Grip, Support
from hotice.control.whole_body import SOLVERS, QpConfig, WholeBodyQp
from hotice.model import Box


def record() -> tuple[list, np.ndarray]:
    """(measurement, targets, contacts) of every solve of a pick-up, and the wrist angles of its robot."""
    trial = Trial(
        carried=Box((0.30, 0.28, 0.30), 2.0),
        top_m=0.66,
        inset_m=0.015,
        lateral_m=0.02,
        yaw_rad=0.1,
        friction=1.5,
        seed=1,
    )
    rows, solve = [], WholeBodyQp.solve

    def spy(self, measurement, targets, contacts, memory, **options):
        rows.append((measurement, copy.deepcopy(targets), copy.deepcopy(contacts)))
        return solve(self, measurement, targets, contacts, memory, **options)

    WholeBodyQp.solve = spy
    try:
        result = run(trial)
    finally:
        WholeBodyQp.solve = solve
    if result.cause:
        raise SystemExit(f"the pick-up failed: {result.cause}")
    return rows, Grip(carried=trial.carried, support=Support(top_m=trial.top_m, near_m=NEAR_M)).wrist_pos


def solver(text: str) -> tuple[str, float | None]:
    """`name` or `name:tolerance`."""
    name, _, tolerance = text.partition(":")
    if name not in SOLVERS:
        raise argparse.ArgumentTypeError(f"unknown solver {name!r}: known are {', '.join(sorted(SOLVERS))}")
    return name, float(tolerance) if tolerance else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--solver", type=solver, nargs="+", default=[solver(s) for s in ("proxqp", "osqp", "osqp:1e-4")]
    )
    parser.add_argument("--repeat", type=a_count, default=3)
    parser.add_argument("--elapsed", action="store_true", help="elapsed time in place of the time of the process")
    args = parser.parse_args()
    clock = time.perf_counter if args.elapsed else time.process_time
    rows, wrist = record()
    table = Table(title=f"{len(rows)} states, each {args.repeat} times")
    for column in (
        "solver",
        "mean [ms]",
        "median [ms]",
        "p99 [ms]",
        "worst [ms]",
        "of it terms and assembly [ms]",
        "torque off, median, p99 [N m]",
        "faults",
    ):
        table.add_column(column, justify="right")
    first: list[np.ndarray] = []
    for name, tolerance in args.solver:
        qp = WholeBodyQp(wrist, QpConfig(solver=name, tolerance=tolerance))
        spent, faults, assembly, torques = [], 0, [], []
        for _ in range(args.repeat):
            memory, torques = qp.start(rows[0][0]), []
            for measurement, targets, contacts in rows:
                begin = clock()
                torque = qp.solve(measurement, targets, contacts, memory)
                spent.append(clock() - begin)
                torques.append(torque.copy())
            faults += memory.faults
        first = first or torques
        off = np.abs(np.array(torques) - np.array(first)).max(axis=1)
        for measurement, targets, contacts in rows:
            begin = clock()
            qp.terms.update(measurement)
            qp.assemble(targets, contacts)
            assembly.append(clock() - begin)
        ms = 1e3 * np.array(spent)
        label = name if tolerance is None else f"{name}:{tolerance:g}"
        times = [f"{ms.mean():.3f}", f"{np.median(ms):.3f}", f"{np.percentile(ms, 99):.3f}", f"{ms.max():.2f}"]
        away = f"{np.median(off):.3f}, {np.percentile(off, 99):.2f}"
        table.add_row(label, *times, f"{1e3 * np.mean(assembly):.3f}", away, str(faults))
    PlainConsole(width=150).print(table)


if __name__ == "__main__":
    main()
