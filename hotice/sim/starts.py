"""Starts of episodes: places in a scene with room for robot and object and a way to the goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hotice.model.scene import GOAL_HEIGHT_M, Scene

if TYPE_CHECKING:
    from hotice.fields.bank import FieldBank

BODY_RADIUS_M = 0.38
OBJECT_REACH_M = 0.62
STEP_M = 0.1
HEIGHTS_M = (0.06, 0.3, 0.55, 0.8, 1.05, 1.3)
FARTHEST_M = 3.0
NEAREST_M = 0.3


def standing_places(scene: Scene, direction_of, geodesic_of) -> np.ndarray:
    """Starts (M, 3): x, y [m], heading [rad] along the field, with room for body and object around them.

    Args:
        scene: the scene.
        direction_of: function (M, 3) -> (M, 3), the guidance field at pelvis height.
        geodesic_of: function (M, 3) -> (M,), distance to go.
    """
    low, high = (np.array(b) for b in scene.bounds_m)
    xs, ys = (np.arange(low[i] + 0.3, high[i] - 0.3 + 1e-9, STEP_M) for i in range(2))
    xy = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
    pelvis = np.column_stack([xy, np.full(len(xy), GOAL_HEIGHT_M)])
    togo = np.linalg.norm(xy - np.array(scene.goal), axis=1)
    distance = geodesic_of(pelvis)
    heading = np.arctan2(*np.moveaxis(direction_of(pelvis)[:, 1::-1], -1, 0)) if len(xy) else np.zeros(0)
    good = np.isfinite(distance) & (distance < FARTHEST_M) & (togo > NEAREST_M)
    for z in HEIGHTS_M:
        good &= _clearance(scene, xy, z) > BODY_RADIUS_M * (0.6 if z < 0.5 else 1.0)
    front = xy + 0.3 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    for z in (0.65, 0.85, 1.05):
        good &= _clearance(scene, front, z) > OBJECT_REACH_M - 0.3
    return np.column_stack([xy, heading])[good]


def _clearance(scene: Scene, xy: np.ndarray, z: float) -> np.ndarray:
    return scene.signed_distance(np.column_stack([xy, np.full(len(xy), z)]))


def all_places(bank: FieldBank) -> list[np.ndarray]:
    """`standing_places` of every scene of the bank; at least the scene's own start."""
    import torch

    places = []
    for index, scene in enumerate(bank.scenes):

        def sample(p: np.ndarray, index: int = index):
            ids = torch.full((len(p),), index, dtype=torch.int64, device=bank.device)
            points = torch.tensor(p, dtype=torch.float32, device=bank.device)[:, None]
            return bank.sample("sgf", ids, points)

        found = standing_places(
            scene,
            lambda p, f=sample: f(p).force_W[:, 0].cpu().numpy(),
            lambda p, f=sample: f(p).geodesic[:, 0].cpu().numpy(),
        )
        places.append(found if len(found) else np.array([scene.start]))
    return places
