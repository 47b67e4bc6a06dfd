"""How long does the whole-body QP take? Over the states of one pick-up, with the object in hand for half of the time.

    python -m benchmarks.whole_body_qp [--solver proxqp|osqp] [--repeat 3] [--elapsed]

The states, tasks and contacts of every step are recorded from a simulated pick-up with noise, then solved again in their order
from a warm start, alone. Time is that of the process (what other processes take does not count); --elapsed uses the clock on
the wall. Use one core: OMP_NUM_THREADS=1 taskset -c 0.
"""

from __future__ import annotations

import argparse
import copy
import time

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.pickup import NEAR_M, Trial, run
from hotice.control.pick_plan import Support
from hotice.control.pick_plan.grip import Grip
from hotice.control.solvers import SOLVERS
from hotice.control.whole_body_qp import QpConfig, WholeBodyQp
from hotice.model.objects import Box


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--solver", choices=sorted(SOLVERS), nargs="*", default=sorted(SOLVERS))
    parser.add_argument("--repeat", type=int, default=3)
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
        "faults",
    ):
        table.add_column(column, justify="right")
    for name in args.solver:
        qp = WholeBodyQp(wrist, QpConfig(solver=name))
        spent, faults, assembly = [], 0, []
        for _ in range(args.repeat):
            memory = qp.start(rows[0][0])
            for measurement, targets, contacts in rows:
                begin = clock()
                qp.solve(measurement, targets, contacts, memory)
                spent.append(clock() - begin)
            faults += memory.faults
        for measurement, targets, contacts in rows:
            begin = clock()
            qp.terms.update(measurement)
            qp.assemble(targets, contacts)
            assembly.append(clock() - begin)
        ms = 1e3 * np.array(spent)
        table.add_row(
            name, f"{ms.mean():.3f}", f"{np.median(ms):.3f}", f"{np.percentile(ms, 99):.3f}", f"{ms.max():.2f}",
            f"{1e3 * np.mean(assembly):.3f}", str(faults),
        )  # fmt: skip
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
