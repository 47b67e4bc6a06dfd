"""Paths between the keyframes: one nonlinear program each for crouching, reaching, closing, lifting and retreating."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan.grip import CLEAR_M, PALM_RADIUS_M
from hotice.control.pick_plan.keyframes.keyframes import CARRY_RAD, HELD_M, HELD_RAD, LIFTED_RAD, Keyframes
from hotice.control.pick_plan.paths import knot
from hotice.control.pick_plan.paths.kinematics import to_q, to_x
from hotice.control.pick_plan.paths.nlp import Knots, PathProgram
from hotice.control.pick_plan.plan import Durations
from hotice.control.pick_plan.task import (
    KNEE_ROOM_M,
    STEPPING_HEIGHT_M,
    TIPS_ABOVE_M,
    ObjectPose,
    PickTask,
    frames_at,
)
from hotice.control.whole_body.terms import Terms
from hotice.errors import PickInfeasible

Array = NDArray[np.float64]
SHORT, LONG = 3, 7
"""Knots between the ends of a path; of the retreat."""
LIFT_KNOTS = SHORT + 1
JOINT_SPEED = 4.0
"""Largest joint speed [rad/s]; the legs' and arms' motors allow 20 and more."""
EASE_PEAK = 1.875
"""Peak rate of the minimum-jerk course in which a path is followed, in units of its mean."""
SLACK_M, SLACK_RAD = 0.003, 0.005
"""Added to bounds that the keyframes at both ends may use up."""
EASED = 2.5
"""Factor of the tolerances while holding, where no path keeps them."""
REACH_GAP_M = 0.03
"""Distance of the palms from the object on their way to the pregrasp."""


@lru_cache
def program(holding: bool, knots: int) -> PathProgram:
    """The program of paths with so many knots, made once."""
    soft, hard = knot.holding() if holding else knot.free()
    return PathProgram(knots, soft, hard, knot.ROWS_HOLDING if holding else knot.ROWS_FREE)


class Paths:
    """Refines the paths of one task; `terms` serve as scratch. Raises `PickInfeasible`, naming what cannot be kept."""

    def __init__(self, task: PickTask, terms: Terms, durations: Durations) -> None:
        self.task, self.terms, self.durations = task, terms, durations
        self._pin = terms._pin

    def approach(self, keys: Keyframes) -> tuple[Array, Array, Array]:
        """From standing to the crouch, the pregrasp and the grasp, each (SHORT + 2, 27)."""
        d, q = self.durations, self.task.q_start
        return (
            self._free(q, keys.crouch, d.crouch_s, "crouching"),
            self._free(keys.crouch, keys.pregrasp, d.reach_s, "reaching beside the object"),
            self._free(keys.pregrasp, keys.grasp, d.close_s, "closing the hands"),
        )

    def retreat(self, keys: Keyframes) -> Array:
        """From the grasp over the lift, (LIFT_KNOTS steps), to the carry state, (SHORT + LONG + 3, 27)."""
        d = self.durations
        lift = self._holding(keys, keys.grasp, keys.lifted, SHORT, d.lift_s)
        retreat = self._holding(keys, keys.lifted, keys.carry, LONG, d.retreat_s)
        return np.concatenate([lift, retreat[1:]])

    def _free(self, start: Array, end: Array, seconds: float, what: str) -> Array:
        task, grip, ends = self.task, self.task.grip, to_x(self._pin, np.stack([start, end]))
        reaching, closing = what.startswith("reaching"), what.startswith("closing")
        weight = np.concatenate([np.full(6, 1.0), np.full(12, 0.02), np.full(8, 0.1)])
        common = self._standing() | {"weight": weight, "object_p": task.pose.p_WO, "side": task.pose.R_WO[:, 1]}
        guess = _between(ends, SHORT)
        theta = np.stack([knot.pack(knot.FREE, common | {"wish": wish}) for wish in guess])
        top = grip.support.top_m + TIPS_ABOVE_M if reaching else -np.inf
        side = float(grip.carried.half_extents_m[1]) + PALM_RADIUS_M
        beside = side + REACH_GAP_M if reaching else side if closing else -np.inf
        low, high = self._bounds()
        low = np.concatenate([low, np.full(4, top - SLACK_M), np.full(8, beside - SLACK_M)])
        high = np.concatenate([high, np.full(12, np.inf)])
        return self._solve(False, Knots(guess=guess, **self._limits(ends, theta, low, high, SHORT, seconds)), what)

    def _holding(self, keys: Keyframes, start: Array, end: Array, knots: int, seconds: float) -> Array:
        task, grip, hands, lifts = self.task, self.task.grip, keys.hands, knots == SHORT
        ends = to_x(self._pin, np.stack([start, end]))
        before, after = (self._object_at(q, keys) for q in (start, end))
        guess = _between(ends, knots)
        weight = np.concatenate(
            [
                np.full(3, 0.1),
                np.full(3, 2.0),
                np.full(12, 0.02),
                np.full(8, 0.5) if lifts else np.tile([3.0, 0.3, 0.3, 3.0], 2),
            ]
        )
        common = self._standing() | {
            "right_in_left_p": hands.R[0].T @ (hands.p[1] - hands.p[0]),
            "right_in_left_R": hands.R[0].T @ hands.R[1],
            "weight": weight,
            "load": grip.carried.mass_kg / (grip.carried.mass_kg + self.terms.mass_kg),
            "middle_weight": np.full(3, 200.0) if lifts else np.array([1.0, 60.0, 3.0]),
        }
        rows = []
        near = np.inf if grip.steps_back else grip.support.near_m
        lowest = grip.support.top_m + grip.carried.half_extents_m[2] + 0.5 * CLEAR_M
        way_low, way_high = np.full((knots, 3), -np.inf), np.full((knots, 3), np.inf)
        for k, share in enumerate(np.arange(1, knots + 1) / (knots + 1)):
            at = before.towards(after, float(share))
            frames = hands.carried_along(task.pose, at)
            middle = frames.p.mean(axis=0)
            off = at.p_WO[:2] - middle[:2]
            rows.append(
                common | {"wish": guess[k], "left_p": frames.p[0], "left_R": frames.R[0], "middle": middle, "off": off}
            )
            if lifts:
                way_low[k], way_high[k] = -SLACK_M - HELD_M, SLACK_M + HELD_M
            elif at.p_WO[0] + grip.carried.half_extents_m[0] > near:  # still over the support
                way_low[k, 2] = min(lowest - at.p_WO[2], 0.0) - SLACK_M
        theta, what = (
            np.stack([knot.pack(knot.HOLDING, row) for row in rows]),
            "lifting the object" if lifts else "retreating",
        )
        standing_low, standing_high = self._bounds()
        pelvis = STEPPING_HEIGHT_M + SLACK_M if lifts and grip.steps_back else np.inf

        def solve(loose: float) -> Array:
            hold = loose * np.concatenate([np.full(3, 2 * HELD_M), np.full(3, HELD_RAD + SLACK_RAD)])
            upright = np.full(3, loose * ((LIFTED_RAD if lifts else CARRY_RAD) + SLACK_RAD))
            room = (loose - 1.0) * SLACK_M
            low = np.array([np.concatenate([standing_low, -hold, -upright, way - room, [-np.inf]]) for way in way_low])
            high = np.array([np.concatenate([standing_high, hold, upright, way + room, [pelvis]]) for way in way_high])
            return self._solve(True, Knots(guess=guess, **self._limits(ends, theta, low, high, knots, seconds)), what)

        try:
            return solve(1.0)
        except PickInfeasible:
            return solve(EASED)

    def _object_at(self, q: Array, keys: Keyframes) -> ObjectPose:
        """Where the left hand holds the object at a configuration."""
        pose, hands, now = self.task.pose, keys.hands, frames_at(self.terms, q)
        turn = now.R[0] @ hands.R[0].T
        return ObjectPose(p_WO=now.p[0] + turn @ (pose.p_WO - hands.p[0]), R_WO=turn @ pose.R_WO)

    def _standing(self) -> dict[str, Array]:
        return {"wrists": self.task.grip.wrist_pos, "feet_p": self.task.feet.p, "feet_R": self.task.feet.R}

    def _bounds(self) -> tuple[Array, Array]:
        """Bounds of feet, centre of mass and knees, (16,) each."""
        room = self.task.grip.support.near_m - KNEE_ROOM_M + SLACK_M
        low = np.concatenate([np.zeros(12), self.task.com_box_m[0] - SLACK_M, np.full(2, -np.inf)])
        return low, np.concatenate([np.zeros(12), self.task.com_box_m[1] + SLACK_M, np.full(2, room)])

    def _limits(
        self, ends: Array, theta: Array, low: Array, high: Array, knots: int, seconds: float
    ) -> dict[str, Array]:
        step = JOINT_SPEED * seconds / (knots + 1) / EASE_PEAK
        return {
            "ends": ends,
            "theta": theta,
            "joint_low": self.terms.lower,
            "joint_high": self.terms.upper,
            "low": np.broadcast_to(low, (knots, low.shape[-1])),
            "high": np.broadcast_to(high, (knots, high.shape[-1])),
            "step": np.full(20, step),
        }

    def _solve(self, holding: bool, knots: Knots, what: str) -> Array:
        return to_q(self._pin, program(holding, len(knots.guess)).solve(knots, what))


def _between(ends: Array, knots: int) -> Array:
    """Knots evenly between the two ends, (K, 26)."""
    share = np.arange(1, knots + 1)[:, None] / (knots + 1)
    return (1.0 - share) * ends[0] + share * ends[1]
