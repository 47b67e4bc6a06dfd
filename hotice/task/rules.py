"""What counts in the task: a fall, a drop, an arrival, a success. Each is defined here, and nowhere else.

Training, scores, stations, rehearsals and pages ask these functions, states of MuJoCo by way of `hotice.task.judge`.
They take numbers, NumPy arrays or torch tensors, of one robot or of many, and return bools of the same kind; `diverged`
and `outcome_code` take arrays or tensors.
"""

from __future__ import annotations

from typing import Any

OUTCOMES = (
    "running",
    "success",
    "fall",
    "drop",
    "robot_collision",
    "object_collision",
    "timeout",
    "unstable",
    "walked_into",
)
"""Outcomes by their code. Success: an arrival before any failure, and within the time limit. Unstable: the simulation
diverged. Walked into: a collision with something that moves, of a robot that stands. Running: no end yet."""
PRECEDENCE = ("unstable", "fall", "drop", "robot_collision", "object_collision", "walked_into", "success", "timeout")
"""Of several events in one control step the first of these is the outcome: a failure wins over an arrival, an arrival
over the time limit."""

GOAL_M = 0.1
"""An arrival: the root is this near to the goal, horizontally (paper, V-A)."""
FALLEN_M = 0.35
"""Below this height of the pelvis a robot has fallen (ours). `Posture` allows carry states down to 0.40 m."""
UPRIGHT = 0.5
"""And below this cosine of the pelvis' lean: 60 degrees (ours)."""
LEANING = 0.7
"""In a rehearsal: below this cosine of the pelvis' lean, 45 degrees (ours); carry states lean by 34 at most."""
APART_M = 0.15
"""An object so far from the middle between the hands is dropped (ours)."""
LOW_M = 0.25
"""So is one whose centre is lower than this (ours)."""
STANDS_M, STANDS_S = 0.1, 0.5
"""A robot stands whose root has come less far than this in so long, horizontally (ours)."""
MOVES_M_S = 0.05
"""What is slower does not move; also of what turns, in rad/s."""
IN_CARRY_M, IN_CARRY_RAD = 0.08, 0.4363
"""A pick-up: the object is this near to its place in the carry state, seen from the feet, and turned by at most 25
degrees from upright and straight; round objects may be turned (ours, as the model-based pick-up is scored)."""
LIFTED_M = 0.02
"""And its lowest point is this far above the support, or beside it (ours)."""
HELD_S = 5.0
"""And all this for so long without a break (ours)."""
PLACED_M, PLACED_RAD, HANDS_OFF_M, STOOD_S = 0.05, 0.1745, 0.03, 2.0
"""A put-down: the object is this near to its place, leaning by at most 10 degrees, the hands are this far off it, and
the robot stands, for so long without a break (ours)."""
FASTEST = 1e3
"""Of any velocity, and of the root's coordinates: what is beyond has diverged [m/s, rad/s, m]."""


def fallen(height_m: Any, up: Any) -> Any:
    """Whether a robot has fallen, from the height of its pelvis [m] and the z component of the pelvis' z axis in W."""
    return (height_m < FALLEN_M) | (up < UPRIGHT)


def falling(height_m: Any, up: Any) -> Any:
    """`fallen`, or about to: for rehearsals, which last a few seconds and decide who gets the robot.

    What leans by 45 degrees when a rehearsal ends must not pass for lack of time to fall. No stricter height: a robot
    whose knees give way from 0.5 m is below 0.35 m 0.1 s later, and carry states stand as low as 0.40 m.
    """
    return fallen(height_m, up) | (up < LEANING)


def dropped(apart_m: Any, height_m: Any) -> Any:
    """Whether the object is dropped: `apart_m` from its centre to the middle between the hands, its height [m]."""
    return (apart_m > APART_M) | (height_m < LOW_M)


def arrived(goal_m: Any, radius_m: float = GOAL_M) -> Any:
    """Whether the root, `goal_m` from the goal horizontally [m], is there."""
    return goal_m < radius_m


def walked_into(met: Any, way_m: Any) -> Any:
    """Whether a collision is no fault of the robot: with something that moves (`met`), and the robot stands.

    `way_m`: how far the root has come in the last `STANDS_S`, or since the start, horizontally.
    """
    return met & (way_m < STANDS_M)


def in_carry(away_m: Any, turned_rad: Any, above_m: Any) -> Any:
    """Whether the object is held in the carry state.

    `away_m` from its place there [m], turned by `turned_rad`, its lowest point `above_m` over the support [m].
    """
    return (away_m <= IN_CARRY_M) & (turned_rad <= IN_CARRY_RAD) & (above_m >= LIFTED_M)


def picked(held_s: Any) -> Any:
    """Whether a pick-up is done, the object having been `in_carry` for `held_s` without a break [s]."""
    return held_s >= HELD_S - 1e-6


def put_down(away_m: Any, lean_rad: Any, apart_m: Any) -> Any:
    """Whether an object stands in its place: `away_m` off [m], leaning by `lean_rad`, hands `apart_m` off it [m]."""
    return (away_m <= PLACED_M) & (lean_rad <= PLACED_RAD) & (apart_m >= HANDS_OFF_M)


def diverged(qpos: Any, qvel: Any) -> Any:
    """Whether states qpos (..., nq), qvel (..., nv), root first, are none that a robot can have, (...)."""
    finite = (abs(qpos) < float("inf")).all(-1)
    return ~(finite & (abs(qpos[..., :3]) <= FASTEST).all(-1) & (abs(qvel) <= FASTEST).all(-1))


def outcome_code(code: Any, **seen: Any) -> Any:
    """Writes the outcome of N episodes into `code` (N,), integers, and returns it; 0 stays where nothing was seen.

    `seen`: events by name, (N,) bool each; of several the first in `PRECEDENCE` counts.
    """
    for name in sorted(seen, key=PRECEDENCE.index, reverse=True):
        code[seen[name]] = OUTCOMES.index(name)
    return code
