"""The judgements of `hotice.safety` in the order in which a station asks them, uncompiled, one at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice import checks
from hotice.safety import judge
from hotice.safety.faults import Answer, Fault
from hotice.safety.limits import AHEAD_S, AgeLimits, CommandLimits, MeasurementLimits
from hotice.safety.responses import response_table, still_table

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What to do now and why. `present`: every fault that is there, worst first."""

    answer: Answer
    fault: Fault
    present: tuple[Fault, ...]


class Watch:
    """Judges a robot again and again: note what was seen, then `decide`. Damping is final until `reset`.

    Args:
        lower, upper: (n,) ranges of the joints [rad]. torque: (n,) limits of the motors [N m].
        measurement, command, ages: limits, by default those of a robot.
    """

    def __init__(
        self,
        lower: ArrayLike,
        upper: ArrayLike,
        torque: ArrayLike,
        *,
        measurement: MeasurementLimits | None = None,
        command: CommandLimits | None = None,
        ages: AgeLimits | None = None,
    ) -> None:
        n = np.size(lower)
        self.lower, self.upper = checks.array("lower", lower, n), checks.array("upper", upper, n)
        self.command_limits = command or CommandLimits()
        self.torque = self.command_limits.torque_share * checks.array("torque", torque, n)
        self._measurement = judge.measurement_array(measurement or MeasurementLimits())
        self._command = judge.command_array(self.command_limits)
        self._ages = judge.age_array(ages or AgeLimits())
        self._responses, self._still_holds = response_table(), still_table()
        self.reset()

    def reset(self) -> None:
        """Forgets all: faults, counts and a final damping."""
        self.counts = np.zeros(len(Fault), dtype=int)
        self._begun, self._since = np.full(len(Fault), np.inf), np.full(len(Fault), np.inf)
        self._before, self._same = np.full(4, np.nan), np.inf
        self._numbers = np.empty(0)
        self._last = np.full(len(self.lower), np.nan)
        self._final = Fault.NONE

    def see(self, fault: Fault, now_s: float) -> None:
        """Notes a fault that was found elsewhere, as a controller that gave up."""
        self._begun[fault] = now_s

    def see_state(self, now_s: float, quat: Array, gyro: Array, q: Array, qd: Array) -> None:
        """Notes what the robot measures of itself; see `hotice.safety.judge.find_state`."""
        with np.errstate(all="ignore"):
            judge.find_state(self._begun, now_s, quat, gyro, q, qd, self.lower, self.upper, self._measurement)
            ahead_rad = judge.lean_ahead(quat, gyro, AHEAD_S)
            judge.find_falling(self._begun, now_s, ahead_rad, self._measurement)
        numbers = np.concatenate([q, qd, gyro])
        if not np.array_equal(numbers, self._numbers) or np.abs(qd).max() < judge.MOVING_RAD_S:
            self._same = np.inf
        elif not np.isfinite(self._same):
            self._same = self._taken_s
        self._numbers, self._taken_s = numbers, now_s

    def see_pose(self, now_s: float, p_WP: Array, p_WO: Array, R_WO: Array) -> None:
        """Notes places of pelvis and object; see `hotice.safety.judge.find_pose`."""
        with np.errstate(all="ignore"):
            judge.find_pose(self._begun, now_s, p_WP, p_WO, np.ravel(R_WO), self._measurement)

    def see_ages(self, now_s: float, state_s: float, command_s: float, pose_s: float, box_s: float) -> None:
        """Notes when each was made [s], NaN for never."""
        stamps = np.array([state_s, command_s, pose_s, box_s])
        judge.find_ages(self._begun, now_s, stamps, self._before, self._same, self._ages)
        self._before = stamps

    def see_targets(self, now_s: float, targets: Array) -> bool:
        """Notes joint targets [rad]; returns whether they are valid, and then remembers them as the last valid ones."""
        found = np.full(len(Fault), np.inf)
        judge.find_command(found, now_s, targets, self._last, self.lower, self.upper, self._command, True)
        return self._note(found, targets)

    def see_torques(self, now_s: float, torques: Array) -> bool:
        """Notes torques [N m]; returns whether they are valid."""
        found = np.full(len(Fault), np.inf)
        judge.find_command(found, now_s, torques, self._last, -self.torque, self.torque, self._command, False)
        return self._note(found, torques)

    def _note(self, found: Array, command: Array) -> bool:
        valid = not np.isfinite(found).any()
        if valid:
            self._last = np.array(command, dtype=float)
        np.minimum(self._begun, found, out=self._begun)
        return valid

    @property
    def last(self) -> Array:
        """The last valid command (n,), NaN before the first."""
        return self._last

    def decide(self, now_s: float, still: bool = False) -> Decision:
        """What to do about all that was noted since the last decision; `still`: the robot stands still."""
        judge.remember(self._begun, now_s, self._since, self.counts)
        answer, cause = judge.decide(now_s, self._since, still, self._responses, self._still_holds)
        present = tuple(Fault(i) for i in np.flatnonzero(np.isfinite(self._begun))[::-1])
        self._begun[:] = np.inf
        if self._final:
            return Decision(answer=Answer.DAMP, fault=self._final, present=present)
        if answer == Answer.DAMP:
            self._final = Fault(cause)
        return Decision(answer=Answer(answer), fault=Fault(cause), present=present)
