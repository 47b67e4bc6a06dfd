"""Poses and velocities of all that moves in S scenes, at any times of N environments, on any device.

The same cubics as `hotice.model.moving.motion`; a test keeps the two equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from hotice.fields.solids import kind_and_size
from hotice.model.frames import quat_to_mat
from hotice.model.scene import Obstacle, Scene


@dataclass(frozen=True, kw_only=True)
class Movers:
    """M obstacles of N environments at one time each; rows of scenes with fewer have `there` False.

    kind, size (N, M), (N, M, 3): as in `hotice.fields.solids.Space`. p_W (N, M, 3) [m], R_WB (N, M, 3, 3): pose.
    v_W (N, M, 3) [m/s] of p_W, rate (N, M) [rad/s] about z. there (N, M) bool.
    """

    kind: Tensor
    size: Tensor
    p_W: Tensor
    R_WB: Tensor
    v_W: Tensor
    rate: Tensor
    there: Tensor

    def ahead(self, time_s: Tensor) -> Movers:
        """The same `time_s` (N,) later by their velocities: what who sees them now can know of then."""
        turn = self.rate * time_s[:, None]
        return Movers(
            kind=self.kind,
            size=self.size,
            p_W=self.p_W + self.v_W * time_s[:, None, None],
            R_WB=_about_z(turn) @ self.R_WB,
            v_W=self.v_W,
            rate=self.rate,
            there=self.there,
        )


@dataclass(frozen=True, kw_only=True)
class Courses:
    """Motions of S scenes as tensors, M the most of one scene, K the most parts of a motion.

    kind (S, M), size (S, M, 3), there (S, M): see `Movers`. p_W, R_WB, quat_WB: pose at the first way point; arm
    (S, M, 3): from there to the obstacle. start (S, M, 4): x, y, z [m], yaw [rad] of that way point. knots (S, M, K)
    [s]: begin of each part, infinite where there is none; cubics (S, M, K, 4, 4). begin, length (S, M) [s]; loop (S, M)
    bool.
    """

    kind: Tensor
    size: Tensor
    there: Tensor
    p_W: Tensor
    R_WB: Tensor
    arm: Tensor
    quat_WB: Tensor
    start: Tensor
    knots: Tensor
    cubics: Tensor
    begin: Tensor
    length: Tensor
    loop: Tensor

    @classmethod
    def of(cls, scenes: Sequence[Scene], device: torch.device | str = "cpu") -> Courses | None:
        """Courses of the scenes, in order; None where nothing moves."""
        moving = [scene.moving for scene in scenes]
        most = max(map(len, moving), default=0)
        if not most:
            return None
        parts = max(len(o.motion.cubics) for row in moving for o in row if o.motion)
        shape = (len(scenes), most)
        rows = {
            "kind": np.zeros(shape, dtype=np.int64),
            "size": np.zeros((*shape, 3)),
            "there": np.zeros(shape, dtype=bool),
            "p_W": np.zeros((*shape, 3)),
            "R_WB": np.tile(np.eye(3), (*shape, 1, 1)),
            "quat_WB": np.tile([1.0, 0.0, 0.0, 0.0], (*shape, 1)),
            "arm": np.zeros((*shape, 3)),
            "start": np.zeros((*shape, 4)),
            "knots": np.full((*shape, parts), np.inf),
            "cubics": np.zeros((*shape, parts, 4, 4)),
            "begin": np.zeros(shape),
            "length": np.ones(shape),
            "loop": np.zeros(shape, dtype=bool),
        }
        for s, row in enumerate(moving):
            for m, obstacle in enumerate(row):
                assert obstacle.motion is not None
                for name, value in _row(obstacle).items():
                    # one motion has fewer parts than another
                    at = (s, m, slice(len(obstacle.motion.cubics))) if name in ("knots", "cubics") else (s, m)
                    rows[name][at] = value
        exact = {name: torch.as_tensor(value, device=device) for name, value in rows.items()}
        return cls(**{k: v.float() if v.dtype == torch.float64 else v for k, v in exact.items()})

    def at(self, scene: Tensor, time_s: Tensor) -> Movers:
        """Movers of scenes (N,) at times (N,) [s] since the start of an episode."""
        value, rate = self._powers(scene, time_s)
        start, arm = self.start[scene], self.arm[scene]
        turned = _about_z(value[..., 3] - start[..., 3])
        arm_W = (turned @ arm[..., None]).squeeze(-1)
        p_W = self.p_W[scene] + (value[..., :3] - start[..., :3]) + (arm_W - arm)
        across = torch.stack([-arm_W[..., 1], arm_W[..., 0], torch.zeros_like(arm_W[..., 2])], dim=-1)
        return Movers(
            kind=self.kind[scene],
            size=self.size[scene],
            p_W=p_W,
            R_WB=turned @ self.R_WB[scene],
            v_W=rate[..., :3] + rate[..., 3:] * across,
            rate=rate[..., 3],
            there=self.there[scene],
        )

    def poses(self, scene: Tensor, time_s: Tensor) -> tuple[Tensor, Tensor]:
        """Positions (N, M, 3) [m] and quaternions (N, M, 4) wxyz in W, as `at`."""
        value, _ = self._powers(scene, time_s)
        half = 0.5 * (value[..., 3] - self.start[scene][..., 3])
        a, d = torch.cos(half), torch.sin(half)
        w, x, y, z = self.quat_WB[scene].unbind(-1)
        quat = torch.stack([a * w - d * z, a * x - d * y, a * y + d * x, a * z + d * w], dim=-1)
        return self.at(scene, time_s).p_W, quat

    def seen(self, scene: Tensor, time_s: Tensor, rate_hz: float, delay_s: float) -> Movers:
        """Movers as a robot knows them at times (N,) that sees them `rate_hz` times a second, `delay_s` late.

        Their velocity is what their last two places say, and they are taken to go on like that. Before the start of an
        episode they were where they are at its start.
        """
        step = 1.0 / rate_hz
        # a hair more: the time of a control step is a multiple of neither, and must not fall short by rounding
        last = torch.floor((time_s - delay_s) * rate_hz + 1e-3) * step
        now, before = self.at(scene, last.clamp(min=0.0)), self.at(scene, (last - step).clamp(min=0.0))
        turn = now.R_WB @ before.R_WB.transpose(-1, -2)
        guess = Movers(
            kind=now.kind,
            size=now.size,
            p_W=now.p_W,
            R_WB=now.R_WB,
            v_W=(now.p_W - before.p_W) * rate_hz,
            rate=torch.atan2(turn[..., 1, 0], turn[..., 0, 0]) * rate_hz,
            there=now.there,
        )
        return guess.ahead(time_s - last.clamp(min=0.0))

    def _powers(self, scene: Tensor, time_s: Tensor) -> tuple[Tensor, Tensor]:
        """Place (N, M, 4) of each motion's frame, x, y, z, yaw, and its rate."""
        begin, length, knots = self.begin[scene], self.length[scene], self.knots[scene]
        since = time_s[:, None] - begin
        since = torch.where(self.loop[scene] & (since > 0.0), torch.remainder(since, length), since)
        under_way = (since >= 0.0) & (since < length)
        t = begin + torch.minimum(since.clamp(min=0.0), length)
        k = ((t[..., None] >= knots).sum(dim=-1) - 1).clamp(min=0)
        c = self.cubics[scene].gather(2, k[..., None, None, None].expand(-1, -1, 1, 4, 4)).squeeze(2)
        u = (t - knots.gather(2, k[..., None]).squeeze(-1).nan_to_num(posinf=0.0))[..., None]
        value = c[..., 0] + u * (c[..., 1] + u * (c[..., 2] + u * c[..., 3]))
        rate = c[..., 1] + u * (2.0 * c[..., 2] + u * 3.0 * c[..., 3])
        return value, torch.where(under_way[..., None], rate, torch.zeros_like(rate))


def _row(obstacle: Obstacle) -> dict[str, Any]:
    """What is known of one obstacle, by name of `Courses`."""
    motion = obstacle.motion
    assert motion is not None
    first, kind_size = motion.way_points[0], kind_and_size(obstacle.shape)
    return {
        "kind": kind_size[0],
        "size": kind_size[1],
        "there": True,
        "p_W": obstacle.position_m,
        "R_WB": quat_to_mat(obstacle.quaternion_wxyz),
        "quat_WB": obstacle.quaternion_wxyz,
        "arm": np.subtract(obstacle.position_m, first.position_m),
        "start": (*first.position_m, first.yaw_rad),
        "knots": motion.knots_s[:-1],
        "cubics": motion.cubics,
        "begin": motion.knots_s[0],
        "length": motion.knots_s[-1] - motion.knots_s[0],
        "loop": motion.repeat == "loop",
    }


def _about_z(angle: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) about z by angles (...) [rad]."""
    cos, sin, zero = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)
    rows = [cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0]
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))
