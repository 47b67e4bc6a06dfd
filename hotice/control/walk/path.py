"""The way of the body: a streamline of the guidance field, drawn aside until body and load fit.

The Standard Guidance Field at pelvis height gives the route. It knows a point, not a body that carries a box, so the
streamline is relaxed as an elastic band: each of its nodes is pushed sideways by the spheres of the body (signed
distance of the Standard Guidance Field) and the points of the load (of the Object-Centric one, which keeps its margin)
that come too near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.walk.body import BodySpheres
from hotice.fields import HodPf

Array = NDArray[np.float64]
PELVIS_HEIGHT_M = 0.75
STREAM_STEP_M = 0.02
NODE_M = 0.05
STRAIGHT_M = 0.3  # from here the way leads straight to the goal
SMOOTHING = 4.0
ITERATIONS = 250


@dataclass(frozen=True, eq=False)
class WalkPath:
    """A curve on the floor: station (S,) [m], xy (S, 2) [m], yaw (S,) [rad], continuous."""

    station: Array
    xy: Array
    yaw: Array

    @property
    def length_m(self) -> float:
        """From start to goal [m]."""
        return float(self.station[-1])

    def at(self, station: Array | float) -> tuple[Array, Array]:
        """Position (..., 2) [m] and yaw (...) [rad] at stations (...) [m]; the ends go on straight."""
        s = np.asarray(station, dtype=float)
        xy = np.stack([np.interp(s, self.station, self.xy[:, i]) for i in range(2)], axis=-1)
        yaw = np.interp(s, self.station, self.yaw)
        beyond = s - np.clip(s, self.station[0], self.station[-1])
        return xy + beyond[..., None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1), yaw

    def station_of(self, xy: Array) -> float:
        """Station of the nearest point of the curve [m]."""
        a, d = self.xy[:-1], np.diff(self.xy, axis=0)
        share = np.clip(((xy - a) * d).sum(axis=1) / np.maximum((d * d).sum(axis=1), 1e-12), 0.0, 1.0)
        k = int(np.argmin(((a + share[:, None] * d - xy) ** 2).sum(axis=1)))
        return float(self.station[k] + share[k] * (self.station[k + 1] - self.station[k]))


def streamline(pf: HodPf, start: Array, *, step_m: float = STREAM_STEP_M) -> Array:
    """Follows the Standard Guidance Field at pelvis height from start (2,) to the scene's goal, (S, 2) [m]."""
    goal = np.asarray(pf.scene.goal_W[:2], dtype=float)
    points = [np.asarray(start, dtype=float)]
    limit = int(6.0 * (np.linalg.norm(goal - points[0]) + 1.0) / step_m)
    for _ in range(limit):
        here = points[-1]
        togo = goal - here
        distance = float(np.linalg.norm(togo))
        if distance <= step_m:
            break
        straight = togo / distance
        force = pf.sgf.sample(np.array([here[0], here[1], PELVIS_HEIGHT_M]))[:2]
        size = float(np.linalg.norm(force))
        along = force / size if size > 1e-6 else straight
        near = np.clip(1.0 - distance / STRAIGHT_M, 0.0, 1.0)
        way = (1.0 - near) * along + near * straight
        length = float(np.linalg.norm(way))
        points.append(here + step_m * (way / length if length > 1e-6 else straight))
    points.append(goal)
    return np.array(points)


def plan_path(
    pf: HodPf, start: tuple[float, float, float], body: BodySpheres, *, margin_m: float = 0.07, turn: float = 0.35
) -> WalkPath:
    """Way from start (x, y, yaw) to the goal.

    Args:
        pf: fields of the scene. body: the spheres that have to fit.
        margin_m: distance that is kept to obstacles where there is room [m]; the body sways by a few centimetres.
        turn: share of the curve's direction that the heading follows, between 0 (keep the start's) and 1.
    """
    raw = streamline(pf, np.array(start[:2]))
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(raw, axis=0), axis=1))])
    if arc[-1] < 1e-6:
        return WalkPath(np.array([0.0, 1e-6]), np.stack([raw[0], raw[0]]), np.full(2, start[2]))
    stations = np.linspace(0.0, arc[-1], max(3, int(np.ceil(arc[-1] / NODE_M)) + 1))
    xy = np.stack([np.interp(stations, arc, raw[:, i]) for i in range(2)], axis=1)
    if pf.scene.obstacles:
        for _ in range(ITERATIONS):
            push = _push(pf, xy, _heading(xy, start[2], turn), body, margin_m)
            bend = np.zeros_like(xy)
            bend[1:-1] = xy[:-2] - 2.0 * xy[1:-1] + xy[2:]
            move = 0.25 * (SMOOTHING * bend / 3.0 + push)
            move[0] = move[-1] = 0.0
            xy = xy + np.clip(move, -0.02, 0.02)
    yaw = _heading(xy, start[2], turn)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    return WalkPath(arc, xy, yaw)


def _heading(xy: Array, start_yaw: float, turn: float) -> Array:
    """Heading along the curve, smoothed over three decimetres; the start's at first."""
    step = np.gradient(xy, axis=0)
    along = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    overall = np.arctan2(*(xy[-1] - xy[0])[::-1])
    along += 2 * np.pi * np.round((overall - along[len(along) // 2]) / (2 * np.pi))
    mean = overall + turn * (along - overall)
    kernel = np.ones(7) / 7.0
    smooth = np.convolve(np.pad(mean, 3, mode="edge"), kernel, mode="valid")
    difference = (start_yaw - smooth[0] + np.pi) % (2 * np.pi) - np.pi
    fade = np.clip(1.0 - np.arange(len(xy)) * NODE_M / 0.8, 0.0, 1.0)
    return smooth + difference * fade


def _push(pf: HodPf, xy: Array, yaw: Array, body: BodySpheres, margin_m: float) -> Array:
    """Sideways displacement that each node would need, the mean over its offending points, (S, 2) [m]."""
    c, s = np.cos(yaw), np.sin(yaw)
    normal = np.stack([-s, c], axis=1)

    def clearance(offset: float) -> Array:
        place = xy + offset * normal
        near = []
        for points, radius, field, margin in (
            (body.robot, body.radius, pf.sgf, margin_m),
            (body.load, 0.0, pf.ogf, max(0.0, margin_m - pf.margin_m)),
        ):
            x = place[:, :1] + c[:, None] * points[:, 0] - s[:, None] * points[:, 1]
            y = place[:, 1:] + s[:, None] * points[:, 0] + c[:, None] * points[:, 1]
            p = np.stack([x, y, np.broadcast_to(points[:, 2], x.shape)], axis=-1)
            near.append(field.signed_distance(p) - radius - margin)
        return np.concatenate(near, axis=1)

    h = 0.01
    here, left, right = clearance(0.0), clearance(h), clearance(-h)
    lack = np.maximum(-here, 0.0)
    slope = (left - right) / (2 * h)
    weight = lack**2
    total = weight.sum(axis=1)
    wish = (weight * lack * slope).sum(axis=1) / np.maximum(total, 1e-9)
    return wish[:, None] * normal
