"""Passage of a person-sized robot with its load through a scene: a search over places, headings and postures.

Places lie on a grid through the start (4 cm), with 16 headings and the postures of `envelope`. A state is free when the
envelope keeps `MARGIN_M` away from every obstacle, by the scene's exact distance interpolated between grid nodes. Moves
go to neighbouring places (in any direction; sideways and backwards cost more), headings and postures. A place is stood
on when both feet find room on the floor; where a low obstacle (at most 15 cm) takes that room, only a stride straight
ahead leads on, of at most 52 cm from one foothold to the next, which leaves 22 to 26 cm for the obstacle. The path
found also prefers room, an upright posture and few turns.

What this does not judge: balance, speed, and whether a policy knows the skill. Beyond its bounds the scene is taken to
go on as it is at the border, and the pelvis stays 0.2 m inside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidObject, InvalidScene
from hotice.model.frames import rotation_z
from hotice.model.generate.envelope import FEET, POSTURES, SHINS, Envelope
from hotice.model.generate.lattice_search import CAP_M, HEADINGS, BodyGrid, LatticePath, search
from hotice.model.scene import Scene

MARGIN_M = 0.02
"""Least distance between envelope and obstacles."""
REACHED_M = 0.1
"""A path that ends so near to the goal reaches it: not farther than where the task counts an arrival."""
BORDER_M = 0.2
BLOCK = 4
MAX_PLACES = 600_000


@dataclass(frozen=True, kw_only=True)
class Traversal:
    """The outcome of `check_traversable`.

    Attributes:
        ok: the goal is reached. reason: empty, or what is in the way and where.
        path: (n, 3) x, y [m], yaw [rad] of the pelvis in W; as far as the search came when not ok.
        postures: (n,) names, see `envelope`.
        clearance_m: least distance between the envelope and an obstacle along the path, at most 0.20.
        length_m: of the path on the floor.
        strides: places (k, 2) of the path at which a stride over a low obstacle begins.
    """

    ok: bool
    reason: str
    path: NDArray[np.float64]
    postures: tuple[str, ...]
    clearance_m: float
    length_m: float
    strides: NDArray[np.float64]


def check_traversable(
    scene: Scene,
    *,
    carried_half_extents_m: tuple[float, float, float] = (0.2, 0.2, 0.2),
    resolution_m: float = 0.04,
) -> Traversal:
    """A collision-free way of the posture envelopes from start to goal.

    Args:
        scene: the scene. carried_half_extents_m: of the load's bounding box (ahead, aside, up).
        resolution_m: spacing of places and of the sampled distance.

    Raises:
        InvalidScene: the scene has too many places for this resolution.
        InvalidObject, InvalidConfig: an extent that is not positive; a resolution outside 1 to 10 cm.
    """
    checks.vector("carried_half_extents_m", carried_half_extents_m, 3, checks.POSITIVE, InvalidObject)
    checks.number("resolution_m", resolution_m, Range(least=0.01, most=0.1, unit="m"))
    envelope = Envelope.of(carried_half_extents_m)
    grid = _grid(scene, resolution_m, CAP_M + float(envelope.ball[:, 3].max()))
    found = search(grid, envelope, scene.start, scene.goal, REACHED_M, MARGIN_M)
    yaw = np.array([math.atan2(y, x) for x, y in HEADINGS])[found.node[:, 2]]
    path = np.column_stack([grid.places(found.node[:, :2]), yaw])
    return Traversal(
        ok=found.found,
        reason="" if found.found else _reason(scene, envelope, path[-1], found),
        path=path,
        postures=tuple(POSTURES[p].name for p in found.node[:, 3]),
        clearance_m=float(found.clearance.min()),
        length_m=float(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum()),
        strides=path[:-1][found.stands[:-1] & ~found.stands[1:], :2],
    )


def require_traversable(scene: Scene, **options: object) -> Traversal:
    """`check_traversable`, with `InvalidScene` giving the reason and the place when there is no way."""
    traversal = check_traversable(scene, **options)  # type: ignore[arg-type]
    if not traversal.ok:
        raise InvalidScene(f"scene {scene.name!r} cannot be traversed with the load: {traversal.reason}")
    return traversal


def _grid(scene: Scene, resolution: float, far: float) -> BodyGrid:
    low, high = np.array(scene.bounds_m)
    start, goal = np.array(scene.start[:2]), np.array(scene.goal)
    border = np.minimum(BORDER_M, np.minimum(np.minimum(start, goal) - low[:2], high[:2] - np.maximum(start, goal)))
    before = np.floor((start - low[:2] - border) / resolution + 1e-9)
    after = np.floor((high[:2] - border - start) / resolution + 1e-9)
    size = (int(before[0] + after[0]) + 1, int(before[1] + after[1]) + 1)
    if size[0] * size[1] > MAX_PLACES:
        raise InvalidScene(
            f"scene {scene.name!r} has {size[0]} x {size[1]} places to search, at most {MAX_PLACES:,} are allowed: "
            f"crop it, or check it at a coarser resolution than {resolution:g} m"
        )
    nodes = np.ceil((high - [*low[:2], 0.0]) / resolution).astype(int) + 1
    origin = np.array([*low[:2], 0.0])
    return BodyGrid(
        distance=_sampled_distance(scene, origin, nodes, resolution, far),
        origin=origin,
        first=start - before * resolution,
        size=size,
        resolution_m=resolution,
    )


def _sampled_distance(
    scene: Scene, origin: NDArray[np.float64], nodes: NDArray[np.integer], resolution: float, far: float
) -> NDArray[np.float32]:
    """Exact signed distance at grid nodes, cut at `far`; each block of nodes asks the obstacles that may be nearest."""
    blocks = -(-nodes // BLOCK)
    step = np.stack(np.meshgrid(*3 * [resolution * np.arange(BLOCK)], indexing="ij"), axis=-1).reshape(-1, 3)
    corner = origin + resolution * BLOCK * np.stack(np.unravel_index(np.arange(blocks.prod()), blocks), axis=-1)
    reach = 0.5 * math.sqrt(3.0) * (BLOCK - 1) * resolution
    result = np.full((len(corner), BLOCK**3), far, dtype=np.float32)
    middle = [o.signed_distance(corner + 0.5 * (BLOCK - 1) * resolution) for o in scene.obstacles]
    limit = np.minimum(np.min(middle, axis=0, initial=far) + reach, far) + reach
    for obstacle, distance in zip(scene.obstacles, middle, strict=True):
        near = np.flatnonzero(distance < limit)
        exact = obstacle.signed_distance(corner[near, None] + step).astype(np.float32)
        result[near] = np.minimum(result[near], exact)
    grid = result.reshape(*blocks, BLOCK, BLOCK, BLOCK).transpose(0, 3, 1, 4, 2, 5).reshape(BLOCK * blocks)
    return np.ascontiguousarray(grid[: nodes[0], : nodes[1], : nodes[2]])


def _reason(scene: Scene, envelope: Envelope, end: NDArray, found: LatticePath) -> str:
    """Obstruction at the end of the path: the obstacle that its envelope meets there, or one step on."""
    x, y, yaw = end
    where = f"at ({x:.2f}, {y:.2f}), {math.dist((x, y), scene.goal):.2f} m before the goal"
    step = 0.2 if found.clearance[-1] >= MARGIN_M else 0.0
    ahead = math.atan2(scene.goal[1] - y, scene.goal[0] - x)
    blocks = [FEET, SHINS, *envelope.posture_blocks[found.node[-1, 3]].tolist()]
    rows = np.concatenate([np.arange(*envelope.first[b : b + 2].tolist()) for b in blocks])
    p_W = envelope.centre[rows] @ rotation_z(-yaw)
    p_W += [x + step * math.cos(ahead), y + step * math.sin(ahead), 0.0]
    depth = [(float((o.signed_distance(p_W) - envelope.radius[rows]).min()), o.name) for o in scene.obstacles]
    return f"stopped by {repr(min(depth)[1]) if depth else 'the bounds'} {where}"
