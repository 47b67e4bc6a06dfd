"""One walk, from the scene's start until the robot falls, drops its object, or another walk begins."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.fields.live import LiveField
from hotice.model.carry import CarryState
from hotice.model.scene import Obstacle
from hotice.policy import Percept, read_fields
from hotice.policy.carry_policy import CarryPolicy, Network
from hotice.policy.guidance import FieldReading, read_standing
from hotice.replay.touch import touch_text
from hotice.task.rules import STANDS_S, walked_into
from hotice.task.sensing import STUDENT_SENSING, SensingConfig
from hotice.view.halting import Halting
from hotice.view.senses import Senses
from hotice.view.world import World

Array = NDArray[np.float64]
AFTER_S = 1.0
"""A fall or a drop is shown for so long, then time stands still [s] (ours)."""
MOST_EVENTS = 20


class Walk:
    """A robot with its object, its policy and its senses; `step` once a control period.

    Attributes:
        task: constants of the policy.
        world, percept, reading: the robot, what it sensed and read in the last step (before the first: at the start).
        qpos: (43,) the last state that was none of a simulation that diverged.
        time_s: since the start [s]. over: a fall, a drop or a diverged state, by its name; empty for none.
        touches: pairs of a solid and an obstacle that have touched since the start.
        events: what happened, newest last, as the page lists it.
    """

    def __init__(
        self,
        live: LiveField,
        network: Network,
        carry: CarryState,
        obstacles: Iterable[Obstacle],
        *,
        noise: bool,
        seed: int,
    ) -> None:
        """Puts the robot at the start of the scene of `live`. Raises `CheckpointError`: a policy that does not fit."""
        self._live, self._policy = live, CarryPolicy(network, carry)
        self.task = self._policy.task
        self.world = World(carry, live.scene, self.task.control_dt_s)
        self.world.put(obstacles)
        sensing = STUDENT_SENSING if noise else SensingConfig()
        self._senses = Senses(carry.carried, sensing, self.task.control_dt_s, self.world.substeps, seed)
        self._halting = Halting()
        self.time_s, self.over, self._ends_s = 0.0, "", np.inf
        self.events: list[dict[str, Any]] = []
        self.touches: set[tuple[str, str]] = set()
        self._places: deque[Array] = deque(maxlen=1 + round(STANDS_S / self.task.control_dt_s))
        qpos, qvel = self.world.state()
        self.qpos: Array = qpos.copy()
        self._places.append(self.qpos[:2])
        self.percept: Percept = self._senses.measure(qpos, qvel)
        self.reading: FieldReading = read_fields(live.fields, self.percept, self.task)

    @property
    def standing(self) -> str:
        """Why the robot stands, see `hotice.view.halting`; empty: it walks."""
        return self._halting.why

    @property
    def ended(self) -> bool:
        """Whether time stands, for it is over."""
        return self.time_s >= self._ends_s

    def tell(self, kind: str, text: str) -> None:
        """An event: a note, touch or fault."""
        self.events = [*self.events, {"time": round(self.time_s, 2), "kind": kind, "text": text}][-MOST_EVENTS:]

    def step(self, coming: Iterable[Obstacle] = ()) -> None:
        """Lives for a control period, by the fields as they are now; not at all when it has ended.

        `coming`: obstacles that move meanwhile, where they are at its end.
        """
        if self.ended:
            return
        target = self._target()
        if target is None:
            self._end("unstable", "the policy's input or output is not finite")
            return
        self.world.step(target, self._senses.delay, coming)
        self.time_s += self.task.control_dt_s
        self._places.append(self.world.state()[0][:2].copy())
        way_m = float(np.linalg.norm(self._places[-1] - self._places[0]))
        for solid, obstacle in sorted(self.world.touched - self.touches):
            self.tell("touch", touch_text(solid, obstacle, walked_into(obstacle in self.world.moved, way_m)))
        self.touches |= self.world.touched
        failed = self.world.failure
        if failed and not self.over:
            self._end(failed, failed)
        if failed != "unstable":
            self.qpos = self.world.state()[0].copy()

    def _target(self) -> Array | None:
        """Joint targets (20,) [rad], None where the policy gives none."""
        pf = self._live.fields
        self.percept = self._senses.measure(*self.world.state())
        self.reading = read = read_fields(pf, self.percept, self.task)
        before, why = self.standing, self._halting.look(self._live, self.percept, read)
        if why != before and not self.over:
            self.tell("note", why or "walks on")
        if why:
            read = read_standing(read, self.percept, self._halting.place_W, self.task, pf.params.attraction)
        return self._policy.act(self.percept, read)

    def _end(self, outcome: str, text: str) -> None:
        self.over, self._ends_s = outcome, -np.inf if outcome == "unstable" else self.time_s + AFTER_S
        self.tell("fault", text)
