"""Building, sampling and storing fields, side by side with the obvious ways.

    python -m benchmarks.fields [--scenes 256] [--cache FOLDER]

1. Both fields of one scene against, per field, scipy's EDT inside and outside plus scikit-fmm's distance and travel
   time (order 2, obstacles masked): at most 1/4 of the time, over the shipped scenes.
2. Both fields and the signed distance at 1 M random points against `torch.nn.functional.grid_sample` on the CPU with
   the same threads and channels (distance and its gradient, both geodesics and theirs): at least 3 times as fast.
3. A bank of scenes, built once and opened again from its cache; and what 2,000 scenes of the default grid take.

Times are the best of interleaved repetitions. Exit status 1 when a ratio fails.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import skfmm
import torch
from rich.table import Table
from scipy import ndimage

from benchmarks.arguments import a_count
from hotice.console import PlainConsole
from hotice.fields import FieldBank, build_hod_pf
from hotice.fields.volumes import NODE_BYTES
from hotice.model import Scene, load_scene, shipped_scenes
from hotice.model.generate import family_from_text

H, MARGIN_M = 0.04, 0.08
BUILD_SHARE, SAMPLE_RATIO, MEMORY = 0.25, 3.0, 8 * 2**30
POINTS = 1_000_000


def best(repetitions: int, *ways: Callable[[], object]) -> list[float]:
    """Shortest time of each way [s], run in turns."""
    times = [[] for _ in ways]
    for _ in range(repetitions):
        for way, found in zip(ways, times, strict=True):
            begin = time.perf_counter()
            way()
            found.append(time.perf_counter() - begin)
    return [min(t) for t in times]


def pipeline(scene: Scene, sdf: np.ndarray, shape: tuple[int, int, int], p_W: np.ndarray) -> None:
    """Both fields the obvious way; `sdf` only says which voxels are occupied."""
    phi = (np.linalg.norm(p_W - scene.goal_W, axis=1) - 0.12).reshape(shape)
    for margin in (0.0, MARGIN_M):
        occupied = (sdf <= margin).reshape(shape)
        _ = ndimage.distance_transform_edt(~occupied, H) - ndimage.distance_transform_edt(occupied, H)
        masked = np.ma.MaskedArray(phi, occupied)
        skfmm.distance(masked, dx=H, order=2)
        skfmm.travel_time(masked, np.ones(shape), dx=H, order=2)


def building(table: Table) -> bool:
    total = np.zeros(2)
    for name in shipped_scenes():
        scene = load_scene(name)
        pf = build_hod_pf(scene, H, MARGIN_M)
        p_W = pf.grid.points()
        sdf = pf.sgf.signed_distance(p_W)
        theirs, ours = best(
            5,
            lambda s=scene, d=sdf, g=pf.grid, p=p_W: pipeline(s, d, g.shape, p),
            lambda s=scene: build_hod_pf(s, H, MARGIN_M),
        )
        total += theirs, ours
        table.add_row(f"build {name}", f"{1e3 * theirs:.0f} ms", f"{1e3 * ours:.0f} ms", f"{ours / theirs:.2f}", "")
    share = total[1] / total[0]
    mark = f"<= {BUILD_SHARE}"
    table.add_row("build, all of these", f"{1e3 * total[0]:.0f} ms", f"{1e3 * total[1]:.0f} ms", f"{share:.2f}", mark)
    return share <= BUILD_SHARE


def sampling(table: Table) -> bool:
    scene = load_scene("pillars")
    bank = FieldBank.build([scene], H, MARGIN_M)
    low, high = np.array(scene.bounds_m)
    p_W = torch.from_numpy(np.random.default_rng(0).uniform(low, high, (1, POINTS, 3)).astype(np.float32))
    ids = torch.zeros(1, dtype=torch.int64)
    channels = torch.randn(1, 3 + 1 + 2 * 4, *bank.volumes.shape[0].tolist())
    where = (2 * (p_W - torch.tensor(low)) / torch.tensor(high - low) - 1).float().flip(-1).reshape(1, 1, 1, -1, 3)

    def theirs() -> None:
        torch.nn.functional.grid_sample(channels, where, align_corners=False)

    def ours() -> None:
        bank.sample("sgf", ids, p_W)
        bank.sample("ogf", ids, p_W)
        bank.signed_distance(ids, p_W)

    ours()
    a, b = best(5, theirs, ours)
    table.add_row(
        "1 M points, both F, D, s", f"{1e3 * a:.0f} ms", f"{1e3 * b:.0f} ms", f"{a / b:.1f} x", f">= {SAMPLE_RATIO:g} x"
    )
    return a / b >= SAMPLE_RATIO


def storing(table: Table, scenes: int, folder: Path) -> bool:
    chosen = family_from_text(f"mixed:{scenes}")

    def build() -> FieldBank:
        return FieldBank.build(chosen, H, MARGIN_M, progress=True, cache=folder)

    (first,) = best(1, build)
    (again,) = best(1, build)
    per_scene = NODE_BYTES * 75 * 50 * 38
    table.add_row(f"bank of {scenes}", "", f"{first:.1f} s", f"{1e3 * first / scenes:.0f} ms a scene", "")
    table.add_row("the same from its cache", "", f"{again:.2f} s", "", "")
    table.add_row("2,000 scenes", "", f"{2000 * per_scene / 2**30:.2f} GiB", "", "<= 8 GiB")
    return 2000 * per_scene <= MEMORY


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=a_count, default=256)
    parser.add_argument("--cache", type=Path, help="folder of solved scenes (default: a new, temporary one)")
    args = parser.parse_args()
    table = Table(title=f"fields on {torch.get_num_threads()} threads")
    for column in ("what", "obvious way", "hotice", "ratio", "bar"):
        table.add_column(column, justify="left" if column == "what" else "right")
    with tempfile.TemporaryDirectory() as temporary:
        passed = [building(table), sampling(table), storing(table, args.scenes, args.cache or Path(temporary))]
    console = PlainConsole()
    console.print(table)
    for name, ok in zip(("building", "sampling", "memory"), passed, strict=True):
        if not ok:
            console.print(f"failed  {name}", style="red")
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
