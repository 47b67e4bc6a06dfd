"""Steps with an object in the hands, on a course known from the start: back and turning, or to a stance nearby.

The zero-moment point rests under the standing foot while the other swings and moves over while both stand; the centre
of mass is the only course p = c − (h/g) c̈ that has it and stays bounded, solved as one banded system. The body moves
as one piece. Linear inverted pendulum: Kajita et al., Biped walking pattern generation by using preview control of
zero-moment point, 2003.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.model.frames import GRAVITY, rotation_z

Array = NDArray[np.float64]
SOLE_AHEAD_M = 0.035  # middle of the sole ahead of the ankle
INWARD_M = 0.008  # where the weight rests: from the middle of the sole towards the other foot
SWING_HEIGHT_M = 0.04
FIRST_S, SWING_S, BOTH_S, LAST_S = 0.8, 0.45, 0.2, 0.8
QUICK_SWING_S, QUICK_BOTH_S = 0.28, 0.12
"""Of steps to a stance nearby, which begin with the feet anyhow: over one of two feet that stand far apart the other's
ankle does not bend as far as a slow step needs."""
LANDING_S = 0.2  # after a swing, in which its foot may still look for the floor
GRID_S = 0.005
STEP_M, STEP_RAD = 0.15, 0.35  # longest steps
FARTHEST_M = 1.0
ASKEW_M = 0.03


@dataclass(frozen=True, kw_only=True)
class Departure:
    """Distance to step back [m] and angle to turn, left positive [rad]. Raises `InvalidConfig`."""

    back_m: float = 0.0
    turn_rad: float = 0.0

    def __post_init__(self) -> None:
        checks.number("back_m", self.back_m, Range(least=0, most=FARTHEST_M, unit="m"))
        checks.number("turn_rad", self.turn_rad, Range(least=-np.pi, most=np.pi, note="half a turn"))

    def stances(self) -> list[tuple[float, float]]:
        """(back [m], turn [rad]) after each pair of steps; empty where there is nothing to do.

        The first half of the way back is straight, so that the load is clear of the support before it turns.
        """
        count = math.ceil(max(self.back_m / STEP_M, abs(self.turn_rad) / STEP_RAD, 0.0) - 1e-9)
        backs = max(math.ceil(self.back_m / STEP_M - 1e-9), 1)
        turns = max(math.ceil(abs(self.turn_rad) / STEP_RAD - 1e-9), 1)
        straight = min(backs // 2, max(count - 1, 0)) if self.turn_rad else 0
        count = max(backs, straight + turns) if count else 0
        found = []
        for k in range(1, count + 1):
            turned = min(max(k - straight, 0) / turns, 1.0)
            found.append((self.back_m * min(k / backs, 1.0), self.turn_rad * turned))
        return found


@dataclass(frozen=True, kw_only=True)
class Swing:
    """A foot on its way from one pose (x, y, z, yaw) of the ankle to another, from `begin_s` on."""

    begin_s: float
    foot: int
    start: Array
    end: Array


@dataclass(frozen=True, kw_only=True)
class Body:
    """Motion of the body since the start: shift (2,) of its centre of mass [m], acceleration (2,), turn [rad]."""

    shift: Array
    acceleration: Array
    turn_rad: float


@dataclass(frozen=True, kw_only=True)
class Feet:
    """pose, velocity (2, 4): x, y, z, yaw of the ankles; air, landed: foot that swings, foot just landed, or -1."""

    pose: Array
    velocity: Array
    air: int
    landed: int


@dataclass(frozen=True, kw_only=True)
class Course:
    """See `plan_steps`. feet (2, 4) at the start; com, com_acc (T, 2) every `GRID_S`; turns: (time, turn) in order.

    swing_s: of each step.
    """

    swings: tuple[Swing, ...]
    feet: Array
    com: Array
    com_acc: Array
    turns: tuple[tuple[float, float], ...]
    swing_s: float = SWING_S

    @property
    def seconds(self) -> float:
        """Length of the whole."""
        return (len(self.com) - 1) * GRID_S

    def body_at(self, time_s: float) -> Body:
        """Place and heading of the body."""
        place = min(max(time_s / GRID_S, 0.0), len(self.com) - 1.0)
        i = min(int(place), len(self.com) - 2)
        s, com, acc = place - i, self.com, self.com_acc
        shift = (1 - s) * com[i] + s * com[i + 1] - com[0]
        return Body(shift=shift, acceleration=(1 - s) * acc[i] + s * acc[i + 1], turn_rad=self._turn(time_s))

    def _turn(self, time_s: float) -> float:
        (begin, turn), *rest = self.turns
        for end, new in rest:
            if time_s < end:
                return turn + ease((time_s - begin) / (end - begin)) * (new - turn)
            begin, turn = end, new
        return turn

    def feet_at(self, time_s: float) -> Feet:
        """Where the feet are."""
        pose, velocity, air, landed = self.feet.copy(), np.zeros((2, 4)), -1, -1
        for swing in self.swings:
            share = (time_s - swing.begin_s) / self.swing_s
            if share < 0.0:
                break
            s = ease(share)
            pose[swing.foot] = swing.start + s * (swing.end - swing.start)
            if share < 1.0:
                air = swing.foot
                pose[air, 2] += SWING_HEIGHT_M * math.sin(math.pi * s) ** 2
                rate = 30.0 * share**2 * (1.0 - share) ** 2 / self.swing_s
                velocity[air] = rate * (swing.end - swing.start)
                velocity[air, 2] += rate * SWING_HEIGHT_M * math.pi * math.sin(2.0 * math.pi * s)
            elif time_s < swing.begin_s + self.swing_s + LANDING_S:
                landed = swing.foot
        return Feet(pose=pose, velocity=velocity, air=air, landed=landed)


def ease(share: float) -> float:
    """Minimum-jerk course from 0 to 1 while `share` goes from 0 to 1, held outside."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 + s * (6.0 * s - 15.0))


