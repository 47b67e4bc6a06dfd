"""Pushes: sudden changes of the pelvis' velocity at random times, as in the training and evaluation of policies."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, LeafSystem, State

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidStation
from hotice.task.pushes import push_velocity

Array = NDArray[np.float64]
PUSH = 3
"""Change of the pelvis' velocity along x and y of W [m/s], and when it happens [s]."""
NEVER = -1.0
NOW_S = 1e-9


def draw_push(size_m_s: float, chance: float, seed: int, count: int) -> Array:
    """Change of velocity (2,) [m/s] in W at control step `count`, any direction.

    With probability `chance`; of a tenth of `size_m_s` to all of it.

    As `hotice.sim.events.push` in training, from random numbers that `seed` and `count` alone determine.
    """
    draws = np.random.Generator(np.random.Philox(key=seed, counter=[1, 0, 0, count + 1])).random(3)
    return push_velocity(*draws, size_m_s, chance)


class Pushes(LeafSystem):
    """Output `push` (3,): the newest push, see `PUSH`. Drawn at each control step, before the plant's.

    The state holds it, and the number of draws and the seed: a cloned Context pushes the same.

    Args:
        size_m_s: largest change of velocity; interval_s: mean time between pushes; control_dt_s: between draws.
        seed: of the pushes.
    """

    def __init__(self, size_m_s: float, interval_s: float, control_dt_s: float, seed: int = 0) -> None:
        super().__init__()
        allowed = Range(least=control_dt_s, unit="s", note="the control period")
        checks.number("interval_s", interval_s, allowed, InvalidStation)
        self._size, self._chance = size_m_s, control_dt_s / interval_s
        pushed = self.DeclareDiscreteState([0.0, 0.0, NEVER])
        self.DeclareDiscreteState([0.0, float(seed)])
        self.DeclareStateOutputPort("push", pushed)
        self.DeclarePeriodicUnrestrictedUpdateEvent(control_dt_s, 0.0, self._draw)

    def reseed(self, context: Context, seed: int) -> None:
        """Draws other pushes from now on."""
        context.get_mutable_discrete_state(1).SetAtIndex(1, seed)

    def _draw(self, context: Context, state: State) -> None:
        count, seed = (int(v) for v in context.get_discrete_state(1).value())
        push = draw_push(self._size, self._chance, seed, count)
        if push.any():
            state.get_mutable_discrete_state(0).SetFromVector([*push, context.get_time()])
        state.get_mutable_discrete_state(1).SetFromVector([count + 1.0, seed])
