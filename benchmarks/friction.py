"""Which palm friction in the coarse physics of training creeps as much as a given one in fine physics? Made
docs/contacts.md.

    python -m benchmarks.friction [--objects 30] [--seed 0] [--steps-ms 5 10]

Objects of each shape are held for five seconds as in `benchmarks.carry`. Slip falls with friction, so that between two
measured frictions of the coarse physics the one that slips as much is read off a line in log-log; "–": beyond the
range.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np
from rich.progress import track
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from benchmarks.carry import hold
from hotice.console import PlainConsole
from hotice.errors import CarryInfeasible
from hotice.model import CarryState, ObjectRange, solve_carry
from hotice.model.carry import Posture
from hotice.model.object_range import SHAPES

FINE_S = 0.002
FINE = (0.6, 0.8, 1.0, 1.2)
COARSE = (0.8, 1.2, 1.6, 2.0, 2.5, 3.2, 4.0, 6.0)


def states(shape: str, count: int, seed: int) -> list[CarryState]:
    """Carry states of random objects of a shape; those that cannot be held are left out."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        posture = Posture(pelvis_height_m=rng.uniform(0.60, 0.77), lean_rad=rng.uniform(0.0, 0.2))
        try:
            found.append(solve_carry(ObjectRange(shapes=(shape,)).sample(rng), posture))
        except CarryInfeasible:
            continue
    return found


def slips(shape: str, step_s: float, elliptic: bool, friction: float, count: int, seed: int) -> np.ndarray:
    """Slip of each object [m], at least 10 cm where it was lost."""
    rng = np.random.default_rng([seed, 1])
    held = [
        hold(s, rng, timestep_s=step_s, elliptic=elliptic, palm_friction=friction) for s in states(shape, count, seed)
    ]
    return np.array([slip if ok else max(slip, 0.1) for ok, slip in held])


def equal_friction(friction: np.ndarray, slip: np.ndarray, wanted: float) -> float | None:
    """Where a falling curve of median slip over friction passes `wanted`, or None outside."""
    falling = np.minimum.accumulate(slip)
    if not falling[-1] <= wanted <= falling[0]:
        return None
    return float(np.exp(np.interp(-np.log(wanted), -np.log(falling), np.log(friction))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=a_count, default=30)
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--steps-ms", type=float, nargs="+", default=[5.0])
    parser.add_argument("--workers", type=a_count, default=2)
    args = parser.parse_args()
    runs = [(shape, FINE_S, True, f) for shape, f in product(SHAPES, FINE)]
    runs += [(shape, ms / 1e3, False, f) for shape, ms, f in product(SHAPES, args.steps_ms, COARSE)]
    console = PlainConsole(width=120)
    with ProcessPoolExecutor(args.workers) as pool:
        futures = [pool.submit(slips, *run, args.objects, args.seed) for run in runs]
        found = {run: f.result() for run, f in zip(track(runs, "holding", console=console), futures, strict=True)}
    raw = Table(title=f"median slip in 5 s [mm] (lost of {args.objects})")
    for column in ("shape", "physics", *(f"{f:g}" for f in sorted({*FINE, *COARSE}))):
        raw.add_column(column, justify="right")
    for shape in SHAPES:
        for step, elliptic in ((FINE_S, True), *((ms / 1e3, False) for ms in args.steps_ms)):
            cells = []
            for friction in sorted({*FINE, *COARSE}):
                slip = found.get((shape, step, elliptic, friction))
                lost = "" if slip is None else int((slip >= 0.1).sum())
                cells.append("" if slip is None else f"{1e3 * np.median(slip):.1f}" + (f" ({lost})" if lost else ""))
            raw.add_row(shape, f"{1e3 * step:g} ms, {'elliptic' if elliptic else 'pyramidal'}", *cells)
    console.print(raw)
    equal = Table(title="friction that slips as much in coarse physics")
    for column in ("shape", "physics", *(f"fine {f:g}" for f in FINE)):
        equal.add_column(column, justify="right")
    for shape, ms in product(SHAPES, args.steps_ms):
        curve = np.array([np.median(found[shape, ms / 1e3, False, f]) for f in COARSE])
        same = [equal_friction(np.array(COARSE), curve, float(np.median(found[shape, FINE_S, True, f]))) for f in FINE]
        equal.add_row(shape, f"{ms:g} ms, pyramidal", *("–" if s is None else f"{s:.2f}" for s in same))
    console.print(equal)


if __name__ == "__main__":
    main()
