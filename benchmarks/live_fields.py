"""Rate, age and equality of live fields, and what queries pay while fields are built.

    python -m benchmarks.live_fields [--scenes bench20] [--moves 50] [--checked 10] [--seconds 5] [--seed 0]

In each scene one obstacle after another is moved by up to 0.2 m along x and y, `--moves` times; each pair of fields is
awaited before the next move. "rebuilt": both fields of the same obstacles in this process, on one thread. Every so many
(`--checked`) pairs are compared with that at 2,000 points. Queries are of 11 points, as one control step makes them,
for `--seconds` while the worker rests and as long while it builds without a pause.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from hotice.console import PlainConsole
from hotice.errors import HoticeError, InvalidScene
from hotice.fields import LiveField
from hotice.fields.hod_pf import HodPf, hod_pf_of
from hotice.fields.volumes import solve_scene
from hotice.files import write_text
from hotice.model.scene import Quat, Scene, Vec3
from hotice.model.shipped import resolve_scenes
from hotice.progress import counted

REACH_M = 0.2
POINTS = 2000
KEYPOINTS = 11


def moves(scene: Scene, count: int, rng: np.random.Generator) -> Iterator[dict[str, tuple[Vec3, Quat]]]:
    """Obstacles near where they were, one at a time."""
    for k in range(count):
        obstacle = scene.obstacles[k % len(scene.obstacles)]
        x, y, z = obstacle.position_m
        dx, dy = rng.uniform(-REACH_M, REACH_M, 2).tolist()
        yield {obstacle.name: ((x + dx, y + dy, z), obstacle.quaternion_wxyz)}


def difference(mine: HodPf, fresh: HodPf, rng: np.random.Generator) -> float:
    """Largest difference of force [m/s] and distances [m] of both fields at random points."""
    low, high = mine.scene.bounds_m
    p_W = rng.uniform(low, high, (POINTS, 3))
    pairs = [
        pair
        for a, b in ((mine.sgf, fresh.sgf), (mine.ogf, fresh.ogf))
        for pair in zip(a.query(p_W), b.query(p_W), strict=True)
    ]
    return max(float(np.abs(a - b).max()) for a, b in pairs)


def follow(live: LiveField, scene: Scene, count: int, checked: int, rng: np.random.Generator) -> dict[str, list[float]]:
    """Times [s] and differences over so many moves."""
    result: dict[str, list[float]] = {"live_s": [], "cost_s": [], "rebuilt_s": [], "difference": []}
    for k, poses in enumerate(moves(scene, count, rng)):
        built = live.wait(live.move(poses))
        result["live_s"].append(built.ready_s - built.given_s)
        result["cost_s"].append(built.cost_s)
        if k % checked == 0:
            begin = time.perf_counter()
            nodes = solve_scene(live.scene, live.grid.resolution_m, (0.0, live.margin_m), 1)
            fresh = hod_pf_of(live.scene, nodes, live.margin_m, live.params)
            result["rebuilt_s"].append(time.perf_counter() - begin)
            result["difference"].append(difference(built.fields, fresh, rng))
    return result


def query_times(live: LiveField, seconds: int, busy: bool, rng: np.random.Generator) -> list[float]:
    """Times of queries [s], at rest or while the worker always has a newer scene to build."""
    p_W = rng.uniform(*live.scene.bounds_m, (KEYPOINTS, 3))
    times, obstacles, end = [], live.obstacles, time.perf_counter() + seconds
    while time.perf_counter() < end:
        if busy and not live.behind_s:
            live.show(obstacles)
        begin = time.perf_counter()
        live.sgf.query(p_W)
        times.append(time.perf_counter() - begin)
    live.wait()
    return times


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["bench20"])
    parser.add_argument("--moves", type=a_count, default=50, help="of each scene")
    parser.add_argument(
        "--checked", type=a_count, default=10, help="every so many pairs are compared with a fresh build"
    )
    parser.add_argument("--seconds", type=a_count, default=5, help="of queries, worker idle and busy")
    parser.add_argument("--threads", type=a_count, default=1, help="of the worker")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--out", type=Path, help="figures as JSON")
    args = parser.parse_args(arguments)
    console, rng = PlainConsole(width=None if sys.stdout.isatty() else 120), np.random.default_rng(args.seed)
    try:
        scenes = [scene for scene in resolve_scenes(args.scenes) if scene.obstacles]
        if not scenes:
            raise InvalidScene(f"no obstacles in {', '.join(args.scenes)}: scenes with something to move are needed")
    except HoticeError as error:
        print(f"live_fields: {error}", file=sys.stderr)
        return 2
    figures: dict[str, dict[str, list[float]]] = {}
    table = Table("scene", "ready after [ms]: median, p95", "CPU [ms]", "rebuilt [ms]", "pairs/s", "largest difference")
    for scene in counted(scenes, "scenes", len(scenes)):
        with LiveField(scene, threads=args.threads) as live:
            live.wait(live.show(scene.obstacles))
            found = figures[scene.name] = follow(live, scene, args.moves, args.checked, rng)
            if scene is scenes[-1]:
                figures["queries"] = {k: query_times(live, args.seconds, k == "busy", rng) for k in ("idle", "busy")}
        ms = {key: 1e3 * np.array(values) for key, values in found.items()}
        table.add_row(
            scene.name,
            f"{np.median(ms['live_s']):.1f}, {np.percentile(ms['live_s'], 95):.1f}",
            f"{np.median(ms['cost_s']):.1f}",
            f"{np.median(ms['rebuilt_s']):.1f}",
            f"{1e3 / ms['live_s'].mean():.1f}",
            f"{max(found['difference']):.1e}",
        )
    console.print(table)
    for name, times in figures["queries"].items():
        median, p99 = 1e6 * np.percentile(times, (50, 99))
        console.print(f"a query of {KEYPOINTS} points, worker {name}: median {median:.1f} us, p99 {p99:.1f} us")
    if args.out:
        write_text(args.out, json.dumps(figures) + "\n")
    return 0 if max(max(f["difference"]) for name, f in figures.items() if name != "queries") <= 1e-6 else 1


if __name__ == "__main__":
    sys.exit(main())
