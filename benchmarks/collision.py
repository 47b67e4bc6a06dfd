"""Collision queries: their speed beside python-fcl, and what the training's sphere cover misses or invents beside them.

`python -m benchmarks.collision [--states 10000] [--seed 0]`; exit status 1 if a bar fails:
25 robot × 30 obstacle primitives in at most 1 ms, and no penetration deeper than 1 cm missed by the cover.

Cover: random carry states, joints, heading and lean near single obstacles of all kinds, bars and plates of 2 cm
included. Exact distances come from `hotice.model.collision`, the cover's from the environment that training runs.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
import torch
from rich.progress import Progress
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from hotice.console import PlainConsole
from hotice.fields import FieldBank
from hotice.model import (
    Box,
    BoxShape,
    CarriedObject,
    CarryState,
    CollisionChecker,
    Cylinder,
    CylinderShape,
    Obstacle,
    RobotState,
    Scene,
    Sphere,
    SphereShape,
    solve_carry,
)
from hotice.model.carry import Posture
from hotice.model.collision_geometry import OBJECT_OBSTACLE, ROBOT_OBSTACLE
from hotice.model.frames import normalize, quat_from_yaw, quat_mul, quat_rotate
from hotice.model.geometry import CapsuleShape, Shape
from hotice.sim import CarryBank, TransportEnv

BAR_MS, BAR_PAIRS = 1.0, 25 * 30
BAR_DEPTH_M = 0.01
PER_SCENE = 100
PLACE = np.array([0.9, 0.0])
OBJECTS: tuple[CarriedObject, ...] = (
    Box((0.3, 0.3, 0.3), 1.0),
    Box((0.36, 0.36, 0.38), 1.5),
    Box((0.24, 0.36, 0.22), 3.0),
    Box((0.4, 0.4, 0.4), 1.0),
    Cylinder(0.13, 0.3, 1.5),
    Cylinder(0.18, 0.4, 1.5),
    Sphere(0.14, 1.2),
)
SHAPES: tuple[Callable[[np.random.Generator], Shape], ...] = (
    lambda rng: BoxShape(tuple(rng.uniform(0.08, 0.5, 3))),
    lambda rng: CylinderShape(rng.uniform(0.03, 0.15), rng.uniform(0.3, 1.2)),
    lambda rng: SphereShape(rng.uniform(0.05, 0.2)),
    lambda rng: CapsuleShape(rng.uniform(0.03, 0.08), rng.uniform(0.2, 0.8)),
    lambda rng: BoxShape((0.04, rng.uniform(0.3, 1.0), 0.04)),
    lambda rng: CylinderShape(0.02, rng.uniform(0.5, 1.2)),
    lambda rng: BoxShape((0.02, *rng.uniform(0.3, 1.0, 2))),
    lambda rng: BoxShape(tuple(rng.uniform(0.5, 1.0, 3))),
)


def best_ms(run: dict[str, Callable[[], object]], repeats: int = 40) -> dict[str, float]:
    """Shortest time of each, run in turn."""
    times = {name: np.inf for name in run}
    for _ in range(repeats):
        for name, f in run.items():
            begin = time.perf_counter()
            f()
            times[name] = min(times[name], 1e3 * (time.perf_counter() - begin))
    return times


def cluttered(count: int, rng: np.random.Generator) -> Scene:
    """A scene of `count` random primitives beside the way."""
    obstacles = tuple(
        Obstacle(
            f"o{i}",
            "side",
            SHAPES[i % 4](rng),
            (rng.uniform(-0.4, 2.4), rng.choice([-1, 1]) * 1.2, rng.uniform(0.2, 1)),
            tuple(normalize(rng.normal(size=4))),
        )
        for i in range(count)
    )
    return Scene("cluttered", obstacles=obstacles)


def fcl_loop(checker: CollisionChecker, state: RobotState) -> Callable[[], np.ndarray]:
    """The same distances by a Python loop over python-fcl objects, placed beforehand."""
    import coal
    import fcl

    checker.query(state)
    make = {
        coal.Box: lambda g: fcl.Box(*(2 * g.halfSide)),
        coal.Sphere: lambda g: fcl.Sphere(g.radius),
        coal.Cylinder: lambda g: fcl.Cylinder(g.radius, 2 * g.halfLength),
        coal.Capsule: lambda g: fcl.Capsule(g.radius, 2 * g.halfLength),
    }
    geometry, placed = checker.geometry
    objects = [
        fcl.CollisionObject(make[type(o.geometry)](o.geometry), fcl.Transform(X_WG.rotation, X_WG.translation))
        for o, X_WG in zip(geometry.geometryObjects, placed, strict=True)
    ]
    pairs = [(objects[p.first], objects[p.second]) for p in geometry.collisionPairs]
    request = fcl.DistanceRequest()
    return lambda: np.array([fcl.distance(a, b, request, fcl.DistanceResult()) for a, b in pairs])


def time_queries(console: PlainConsole, seed: int) -> bool:
    """Prints the speed table; whether the bar holds."""
    rng = np.random.default_rng(seed)
    state = RobotState.from_carry(solve_carry(OBJECTS[0]))
    table = Table(title="distances of all robot geometries to all obstacles, best of 40, one thread")
    for column in ("pairs", "hotice [ms]", "+ witness points [ms]", "python-fcl loop [ms]", "largest difference [m]"):
        table.add_column(column, justify="right")
    good = True
    for count in (13, 30):
        checker = CollisionChecker(cluttered(count, rng), kinds=(ROBOT_OBSTACLE,))
        loop = fcl_loop(checker, state)
        distance = checker.query(state).distance
        times = best_ms(
            {"query": lambda c=checker: c.query(state), "witness": lambda c=checker: c.query(state).p_WA, "fcl": loop}
        )
        if len(distance) < 2 * BAR_PAIRS:
            good = times["query"] <= BAR_MS
        table.add_row(
            f"{len(distance):,}",
            *(f"{times[k]:.2f}" for k in ("query", "witness", "fcl")),
            f"{np.abs(distance - loop())[distance > 0].max():.1e}",
        )
    console.print(table)
    console.print(
        f"bar: {BAR_PAIRS} pairs in {BAR_MS:g} ms: {'ok' if good else 'MISSED'} (the first row holds more pairs)"
    )
    return good


def carry_states() -> list[CarryState]:
    """Each object in two postures."""
    return [solve_carry(o, p) for o in OBJECTS for p in (Posture(), Posture(pelvis_height_m=0.65, lean_rad=0.15))]


def single_obstacle(index: int, rng: np.random.Generator) -> Scene:
    """A scene whose one obstacle, of the kind `index` in turn, hangs at `PLACE`, every second one upright."""
    quat = (1.0, 0.0, 0.0, 0.0) if index // len(SHAPES) % 2 else tuple(normalize(rng.normal(size=4)))
    place = (*PLACE, rng.uniform(0.1, 1.2))
    obstacle = Obstacle("it", "side", SHAPES[index % len(SHAPES)](rng), place, quat)
    return Scene(f"{index}", ((-1.0, -1.5, 0.0), (2.6, 1.5, 1.6)), (-0.9, 0.0, 0.0), (2.4, 1.2), (obstacle,))


def random_qpos(states: list[CarryState], which: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Disturbed carry states near `PLACE`, (n, 34): joints ± 0.3 rad, any heading, leaning and turned a little."""
    qpos, n = np.array([states[i].qpos() for i in which]), len(which)
    qpos[:, 7:27] += rng.uniform(-0.3, 0.3, (n, 20))
    root = np.column_stack(
        [PLACE - rng.uniform([-0.7, -0.5], [0.5, 0.5], (n, 2)), qpos[:, 2] + rng.uniform(0, 0.05, n)]
    )
    turn = quat_mul(
        quat_from_yaw(rng.uniform(-np.pi, np.pi, n)), normalize([1, 0, 0, 0] + 0.03 * rng.normal(size=(n, 4)))
    )
    qpos[:, 27:30] = root + quat_rotate(turn, qpos[:, 27:30] - qpos[:, :3])
    qpos[:, :3] = root
    qpos[:, 3:7] = quat_mul(turn, qpos[:, 3:7])
    qpos[:, 30:34] = quat_mul(turn, normalize(qpos[:, 30:34] + 0.1 * rng.normal(size=(n, 4))))
    return qpos


