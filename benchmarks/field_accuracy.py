"""Fields against closed forms: free space, a wall, a slit, a beam, a sphere, and a maze whose shortest path is known.

    python -m benchmarks.field_accuracy [--resolutions 0.08 0.04 0.02]

The geodesic distance D and its gradient are judged at all free and reachable nodes, the signed distance s and the force
F at random free points between them. A point is smooth when the closed form takes the same bends 15 cm away from it in
every direction, and neither goal nor bend nor obstacle is nearer than that; there the order of the mean error between
the coarsest and the finest grid is printed. Exit status 1 when the order of D is below 1.8 although the error is above
1e-6 m, or when D at 4 cm is wrong by more than one voxel anywhere.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from rich.table import Table

from hotice.console import PlainConsole
from hotice.fields import FieldParams, build_hod_pf
from hotice.fields.geodesic.fast_marching import solve_geodesic
from hotice.fields.grid import Grid
from hotice.fields.potential import f_rep
from hotice.fields.solids import Space
from hotice.model import BoxShape, Obstacle, Scene, SphereShape

Points = NDArray[np.float64]
LEAST_ORDER = 1.8
EXACT_M = 1e-6
SMOOTH_M = 0.15
POINTS = 20_000


class Paths(NamedTuple):
    """Shortest paths of points (n, 3): length (n,) [m], last bend (n, 3) and which bend that is (n,)."""

    length: Points
    bend: Points
    which: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scene and the closed form of its shortest paths."""

    scene: Scene
    solve: Callable[[Points], Paths]


def walls(name: str, axis: int, rectangles: list[tuple[float, float, float, float]]) -> Case:
    """Boxes that fill the scene along `axis` (1 or 2); `rectangles` in the other two axes: low, low, high, high.

    In that plane paths are polylines over corners which see each other; along the axis they unfold to a straight line.
    """
    plane = [0, 3 - axis]
    obstacles = []
    for i, (x0, y0, x1, y1) in enumerate(rectangles):
        size, centre = [8.0] * 3, [0.0] * 3
        for a, low, high in zip(plane, (x0, y0), (x1, y1), strict=True):
            size[a], centre[a] = high - low, 0.5 * (low + high)
        obstacles.append(Obstacle(f"wall{i}", "side", BoxShape(tuple(size)), tuple(centre)))
    scene = Scene(name, obstacles=tuple(obstacles))
    boxes = np.array(rectangles).reshape(-1, 4)
    goal = scene.goal_W
    corners = np.vstack([goal[plane], boxes[:, [0, 1]], boxes[:, [0, 3]], boxes[:, [2, 1]], boxes[:, [2, 3]]])
    run = np.where(np.arange(len(corners)) == 0, 0.0, np.inf)
    for _ in corners:
        run = np.minimum(run, (_ways(corners, corners, boxes) + run).min(axis=1))

    def solve(p: Points) -> Paths:
        q = p[:, plane]
        ways = _ways(q, corners, boxes) + run
        which = ways.argmin(axis=1)
        flat, along = ways.min(axis=1), p[:, axis] - goal[axis]
        bend = np.empty_like(p)
        bend[:, plane] = corners[which]
        bend[:, axis] = goal[axis] + along * run[which] / np.maximum(flat, 1e-12)
        return Paths(np.hypot(flat, along), bend, which)

    return Case(scene=scene, solve=solve)


def _ways(q: Points, corners: Points, boxes: Points) -> Points:
    """Straight distance from points (n, 2) to corners (m, 2), inf where a box hides the corner, (n, m)."""
    d = corners - q[:, None]
    length = np.linalg.norm(d, axis=-1)
    low = np.broadcast_to(0.0, length.shape).copy()
    hidden = np.zeros(length.shape, dtype=bool)
    for box in boxes:
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (box[:2] + 1e-9 - q[:, None]) / d, (box[2:] - 1e-9 - q[:, None]) / d
        enter, leave = np.fmin(a, b).max(axis=-1), np.fmax(a, b).min(axis=-1)
        beside = ((d == 0) & ((q[:, None] <= box[:2]) | (q[:, None] >= box[2:]))).any(axis=-1)
        hidden |= (np.maximum(enter, low) < np.minimum(leave, 1.0)) & ~beside
    return np.where(hidden, np.inf, length)


