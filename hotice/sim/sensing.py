"""Sensing between the simulated state and the actor: noise, delays and a root pose that is refreshed now and then.

The numbers and rules, those of delays too, are in `hotice.task.sensing`.

Rewards, critics and terminations read the true snapshot; the actor reads what `Sensors.measure` makes of it. The
estimate of the object is one: its pose in the observation and the points where its field is queried agree. All zero
(teachers), the actor reads the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from hotice.sim.encoder_error import turn_joints
from hotice.sim.snapshot import Motion, Snapshot
from hotice.task import sensing
from hotice.task.sensing import (
    TRACK_HEADING,
    TRACK_PLACE,
    TRACK_TILT,
    TRACK_VELOCITY,
    SensingConfig,
    reads_late,
)

_STATE = ("root", "velocity", "gravity", "object", "age", "action_delay", "late", "seen")


class Sensors:
    """Estimates of N environments.

    `guide(motion, ids)` gives the guidance part of a snapshot at a (measured) motion; `never_late` (O,) bool marks the
    columns of the observation that are known rather than measured; `moved`: which keypoints each joint moves
    (`hotice.sim.encoder_error`).
    """

    def __init__(
        self,
        config: SensingConfig,
        num_envs: int,
        control_dt_s: float,
        substeps: int,
        device: torch.device,
        guide: Callable[[Motion, Tensor], dict[str, Any]],
        never_late: Tensor,
        moved: list[list[int]],
    ) -> None:
        self.config, self.guide, self.moved = config, guide, moved
        self.hold_steps = config.hold_steps(control_dt_s)
        self.longest_delay = config.longest_delay(control_dt_s, substeps)
        self.root = torch.zeros(num_envs, 5, device=device)
        """Estimate x, y, z [m], sine and cosine of the heading."""
        self.gravity = torch.zeros(num_envs, 3, device=device)
        """Estimate of the direction of gravity in P."""
        self.velocity = torch.zeros(num_envs, 3, device=device)
        """Tracked velocity of the root [m/s]; zero without tracking."""
        self.dt_s = control_dt_s
        self.object = torch.zeros(num_envs, 3, 3, device=device)
        """Estimate of the object in P: position [m] and first two axes, as rows."""
        self.gain = config.object_gain(control_dt_s)
        self.age = torch.zeros(num_envs, dtype=torch.int64, device=device)
        """Measurements of this episode."""
        self.action_delay = torch.zeros(num_envs, dtype=torch.int64, device=device)
        """Physics steps before an action reaches the motors."""
        self.late = torch.zeros(num_envs, dtype=torch.bool, device=device)
        """Whether measurements come one control step late."""
        self.seen = torch.zeros(num_envs, len(never_late), device=device)
        """The newest measured observation; who is late reads it a step later."""
        self.never_late = never_late

    def state(self) -> dict[str, Tensor]:
        """Copies of the estimates and delays."""
        return {name: getattr(self, name).clone() for name in _STATE}

    def load_state(self, state: dict[str, Tensor]) -> None:
        """Restores `state()`."""
        for name, value in state.items():
            getattr(self, name).copy_(value)

    def restart(self, ids: Tensor, generator: torch.Generator) -> None:
        """Draws the delays of new episodes; they begin with a fresh measurement."""
        n, device = len(ids), self.root.device
        if self.longest_delay:
            draw = torch.randint(0, self.longest_delay + 1, (n,), generator=generator, device=device)
            self.action_delay[ids] = draw
        if self.config.sensor_delay_steps:
            self.late[ids] = torch.rand(n, generator=generator, device=device) < sensing.LATE_SHARE
        self.age[ids] = 0
        self.velocity[ids] = 0.0

    def delay(self, observation: Tensor, ids: Tensor) -> Tensor:
        """Rows that the actors of environments `ids` read of their newest observation (n, O)."""
        # The first measurement of an episode is never late: there is none before it.
        late = reads_late(self.late[ids], self.age[ids])[:, None] & ~self.never_late
        read = torch.where(late, self.seen[ids], observation)
        self.seen[ids] = observation
        return read

    def measure(self, s: Snapshot, ids: Tensor, joint_offset: Tensor, generator: torch.Generator) -> Snapshot:
        """Snapshot (n, ...) of environments `ids` as their robots know it.

        joint_offset (n, 20): error of the encoders [rad].
        """
        cfg = self.config

        def noise(like: Tensor, half: float) -> Tensor:
            return (2.0 * torch.rand(like.shape, generator=generator, device=like.device) - 1.0) * half

        # The order of the draws is part of what a seed means.
        yaw = s.yaw + noise(s.yaw, cfg.root_yaw_rad)
        seen = torch.stack([*(s.p_WP + noise(s.p_WP, cfg.root_pos_m)).unbind(1), yaw.sin(), yaw.cos()], 1)
        gyro = s.w_WP_P + noise(s.w_WP_P, cfg.gyro_rad_s)
        gravity = s.gravity_P + noise(s.gravity_P, cfg.gravity)
        down_P = self._down(ids, gravity, gyro)
        # Up is −down: the gyro's part about it is the rate of the heading.
        root = self._tracked(ids, seen, -(gyro * down_P).sum(dim=1)) if cfg.root_tracking else self._held(ids, seen)
        self.root[ids] = root
        self.age[ids] += 1
        p_WP = root[:, :3]
        yaw = torch.atan2(root[:, 3], root[:, 4])
        R_EP = _about_z(yaw) @ _tilt(down_P)
        R_EW = R_EP @ s.R_WP.transpose(1, 2)  # turns what is seen from the root into the estimated world frame
        joint_error = joint_offset + noise(s.q, cfg.joint_pos_rad)
        p_WK = turn_joints(s.p_WK, s.joint_axis_W, s.joint_anchor_W, joint_error, self.moved)

        def moved(p_W: Tensor) -> Tensor:
            return p_WP[:, None] + (p_W - s.p_WP[:, None]) @ R_EW.transpose(1, 2)

        p_PO = s.p_WO - s.p_WP + noise(s.p_WO, cfg.object_pos_m)
        R_tilt = _rotation(noise(s.p_WO, cfg.object_rot_rad))
        if self.gain < 1.0:
            p_PO, R_WO = self._filtered(s, ids, p_PO, R_tilt @ s.R_WO)
            R_tilt = R_WO @ s.R_WO.transpose(1, 2)
        arms = s.p_WOK - s.p_WO[:, None]
        arms = torch.where(s.grasp.world_aligned[:, None, None], arms, arms @ (R_EW @ R_tilt).transpose(1, 2))
        p_WO = p_WP + (R_EW @ p_PO[:, :, None]).squeeze(-1)
        motion = {
            "p_WP": p_WP,
            "yaw": yaw,
            "R_WP": R_EP,
            "p_WK": moved(p_WK),
            "p_WO": p_WO,
            "p_WOK": p_WO[:, None] + arms,
            "R_WO": R_EW @ R_tilt @ s.R_WO,
            "q": s.q + joint_error,
            "qd": s.qd + noise(s.qd, cfg.joint_vel_rad_s),
            "gravity_P": gravity,
            "w_WP_P": gyro,
        }
        measured = replace(s, **motion)
        return replace(measured, **self.guide(measured, ids))

    def _down(self, ids: Tensor, gravity: Tensor, gyro: Tensor) -> Tensor:
        """Direction of gravity in P (n, 3): turned by the gyro, pulled to what is measured now; true without noise."""
        if not (self.config.gravity or self.config.gyro_rad_s):
            return gravity
        before = self.gravity[ids]
        # In P it is gravity that turns, against the body: ġ = g × ω.
        predicted = before + self.dt_s * torch.linalg.cross(before, gyro)
        # The mean of the first measurements, then a constant share of each.
        gain = torch.clamp(1.0 / (self.age[ids] + 1), min=TRACK_TILT)[:, None]
        down = torch.nn.functional.normalize(torch.lerp(predicted, gravity, gain), dim=1)
        self.gravity[ids] = down
        return down

    def _held(self, ids: Tensor, seen: Tensor) -> Tensor:
        """The root (n, 5) as it was last seen; `seen` (n, 5) counts where it is due."""
        return torch.where(self._due(ids), seen, self.root[ids])

    def _tracked(self, ids: Tensor, seen: Tensor, turning: Tensor) -> Tensor:
        """Root (n, 5), moved on by its velocity, turned by the gyro, `turning` (n,) [rad/s]; corrected where due."""
        root, velocity, due = self.root[ids], self.velocity[ids], self._due(ids)
        place = root[:, :3] + velocity * self.dt_s
        yaw = torch.atan2(root[:, 3], root[:, 4]) + turning * self.dt_s
        off = seen[:, :3] - place
        yaw_off = torch.atan2(seen[:, 3], seen[:, 4]) - yaw
        # The short way round.
        yaw_off = torch.atan2(torch.sin(yaw_off), torch.cos(yaw_off))
        first = (self.age[ids] == 0)[:, None]
        # An error of place that has grown since the last correction is one of velocity.
        faster = velocity + TRACK_VELOCITY / (self.hold_steps * self.dt_s) * off
        self.velocity[ids] = torch.where(due & ~first, faster, velocity)
        place = torch.where(due, place + TRACK_PLACE * off, place)
        yaw = torch.where(due[:, 0], yaw + TRACK_HEADING * yaw_off, yaw)
        moved = torch.cat([place, torch.sin(yaw)[:, None], torch.cos(yaw)[:, None]], dim=1)
        return torch.where(first, seen, moved)

    def _due(self, ids: Tensor) -> Tensor:
        """Mask of the environments `ids` that see their root now, (n, 1) bool."""
        return (self.age[ids] % self.hold_steps == 0)[:, None]

    def _filtered(self, s: Snapshot, ids: Tensor, p_PO: Tensor, R_WO: Tensor) -> tuple[Tensor, Tensor]:
        """Position from the pelvis (n, 3) and orientation (n, 3, 3) of the object in W after the newest measurement."""
        # Filtered in the frame of the pelvis, in which a carried object hardly moves. Two axes say all of an
        # orientation.
        newest = torch.cat([p_PO[:, None], R_WO[:, :, :2].transpose(1, 2)], dim=1) @ s.R_WP
        gain = torch.clamp(1.0 / self.age[ids], min=self.gain)[:, None, None]
        estimate = torch.lerp(self.object[ids], newest, gain)
        self.object[ids] = estimate
        p, x, y = (estimate @ s.R_WP.transpose(1, 2)).unbind(1)
        # A mean of axes is neither of unit length nor orthogonal: Gram-Schmidt.
        x = x / x.norm(dim=1, keepdim=True)
        z = torch.linalg.cross(x, y)
        z = z / z.norm(dim=1, keepdim=True)
        return p, torch.stack([x, torch.linalg.cross(z, x), z], dim=2)


def _about_z(angle: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) about z by angles (N,) [rad]."""
    cos, sin, zero = torch.cos(angle), torch.sin(angle), torch.zeros_like(angle)
    rows = [cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0]
    return torch.stack(rows, dim=-1).view(-1, 3, 3)


def _tilt(down_P: Tensor) -> Tensor:
    """Rotations R_YP (N, 3, 3) of pelvises that see gravity in directions `down_P` (N, 3), unit vectors."""
    along, across, up = (-down_P).unbind(-1)
    level = torch.sqrt(across**2 + up**2).clamp_min(1e-6)
    rows = [
        level,
        -along * across / level,
        -along * up / level,
        torch.zeros_like(up),
        up / level,
        -across / level,
        along,
        across,
        up,
    ]
    return torch.stack(rows, dim=-1).view(-1, 3, 3)


def _rotation(vector: Tensor) -> Tensor:
    """Rotation matrices (N, 3, 3) about vectors (N, 3) by their length [rad] (Rodrigues)."""
    angle = vector.norm(dim=-1, keepdim=True).clamp_min(1e-9)[..., None]
    x, y, z = (vector / angle[..., 0]).unbind(-1)
    zero = torch.zeros_like(x)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).view(-1, 3, 3)
    return torch.eye(3, device=vector.device) + torch.sin(angle) * K + (1.0 - torch.cos(angle)) * (K @ K)
