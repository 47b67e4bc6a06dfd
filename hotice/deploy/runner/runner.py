"""One control period of the runner: the guard's status in, targets out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.clock import Clock
from hotice.deploy.guard.modes import DRIVEN, Mode
from hotice.deploy.runner.around import Around
from hotice.deploy.runner.estimator import Estimate, Estimator
from hotice.deploy.slot.records import TARGETS
from hotice.fields.hod_pf import HodPf
from hotice.fields.moving.momentary import MomentaryPf
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.robot_state import RobotState, joint_index
from hotice.model.scene import GOAL_HEIGHT_M
from hotice.policy import Percept, PerceptModel, PolicySession, read_fields
from hotice.policy.carry_policy import CarryPolicy
from hotice.policy.guidance import FieldReading, read_standing
from hotice.task.rules import arrived

Array = NDArray[np.float64]
WARM_STEPS = 5
"""Steps that are run for nothing, so that the first that counts compiles and loads nothing."""
_ACTION = joint_index(len(g1.ACTION_JOINTS))
_WRIST = [g1.ALL_JOINTS.index(joint) for joint in g1.WRIST_JOINTS]


class RobotRunner:
    """Call `tick` once a control period.

    Args:
        policy: the file; `pf`: fields of the scene with its goal; `carry`: how the object is held
        estimator: of percepts
        status: the guard's (`RunnerSlot.status`); `put`: takes targets (`RunnerSlot.put`)
        clock: the guard's, too
        around: what moves in the scene; `pf` is of what never moves then
    """

    def __init__(
        self,
        policy: PolicySession,
        pf: HodPf,
        carry: CarryState,
        estimator: Estimator,
        status: Callable[[], np.ndarray | None],
        put: Callable[[np.ndarray], None],
        clock: Clock,
        around: Around | None = None,
    ) -> None:
        self.policy = CarryPolicy(policy, carry)
        self._pf, self._carry, self._estimator, self.around = pf, carry, estimator, around
        self._status, self._put, self._clock = status, put, clock
        self._targets = np.zeros((), TARGETS)
        self._targets["q"] = self.all_joints(self.policy.rest)
        self._place_W: Array | None = None
        self._mode = Mode.OFF
        self._goal_W = np.array([*pf.scene.goal_W[:2], GOAL_HEIGHT_M])
        self.estimate: Estimate | None = None
        """The newest."""
        self.status: np.ndarray | None = None
        """The guard's, of the last tick."""
        self.began_s = -np.inf
        """When the last tick began [s]."""
        self.acted = False
        """Whether the policy made the targets of the last tick."""

    @property
    def period_s(self) -> float:
        """Time between two ticks [s]."""
        return self.policy.task.control_dt_s

    @property
    def goal_m(self) -> float | None:
        """Distance from the goal [m], None while it is not known."""
        if self.estimate is None:
            return None
        return float(np.linalg.norm(self.estimate.percept.p_WP[:2] - self._pf.scene.goal_W[:2]))

    def warm(self) -> None:
        """Runs percept, fields and policy a few times at the start of the scene; until then no guard moves anything."""
        held = RobotState.from_carry(self._carry)
        percept = PerceptModel(self._carry.carried)(*held.to_mujoco(len(g1.ALL_JOINTS)))
        fields = self._pf if self.around is None else self.around.guess()
        for _ in range(WARM_STEPS):
            reading = read_fields(fields, percept, self.policy.task)
            self.policy.act(percept, self._standing(reading, percept))
        self._resting()
        self._targets["warm"] = 1

    @property
    def _fields(self) -> HodPf | MomentaryPf:
        return self._pf if self.around is None else self.around.fields

    def all_joints(self, q: Array) -> Array:
        """Targets (29,) of targets (20,): the waist straight, the wrists as in the carry state [rad]."""
        targets = np.zeros(len(g1.ALL_JOINTS))
        targets[_WRIST] = self._carry.wrist_pos
        targets[_ACTION] = q
        return targets

    def tick(self) -> None:
        """Reads the guard's status and writes targets; none where no state came, or where they would not be finite."""
        began_s = self._clock.now()
        self.acted, self.estimate = False, None
        self.began_s, self.status = began_s, (status := self._status())
        if status is None:
            return
        mode = Mode(int(status["mode"]))
        estimate = None
        if mode is Mode.CARRY and self._mode is Mode.HOLD:
            # the operator saw what it insists on, and went on
            self._estimator.settle()
        self._mode = mode
        if status["sequence"]:
            estimate = self._estimator.update(status["state"], began_s, float(status["received_s"]))
        self.estimate = estimate
        if self.around is not None:
            self.around.look(began_s)
        if mode is Mode.HOLD:
            # who stands is seen by the operator, but stands by what it was sure of: by a wrong heading it would walk
            self._estimator.acknowledge()
        elif mode not in DRIVEN:
            self._estimator.settle()
        q = self._moving(mode, estimate) if mode in DRIVEN else self._resting()
        if q is None:
            return
        self.acted = mode in DRIVEN
        targets = self._targets
        targets["number"] += 1
        targets["stamp_s"], targets["state_sequence"] = began_s, status["sequence"]
        targets["q"] = self.all_joints(q)
        pose_s = np.inf if estimate is None else estimate.pose_age_s
        movers_s = 0.0 if self.around is None else self.around.age_s
        targets["pose_age_s"], targets["movers_old"] = max(pose_s, movers_s), movers_s > pose_s
        targets["box_age_s"] = np.inf if estimate is None else estimate.box_age_s
        targets["pose_disputed"] = estimate is not None and estimate.disputed
        self._put(targets)

    def _resting(self) -> Array:
        self.policy.reset()
        self._place_W = None
        self._targets["done"] = 0
        return self.policy.rest

    def _moving(self, mode: Mode, estimate: Estimate | None) -> Array | None:
        if estimate is None:
            return None
        reading = read_fields(self._fields, estimate.percept, self.policy.task)
        # a place that is disputed is not gone by, nor are movers long unseen, not for the moment either that the guard
        # takes to hold
        sure = not estimate.disputed and (self.around is None or self.around.sure)
        if mode is Mode.CARRY and sure:
            there = arrived(float(reading.goal_distance[0]))
            self._targets["done"] = there
            # who stops there stands at the goal, not where it was when it was near enough
            self._place_W = self._goal_W if there else None
        else:
            # picking up and putting down are not there yet: the robot stands
            self._targets["done"] = 0
            reading = self._standing(reading, estimate.percept)
        return self.policy.act(estimate.percept, reading)

    def _standing(self, reading: FieldReading, percept: Percept) -> FieldReading:
        """The reading of a robot that stays where it was when it began to stand."""
        if self._place_W is None:
            self._place_W = np.array([*percept.p_WP[:2], GOAL_HEIGHT_M])
        return read_standing(reading, percept, self._place_W, self.policy.task, self._pf.params.attraction)