def ball(centre: tuple[float, float, float], radius: float) -> Case:
    """A sphere: straight where it hides nothing, else two tangents and a great-circle arc."""
    scene = Scene("sphere", obstacles=(Obstacle("ball", "side", SphereShape(radius), centre),))
    g = scene.goal_W - centre
    far = np.linalg.norm(g)

    def solve(p: Points) -> Paths:
        q = p - centre
        r = np.linalg.norm(q, axis=1)
        side = q - (q @ g / far**2)[:, None] * g
        side /= np.maximum(np.linalg.norm(side, axis=1), 1e-12)[:, None]
        angle = np.arccos(np.clip(q @ g / (r * far), -1.0, 1.0))
        lift = np.arccos(np.minimum(radius / r, 1.0))
        arc = angle - np.arccos(radius / far) - lift
        hidden = arc > 0
        tangents = np.sqrt(far**2 - radius**2) + np.sqrt(np.maximum(r**2 - radius**2, 0.0))
        turn = (angle - lift)[:, None]
        leave = radius * (np.cos(turn) * g / far + np.sin(turn) * side) + centre
        length = np.where(hidden, tangents + radius * arc, np.linalg.norm(q - g, axis=1))
        return Paths(length, np.where(hidden[:, None], leave, scene.goal_W), hidden.astype(np.int64))

    return Case(scene=scene, solve=solve)


CASES = (
    walls("free space", 2, []),
    walls("wall", 2, [(0.9, -2.0, 1.1, 0.3)]),
    walls("thin wall", 2, [(0.995, -2.0, 1.005, 0.3)]),
    walls("slit", 2, [(0.98, -2.0, 1.02, 0.2), (0.98, 0.6, 1.02, 2.0)]),
    walls("beam", 1, [(0.9, 0.5, 1.1, 3.0)]),
    walls("maze", 2, [(0.3, -2.0, 0.4, 0.45), (0.9, -0.45, 1.0, 2.0), (1.5, -2.0, 1.6, 0.3)]),
    ball((0.9, 0.1, 0.7), 0.35),
)


def smooth(case: Case, p: Points) -> NDArray[np.bool_]:
    """Whether the closed form is smooth within 15 cm of points (n, 3)."""
    here = case.solve(p)
    good = (np.linalg.norm(p - here.bend, axis=1) > SMOOTH_M) & (case.scene.signed_distance(p) > SMOOTH_M)
    for direction in np.vstack([np.eye(3), -np.eye(3)]):
        good &= case.solve(p + SMOOTH_M * direction).which == here.which
    return good


def slope(paths: Paths, p: Points) -> Points:
    """Gradient of the closed form at p, (n, 3)."""
    away = p - paths.bend
    return away / np.maximum(np.linalg.norm(away, axis=1), 1e-12)[:, None]


