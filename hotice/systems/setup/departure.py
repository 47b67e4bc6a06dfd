"""Departure after a pick-up, before a policy takes over: away from the table, with the command ahead."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.pickup.footwork import Departure
from hotice.fields import HodPf
from hotice.model.carry import CarryState
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.robot_state import RobotState
from hotice.policy.guidance import read_fields
from hotice.policy.percept import PerceptModel
from hotice.task.policy_task import PolicyTask

Array = NDArray[np.float64]
BACKS_M = (0.4, 0.5, 0.3, 0.6, 0.2, 0.1, 0.0)
"""Distances to step back, the best first: closer than 0.2 m to the table, policies stumble over it."""
SECTOR_RAD = 0.35
"""A command within this angle of the heading needs no turning: policies are trained to 0.6 rad."""
BODY_M, LEGS_M = 0.30, 0.22
HEIGHTS_M = (0.06, 0.3, 0.55, 0.8, 1.05, 1.3)
LOAD_HEIGHTS_M = (0.65, 0.85, 1.05)


def plan_departure(pf: HodPf, task: PolicyTask, carry: CarryState, origin: tuple[float, float, float]) -> Departure:
    """The first of `BACKS_M` that leaves room to step there and to turn until the command is ahead, else the roomiest.

    Args:
        pf: fields of the scene with the table. task: of the policy that goes on. carry: how the object is held.
        origin: middle of the soles and heading at the pick-up, x, y [m], yaw [rad].
    """
    percept_of = PerceptModel(carry.carried)
    best, most = Departure(), -np.inf
    for back in BACKS_M:
        x, y = origin[0] - back * np.cos(origin[2]), origin[1] - back * np.sin(origin[2])
        error = 0.0
        for _ in range(2):  # where the feet and the load are changes with the heading
            reading = read_fields(pf, percept_of(_placed(carry, (x, y, origin[2] + error)), np.zeros(41)), task)
            error = np.arctan2(reading.c_W[1], reading.c_W[0]) - origin[2]
            error = float(np.arctan2(np.sin(error), np.cos(error)))
        turn = float(np.sign(error) * max(abs(error) - SECTOR_RAD, 0.0))
        room = _room(pf, carry, origin, back, turn)
        found = Departure(back_m=back, turn_rad=turn)
        if room > 0.0:
            return found
        if room > most:
            best, most = found, room
    return best


def _placed(carry: CarryState, place: tuple[float, float, float]) -> Array:
    """Configuration (43,) of the 29-joint robot in a carry state, the middle of its soles at x, y [m], yaw [rad]."""
    qpos, turn, offset = (
        RobotState.from_carry(carry).to_mujoco(29)[0],
        quat_from_yaw(place[2]),
        np.array([*place[:2], 0.0]),
    )
    for start in (0, 36):
        qpos[start : start + 3] = quat_rotate(turn, qpos[start : start + 3]) + offset
        qpos[start + 3 : start + 7] = quat_mul(turn, qpos[start + 3 : start + 7])
    return qpos


def _room(pf: HodPf, carry: CarryState, origin: tuple[float, float, float], back: float, turn: float) -> float:
    """Least distance of body, legs and load to obstacles on the way, negative where they touch [m]."""
    x, y, yaw = origin
    ahead = np.array([np.cos(yaw), np.sin(yaw)])
    way = np.array([x, y]) - np.linspace(0.0, back, 5)[1:, None] * ahead if back else np.array([[x, y]])
    body = [_distance(pf, way[-1:], z) - (LEGS_M if z < 0.5 else BODY_M) for z in HEIGHTS_M]
    behind = [_distance(pf, way - 0.1 * ahead, z) - 0.6 * LEGS_M for z in HEIGHTS_M]
    half = carry.carried.half_extents_m
    reach, radius = float(carry.object_pos_W[0]), float(np.hypot(half[0], half[1] + 0.05))
    turned = yaw + np.linspace(0.0, turn, 7)
    load = way[-1] + reach * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    arms = [_distance(pf, load, z) - radius for z in LOAD_HEIGHTS_M]
    return float(min(np.min(part) for part in (*body, *behind, *arms)))


def _distance(pf: HodPf, xy: Array, z: float) -> Array:
    return np.asarray(pf.sgf.signed_distance(np.column_stack([xy, np.full(len(xy), z)])))
