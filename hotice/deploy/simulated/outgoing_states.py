"""States of a simulated robot on their way out: late by a delay, with the faults of a link."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.link.faults import FaultInjector, Faults
from hotice.deploy.link.protocol import RobotEnd
from hotice.deploy.link.way import Way
from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import LOW_STATE


class OutgoingStates:
    """Sends each state `late_steps` steps after it was written; the first ones are said again and again until then."""

    def __init__(self, end: RobotEnd, late_steps: int, faults: Sequence[Faults], seed: int) -> None:
        self._end = end
        self._late: deque[np.ndarray] = deque(maxlen=1 + late_steps)
        self._clock = SimulatedClock()
        injector = FaultInjector(LOW_STATE, faults, np.random.SeedSequence([seed, 3]))
        self._way = Way(injector, self._clock) if faults else None
        self._first = True

    def send(self, state: np.ndarray, time_s: float) -> None:
        """Takes the state (), written at `time_s` [s], and sends what is due. Raises `LinkError`."""
        self._late.append(state)
        if self._way is None or self._first:
            # the first one goes out whole: by it the robot's end of the link knows which machine it is
            self._first = False
            self._end.publish_state(self._late[0])
            return
        self._clock.sleep(time_s - self._clock.now())
        self._way.send(seal(LOW_STATE, self._late[0]))
        for _, data in self._way.take():
            self._end.send_state(data)
