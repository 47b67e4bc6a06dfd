"""Frame of a phase machine over the whole-body QP: the step, ways through knots, what hands feel, steps of the feet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.control.controller import Measurement
from hotice.control.pickup.footwork import ease
from hotice.control.pickup.memory import Motion, PickupMemory
from hotice.control.whole_body.terms import Terms

Array = NDArray[np.float64]
Step = Callable[[Any, PickupMemory, Measurement, Motion, float], None]


class Machine:
    """A phase machine; `true`: terms of the measured state, `ref`: terms of the last reference.

    `STEPS` names the phases, and what each does in a step. What is done after it is `watch`.
    """

    STEPS: ClassVar[Mapping[str, Step]] = {}

    def __init__(self, rate_hz: float, true: Terms, ref: Terms) -> None:
        self._rate_hz, self._true, self._ref = rate_hz, true, ref

    def advance(self, memory: PickupMemory, m: Measurement) -> Motion:
        """One step: moves `memory` on, its reference included."""
        before, motion = memory.reference, Motion()
        if m.stand and not memory.air.any():
            # the phase goes on later, from where it is
            memory.since_s += 1.0 / self._rate_hz
            return motion
        self.STEPS[memory.phase](self, memory, m, motion, m.time_s - memory.since_s)
        self.watch(memory, m)
        motion.rate = self._ref._pin.difference(self._ref.model, before, memory.reference) * self._rate_hz
        return motion

    def watch(self, memory: PickupMemory, m: Measurement) -> None:
        """Looks at the end of a step for what may go wrong in any phase."""

    def rest(self, memory: PickupMemory, m: Measurement, motion: Motion, elapsed: float) -> None:
        """Goes on with the last reference."""

    def along(self, knots: ArrayLike, share: float) -> Array:
        """See `along`."""
        return along(self._ref._pin, self._ref.model, np.asarray(knots), share)

    def enter(self, memory: PickupMemory, m: Measurement, phase: str, note: str = "") -> None:
        """Begins a phase."""
        memory.phase, memory.since_s, memory.came_from, memory.lost_since_s = phase, m.time_s, memory.reference, None
        memory.air[:] = False
        memory.log.append((m.time_s, phase, note))

    def feels(self, m: Measurement, least_n: float) -> bool:
        """Whether both hands feel at least so much [N]; where nothing is felt at all they do."""
        if m.hand_force_W is None:
            return True
        return bool((np.linalg.norm(m.hand_force_W, axis=1) >= least_n).all())

    def lost(self, memory: PickupMemory, m: Measurement, least_n: float, lost_s: float) -> bool:
        """Whether a hand has felt less than `least_n` for longer than `lost_s`."""
        if self.feels(m, least_n):
            memory.lost_since_s = None
        elif memory.lost_since_s is None:
            memory.lost_since_s = m.time_s
        return memory.lost_since_s is not None and m.time_s - memory.lost_since_s > lost_s


def along(pin: Any, model: Any, knots: Array, share: float) -> Array:
    """Configuration at `share` of the way through `knots` (K, 27), equally spaced in time, eased at both ends."""
    place = ease(share) * (len(knots) - 1)
    i = min(int(place), len(knots) - 2)
    return pin.interpolate(model, knots[i], knots[i + 1], place - i)