def compare_cover(count: int, seed: int, console: PlainConsole) -> tuple[np.ndarray, np.ndarray]:
    """Exact distance and clearance of the cover in `count` states, (count, 2) each: robot, object [m]."""
    rng = np.random.default_rng(seed)
    states = carry_states()
    carry = CarryBank.of(states, 0.005, torch.device("cpu"))
    exact, cover = np.empty((count, 2)), np.empty((count, 2))
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("states", total=count)
        for start in range(0, count, PER_SCENE):
            rows = range(start, min(start + PER_SCENE, count))
            scene = single_obstacle(start // PER_SCENE, rng)
            env = TransportEnv(len(rows), FieldBank.build([scene], workers=1), carry, threads=1)
            which = rng.integers(len(states), size=len(rows))
            qpos = random_qpos(states, which, rng)
            env.memory.model[:] = torch.from_numpy(which)
            everyone = torch.arange(len(rows))
            env.physics.set_models(everyone, env.memory.model)
            env.physics.qpos[:] = torch.from_numpy(qpos)
            env.physics.forward(everyone)
            snapshot = env.snapshot()
            cover[rows] = torch.stack([snapshot.clearance, snapshot.object_clearance], dim=1).numpy()
            checkers = {o: CollisionChecker(scene, o, kinds=(ROBOT_OBSTACLE, OBJECT_OBSTACLE)) for o in OBJECTS}
            for row, q, i in zip(rows, qpos, which, strict=True):
                held = states[i]
                state = RobotState.from_mujoco(q, carried=held.carried, wrist_pos=held.wrist_pos)
                report = checkers[held.carried].query(state)
                for k, kind in enumerate((ROBOT_OBSTACLE, OBJECT_OBSTACLE)):
                    exact[row, k] = report.distance[report.kind == kind].min()
            progress.update(task, completed=rows[-1] + 1)
    return exact, cover


def print_cover(exact: np.ndarray, cover: np.ndarray, console: PlainConsole) -> bool:
    """Prints misses by depth and false alarms by clearance; whether the bar holds."""
    table = Table(title=f"sphere cover against exact geometry, {len(exact):,} random states")
    bins_mm = (0.0, 2.5, 5.0, 7.5, 10.0, np.inf)
    names = [f"{a:g}-{b:g} mm" if np.isfinite(b) else f"> {a:g} mm" for a, b in zip(bins_mm, bins_mm[1:], strict=False)]
    for column in ("", "collide", "what", *names, "all", "largest [mm]"):
        table.add_column(column, justify="right")
    for k, who in enumerate(("robot", "object")):
        hit = exact[:, k] < 0
        for what, wrong in (
            ("missed, by depth", hit & (cover[:, k] >= 0)),
            ("invented, by gap", ~hit & (cover[:, k] < 0)),
        ):
            size = 1e3 * np.abs(exact[wrong, k])
            counts = (str(int(((a <= size) & (size < b)).sum())) for a, b in zip(bins_mm, bins_mm[1:], strict=False))
            table.add_row(who, f"{hit.mean():.1%}", what, *counts, str(len(size)), f"{size.max(initial=0):.1f}")
    console.print(table)
    deepest = float(-exact[cover >= 0].min(initial=0.0))
    good = deepest <= BAR_DEPTH_M
    console.print(
        f"bar: no missed penetration deeper than {1e3 * BAR_DEPTH_M:g} mm: "
        f"{'ok' if good else 'MISSED'} ({1e3 * deepest:.1f})"
    )
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--states", type=a_count, default=10_000)
    parser.add_argument("--seed", type=a_seed, default=0)
    args = parser.parse_args()
    torch.set_num_threads(1)
    console = PlainConsole(width=None if PlainConsole().is_terminal else 130)
    fast = time_queries(console, args.seed)
    close = print_cover(*compare_cover(args.states, args.seed, console), console)
    return 0 if fast and close else 1


if __name__ == "__main__":
    raise SystemExit(main())