@dataclass(frozen=True, kw_only=True)
class Goal:
    """After a pair of steps: feet (2, 4), centre of mass (2,) at rest over them [m], turn of the body [rad]."""

    feet: Array
    com: Array
    turn_rad: float


def plan_steps(feet: Array, com: Array, height_m: float, departure: Departure) -> Course:
    """Course of stepping back along the heading of the feet and turning.

    Args:
        feet: (2, 4) ankles, left and right: x, y, z [m], yaw [rad]. com: (2,) centre of mass of robot and load, at
            rest.
        height_m: of the centre of mass above the soles. departure: how far.
    """
    yaw = float(feet[:, 3].mean())
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    middle = feet[:, :2].mean(axis=0) + SOLE_AHEAD_M * ahead
    goals = []
    for back, turn in departure.stances():
        R, to = _turned(turn), middle - back * ahead
        goal = np.column_stack([to + (feet[:, :2] - middle) @ R.T, feet[:, 2], feet[:, 3] + turn])
        goals.append(Goal(feet=goal, com=to + R @ (com - middle), turn_rad=turn))
    return course_through(feet, com, height_m, goals)


def plan_approach(feet: Array, com: Array, height_m: float, end: Goal) -> Course:
    """Course to a stance nearby, in as many pairs of equal steps as it takes: to where the feet of `end` are.

    Args: as of `plan_steps`. The first pair of steps has the feet as they stand to each other in the end; where they
    stand otherwise by more than `ASKEW_M` that is all it does.
    """
    to, yaws = end.feet[:, :2].mean(axis=0), np.array([feet[:, 3].mean(), end.feet[:, 3].mean()])
    middle = feet[:, :2].mean(axis=0)
    ways = (np.linalg.norm(to - middle) / STEP_M, abs(yaws[1] - yaws[0]) / STEP_RAD, abs(end.turn_rad) / STEP_RAD)
    count = max(math.ceil(max(ways) - 1e-9), 1)
    R = _turned(float(yaws[0] - yaws[1]))
    askew = np.abs(feet[:, :2] - middle - (end.feet[:, :2] - to) @ R.T).max()
    goals = []
    for share in np.arange(0 if askew > ASKEW_M else 1, count + 1) / count:
        back = (1.0 - share) * (yaws[0] - yaws[1])
        at, R = to + (1.0 - share) * (middle - to), _turned(back)
        placed = np.column_stack([at + (end.feet[:, :2] - to) @ R.T, end.feet[:, 2], end.feet[:, 3] + back])
        goals.append(Goal(feet=placed, com=at + R @ (end.com - to), turn_rad=share * end.turn_rad))
    return course_through(feet, com, height_m, goals, QUICK_SWING_S, QUICK_BOTH_S)


def course_through(
    feet: Array,
    com: Array,
    height_m: float,
    goals: Sequence[Goal],
    swing_s: float = SWING_S,
    both_s: float = BOTH_S,
) -> Course:
    """Course of a pair of steps to each of `goals`; the foot on the inner side opens a turn."""
    now, swings, t = feet.copy(), [], FIRST_S
    times, zmp, turns, end = [0.0, 0.3 * FIRST_S], [com, com], [(0.0, 0.0), (FIRST_S, 0.0)], com
    order = (1, 0) if goals and goals[-1].turn_rad < 0 else (0, 1)
    for goal in goals:
        end = goal.com
        for foot in order:
            stance = now[1 - foot, :2] + _turned(now[1 - foot, 3]) @ [SOLE_AHEAD_M, INWARD_M * (1 - 2 * foot)]
            swings.append(Swing(begin_s=t, foot=foot, start=now[foot].copy(), end=goal.feet[foot]))
            times += [t, t + swing_s]
            zmp += [stance, stance]
            now[foot] = goal.feet[foot]
            t += swing_s + both_s
        turns.append((t - both_s, goal.turn_rad))
    times += [t - both_s + 0.5 * LAST_S, t - both_s + LAST_S]
    zmp += [end, end]
    grid = np.arange(0.0, times[-1] + 1e-9, GRID_S)
    p = np.stack([np.interp(grid, times, np.array(zmp)[:, i]) for i in range(2)], axis=1)
    course = _pendulum(p, height_m)
    acceleration = GRAVITY / height_m * (course - p)
    acceleration[[0, -1]] = 0.0
    return Course(
        swings=tuple(swings), feet=feet.copy(), com=course, com_acc=acceleration, turns=tuple(turns), swing_s=swing_s
    )


def _turned(yaw: float) -> Array:
    return rotation_z(yaw)[:2, :2]


def _pendulum(p: Array, height_m: float) -> Array:
    """Centre of mass (T, 2) whose zero-moment point is p (T, 2), starting and ending over it."""
    from scipy.linalg import solve_banded

    k = height_m / GRAVITY / GRID_S**2
    n = len(p)
    bands = np.zeros((3, n))
    bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = -k, 1.0 + 2.0 * k, -k
    bands[1, [0, -1]] = 1.0
    return solve_banded((1, 1), bands, p)
