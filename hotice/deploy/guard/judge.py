"""All rows of the fault table at one instant: which faults are there now, and what each asks for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hotice.deploy.guard import faults
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.faults import Cause, Finding, Reaction
from hotice.deploy.guard.measured import Measured
from hotice.deploy.guard.targets import Targets
from hotice.deploy.messages.hg import JOINTS
from hotice.safety.judge import lean_ahead
from hotice.safety.limits import AHEAD_S


class Judge:
    """Knows how long heat, charge and errors have lasted; all else is in what it is given."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._since: dict[Cause, float] = {}

    def findings(
        self,
        measured: Measured,
        targets: Targets,
        *,
        now_s: float,
        charge: float | None,
        gamepad_s: float,
        foreign: int,
        driven: bool,
    ) -> list[Finding]:
        """Faults that are there now, worst first. `driven`: the runner is needed; `foreign`: new commands of others."""
        found = [
            *self._of_robot(measured, now_s, charge),
            *(self._of_runner(targets, now_s) if driven else ()),
        ]
        if self._config.gamepad_needed:
            reaction = faults.gamepad(gamepad_s, self._config.limits)
            found.append(Finding(Cause.GAMEPAD, reaction, "no gamepad for {:.1f} s", gamepad_s))
        if foreign:
            found.append(Finding(Cause.PUBLISHER, Reaction.DAMPING, "somebody else sent {} commands", foreign))
        return sorted((f for f in found if f.reaction is not Reaction.NONE), key=lambda f: f.reaction, reverse=True)

    def _of_robot(self, measured: Measured, now_s: float, charge: float | None) -> Iterator[Finding]:
        limits = self._config.limits
        age_s, refused = measured.age_s(now_s), measured.refused_in_a_row
        yield Finding(Cause.STATE_AGE, faults.state_age(age_s, limits), "state is {:.3f} s old", age_s)
        yield Finding(Cause.STATES_REFUSED, faults.states_refused(refused, limits), "{} states refused", refused)
        if measured.newest is None:
            return
        state = measured.newest.record
        imu, motors = state["imu_state"], state["motor_state"][JOINTS]
        yield Finding(Cause.LEAN, faults.lean(imu["quaternion"], limits), "the pelvis leans too far")
        yield Finding(Cause.FALLING, faults.falling(self._falling_s(measured), limits), "the pelvis is falling over")
        speed = faults.joint_speed(motors["dq"], limits)
        yield Finding(Cause.JOINT_SPEED, speed, "a joint is too fast")
        yield Finding(Cause.GYRO, faults.gyro(imu["gyroscope"], limits), "the pelvis turns too fast")
        lasting = (
            (Cause.HEAT, faults.hot(motors["temperature"], limits), "a motor is hot"),
            (Cause.BATTERY, faults.empty(charge, limits), "the battery is low"),
            (Cause.MOTOR, bool((motors["motorstate"] != 0).any()), "a motor reports an error"),
        )
        for cause, there, text in lasting:
            if not there:
                self._since.pop(cause, None)
                continue
            lasted_s = now_s - self._since.setdefault(cause, now_s)
            yield Finding(cause, faults.lasting(lasted_s, limits), text)

    def _falling_s(self, measured: Measured) -> float:
        """How long states have said that the robot falls over [s]; minus infinity: the newest does not."""
        newest = measured.newest
        assert newest is not None
        imu = newest.record["imu_state"]
        quaternion = imu["quaternion"] / np.linalg.norm(imu["quaternion"])
        if lean_ahead(quaternion.tolist(), imu["gyroscope"].tolist(), AHEAD_S) <= self._config.limits.falling_rad:
            self._since.pop(Cause.FALLING, None)
            return -np.inf
        return newest.received_s - self._since.setdefault(Cause.FALLING, newest.received_s)

    def _of_runner(self, targets: Targets, now_s: float) -> Iterator[Finding]:
        limits = self._config.limits
        age_s, refused = targets.age_s(now_s), targets.refused_in_a_row
        yield Finding(Cause.TARGET_AGE, faults.target_age(age_s, limits), "targets are {:.3f} s old", age_s)
        yield Finding(
            Cause.TARGETS_REFUSED, faults.targets_refused(refused, limits), "targets refused: {}", targets.why
        )
        newest = targets.newest
        if newest is None:
            return
        # the runner measured these ages when it began; they have grown since
        box_s, pose_s = float(newest["box_age_s"]) + age_s, float(newest["pose_age_s"]) + age_s
        unseen = "box not seen for {:.1f} s" if np.isfinite(box_s) else "box not seen yet"
        yield Finding(Cause.BOX_UNSEEN, faults.box_unseen(box_s, limits), unseen, box_s)
        if newest["movers_old"]:
            old = "what moves was seen {:.1f} s ago" if np.isfinite(pose_s) else "what moves is not seen yet"
        else:
            old = "localization is {:.1f} s old" if np.isfinite(pose_s) else "no localization yet"
        yield Finding(Cause.POSE_AGE, faults.pose_age(pose_s, limits), old, pose_s)
        disputed = Reaction.HOLD if newest["pose_disputed"] else Reaction.NONE
        yield Finding(Cause.POSE_DISPUTED, disputed, "localization and tracking disagree: place the robot by hand")
