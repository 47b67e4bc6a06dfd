"""Memory of a pick-up from step to step, and what it hands on within one."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan import PickPlan
from hotice.control.pickup.footwork import Course, Feet
from hotice.control.pickup.stance import Stance
from hotice.control.whole_body.qp import QpMemory

Array = NDArray[np.float64]


@dataclass(kw_only=True)
class PickupMemory:
    """State that lasts from step to step.

    Attributes:
        stance: the frame G of all that follows, None before the first finite measurement. start: (27,) the robot at the
        start. phase, since_s: what is done and since when. plan: of the present attempt; None while there is none.
        came_from: (27,) reference when the phase began. reference: (27,) of the last step.
        squeeze_n: present target force of each hand. lost_since_s: since when a hand feels too little.
        course, com0: of the steps that are being taken, and the common centre of mass (2,) when they began.
        feet: (2, 4) ankles of a put-down when it began. goal: (27,) where its settling leads.
        shift: (3,) of the reference of a put-down, towards which a phase moves it.
        failure: why the pick-up was aborted, empty where it was not. attempt: grasps begun.
    """

    qp: QpMemory
    stance: Stance | None
    phase: str
    since_s: float
    came_from: Array
    reference: Array
    start: Array
    plan: PickPlan | None = None
    squeeze_n: float = 0.0
    load_share: float = 0.0
    course: Course | None = None
    com0: Array = field(default_factory=lambda: np.zeros(2))
    air: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(2, dtype=bool))
    shift_m: float = 0.0
    feet: Array = field(default_factory=lambda: np.zeros((2, 4)))
    goal: Array = field(default_factory=lambda: np.zeros(27))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    lost_since_s: float | None = None
    object_z_m: float = 0.0
    attempt: int = 0
    failure: str = ""
    log: list[tuple[float, str, str]] = field(default_factory=list)

    def copy(self) -> PickupMemory:
        """An independent copy; plans are never changed and are shared."""
        return replace(self, qp=copy.deepcopy(self.qp), air=self.air.copy(), log=list(self.log))


@dataclass
class Motion:
    """Motion of one step's reference beside its configuration, in G.

    Attributes:
        rate: (26,) velocity of the reference. com_acc: (3,) of the centre of mass.
        feet: where the ankles go while a foot is in the air.
    """

    rate: Array = field(default_factory=lambda: np.zeros(26))
    com_acc: Array = field(default_factory=lambda: np.zeros(3))
    feet: Feet | None = None