def measure(case: Case, resolution_m: float) -> dict[str, float]:
    """Errors of one case on one grid."""
    scene = case.scene
    grid = Grid.of(scene, resolution_m)
    space = Space.of(scene, grid)
    value, gradient = solve_geodesic(space, 0.0, scene.goal_W)
    p = grid.points()[np.isfinite(value)]
    truth, good = case.solve(p), smooth(case, p)
    error = np.abs(value[np.isfinite(value)] - truth.length)
    cosine = (gradient[np.isfinite(value)] * slope(truth, p)).sum(axis=1).clip(-1.0, 1.0)
    angle = np.degrees(np.arccos(cosine))

    low, high = np.array(scene.bounds_m)
    q = np.random.default_rng(0).uniform(low + 0.05, high - 0.05, (POINTS, 3))
    q = q[scene.signed_distance(q) > 0]
    field, params = build_hod_pf(scene, resolution_m).sgf, FieldParams()
    s = np.minimum(scene.signed_distance(q), 10.0)
    steps = 1e-5 * np.eye(3)
    out = np.stack([scene.signed_distance(q + e) - scene.signed_distance(q - e) for e in steps], axis=-1) / 2e-5
    force = f_rep(s, params)[:, None] * np.nan_to_num(out) - params.attraction * slope(case.solve(q), q)
    wrong = np.linalg.norm(field.sample(q) - force, axis=1) / np.linalg.norm(force, axis=1)
    return {
        "max": error.max(),
        "mean": error.mean(),
        "smooth": error[good].mean(),
        "smooth max": error[good].max(),
        "angle": angle[good].mean(),
        "angle all": angle.mean(),
        "smooth share": good.mean(),
        "sdf": np.abs(field.signed_distance(q) - s).max(),
        "force": wrong[smooth(case, q)].mean(),
        "force all": float(np.median(wrong)),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--resolutions", type=float, nargs="+", default=[0.08, 0.04, 0.02], metavar="METRES")
    sizes = sorted(parser.parse_args().resolutions, reverse=True)
    console = PlainConsole(width=150)
    table = Table(title="errors against closed forms (smooth: 15 cm from goal, bends, obstacles and shadow lines)")
    columns = (
        "case",
        "grid [cm]",
        "D max [cm]",
        "[cells]",
        "D mean [mm]",
        "D smooth mean [mm]",
        "max [mm]",
        "order",
        "slope smooth [deg]",
        "all [deg]",
        "order",
        "sdf max [mm]",
        "F smooth [%]",
        "median [%]",
        "order",
    )
    for column in columns:
        table.add_column(column, justify="left" if column == "case" else "right")
    failed = []
    for case in track(CASES, description="solving", console=console):
        found = [measure(case, h) for h in sizes]
        for h, e in zip(sizes, found, strict=True):
            last = h == sizes[-1]
            orders = [_order(found, sizes, key) if last else "" for key in ("smooth", "angle", "force")]
            table.add_row(
                case.scene.name if h == sizes[0] else "",
                f"{100 * h:g}",
                f"{100 * e['max']:.3f}",
                f"{e['max'] / h:.2f}",
                f"{1e3 * e['mean']:.3f}",
                f"{1e3 * e['smooth']:.4f}",
                f"{1e3 * e['smooth max']:.3f}",
                orders[0],
                f"{e['angle']:.3f}",
                f"{e['angle all']:.3f}",
                orders[1],
                f"{1e3 * e['sdf']:.2f}",
                f"{100 * e['force']:.3f}",
                f"{100 * e['force all']:.3f}",
                orders[2],
                end_section=last,
            )
            if abs(h - 0.04) < 1e-9 and e["max"] > h:
                failed.append(f"{case.scene.name}: D at 4 cm is wrong by {e['max'] / h:.2f} voxels")
        order = _order(found, sizes, "smooth")
        if order not in ("", "exact") and float(order) < LEAST_ORDER:
            failed.append(f"{case.scene.name}: order {order} is below {LEAST_ORDER}")
    console.print(table)
    for line in failed:
        console.print(f"failed  {line}", style="red")
    return 1 if failed else 0


def _order(found: list[dict[str, float]], sizes: list[float], key: str) -> str:
    """Observed order of the errors `key` between the coarsest and the finest grid."""
    first, last = found[0][key], found[-1][key]
    if max(first, last) < EXACT_M:
        return "exact"
    return "" if len(sizes) < 2 else f"{np.log(first / max(last, 1e-300)) / np.log(sizes[0] / sizes[-1]):.2f}"


if __name__ == "__main__":
    sys.exit(main())
