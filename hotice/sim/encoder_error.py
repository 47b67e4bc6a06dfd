"""Keypoint positions as biased joint encoders would place them."""

from __future__ import annotations

import mujoco
import torch
from torch import Tensor


def chains(model: mujoco.MjModel, joints: list[str], point_bodies: list[int]) -> list[list[int]]:
    """For each of `joints`, by name, the indices of the points that it moves."""

    def above(body: int) -> set[int]:
        found = set()
        while body:
            found.add(body)
            body = int(model.body_parentid[body])
        return found

    moving = [above(body) for body in point_bodies]
    bodies = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
    return [[k for k, over in enumerate(moving) if body in over] for body in bodies]


def turn_joints(p_WK: Tensor, axis_W: Tensor, anchor_W: Tensor, angle: Tensor, moved: list[list[int]]) -> Tensor:
    """Points (N, K, 3) [m] of robots whose hinges turned by `angle` (N, J) [rad], the root unmoved.

    Product of exponentials from the pose at hand: the hinges of a limb turn about where they are now, the outermost
    first, which is exact for any angle.

    Args:
        p_WK: points now. axis_W, anchor_W: unit axes and places of the hinges now, (N, J, 3).
        angle: by which each turns. moved: see `chains`; hinges of one limb in order from the root.
    """
    p = p_WK.clone()
    for j in reversed(range(angle.shape[1])):
        points = moved[j]
        if not points:
            continue
        o = anchor_W[:, j, None]
        r = p[:, points] - o
        a = axis_W[:, j, None].expand_as(r)
        cos, sin = torch.cos(angle[:, j])[:, None, None], torch.sin(angle[:, j])[:, None, None]
        p[:, points] = o + cos * r + sin * torch.linalg.cross(a, r) + (1.0 - cos) * (a * r).sum(-1, keepdim=True) * a
    return p
