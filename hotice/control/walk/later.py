"""The walking baseline for a walk that begins where the robot will be by then: it plans at its first step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hotice.control.controller import Command, Measurement
from hotice.control.walk.controller import WalkController
from hotice.control.walk.memory import STAND, WalkMemory
from hotice.control.walk.path import PELVIS_HEIGHT_M
from hotice.control.walk.plan import plan_walk
from hotice.control.whole_body.terms import FEET, Terms
from hotice.errors import HoticeError, UnreachableGoal
from hotice.fields import HodPf
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.frames import yaw_from_quat


@dataclass(kw_only=True)
class LaterMemory:
    """controller, memory: of the walk that was planned; None where there is no way, then `failure` says why."""

    controller: WalkController | None
    memory: WalkMemory | None
    failure: str = ""


class WalkLater:
    """Walks to the goal of the fields from where it is started; without a way it stands, holding the object.

    See `hotice.control.controller.Controller`. `state`: the carry state in which it takes over, from standing.
    """

    def __init__(self, pf: HodPf, state: CarryState, rate_hz: float = 200.0) -> None:
        self.pf, self.state, self.rate_hz = pf, state, rate_hz
        self._terms = Terms(state.wrist_pos)

    def start(self, measurement: Measurement) -> LaterMemory:
        """Plans. The controller belongs to the memory: another start makes another plan."""
        self._terms.update(measurement)
        x, y = self._terms.p_WF[FEET, :2].mean(axis=0)
        place = (float(x), float(y), float(yaw_from_quat(measurement.quat_WP)))
        try:
            if not np.isfinite(self.pf.sgf.geodesic_distance(np.array([x, y, PELVIS_HEIGHT_M]))):
                raise UnreachableGoal(
                    f"no way leads from ({x:.2f}, {y:.2f}) m to the goal of scene {self.pf.scene.name!r}"
                )
            plan = plan_walk(self.pf, self.state, place)
        except HoticeError as error:
            return LaterMemory(controller=None, memory=None, failure=str(error))
        controller = WalkController(plan, self.state, rate_hz=self.rate_hz)
        return LaterMemory(controller=controller, memory=controller.start(measurement))

    def step(self, memory: LaterMemory, measurement: Measurement) -> tuple[Command, LaterMemory]:
        """One step of the walk, or of standing."""
        if memory.controller is None or memory.memory is None:
            kp, kd = g1.gains()
            m = measurement
            torque = (
                kp * (self.state.joint_target - m.joint_pos) - kd * m.joint_vel if m.finite() else self.state.torque
            )
            return Command(torque=np.asarray(torque), phase=STAND, faults=0), memory
        command, walked = memory.controller.step(memory.memory, measurement)
        return command, LaterMemory(controller=memory.controller, memory=walked)
