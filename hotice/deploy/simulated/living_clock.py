"""Clock by which a simulated robot lives: whoever sleeps on it lets the robot step."""

from __future__ import annotations

from collections.abc import Callable

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.simulated.world import STEP_S


class LivingClock(SimulatedClock):
    """A simulated clock that calls what lives by it after every 2 ms, in lock step with the sleeper.

    A controller that reads, commands and sleeps 2 ms in a loop gets one state for each command, the same every time.
    """

    def __init__(self) -> None:
        super().__init__()
        self._steps: list[Callable[[], None]] = []
        self._count = 0

    def every_step(self, step: Callable[[], None]) -> None:
        """Calls `step` whenever a multiple of 2 ms is reached, after those that were given before."""
        self._steps.append(step)

    def sleep(self, seconds: float) -> None:
        end_s = self.now() + seconds
        while (self._count + 1) * STEP_S <= end_s + 1e-9:
            self._count += 1
            super().sleep(max(0.0, self._count * STEP_S - self.now()))
            for step in self._steps:
                step()
        super().sleep(max(0.0, end_s - self.now()) if seconds >= 0.0 else seconds)
