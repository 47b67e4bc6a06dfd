"""The carrying policy with its memory: the last action, the step clock and the history.

The twin of `hotice.systems.policy.PolicySystem` without a diagram: the same calls make observation and action.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.policy.action import next_action
from hotice.policy.guidance import FieldReading
from hotice.policy.observation import Carrying, layout_of, observe, remember
from hotice.policy.percept import Percept
from hotice.policy.policy_file import check_layout
from hotice.task import history
from hotice.task.policy_task import PolicyTask

Array = NDArray[np.float64]


class Network(Protocol):
    """What runs a policy's networks: `PolicySession`, or a checkpoint. `meta`: what the file says of itself."""

    name: str
    meta: dict[str, Any]

    @property
    def layout(self) -> list[tuple[str, int]]:
        """Names and widths of the observation's rows."""
        ...

    def run(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Actions (N, 20) of raw observations (N, O)."""
        ...


class CarryPolicy:
    """Acts once a control period. Raises `CheckpointError`: the policy reads another observation."""

    def __init__(self, policy: Network, carry: CarryState) -> None:
        self.task = PolicyTask.from_meta(policy.meta, policy.name)
        check_layout(policy.name, policy.layout, layout_of(self.task))
        self._policy, self._carrying = policy, Carrying.of(carry)
        self.rest = np.asarray(carry.joint_target, dtype=float)
        """Targets (20,) [rad] of the zero action, which hold the object."""
        self._phase_step = 2.0 * math.pi * self.task.gait_hz * self.task.control_dt_s
        self.reset()

    def reset(self) -> None:
        """Forgets all: the next action is the first."""
        self._action, self._phase = np.zeros(g1.ACTIONS), 0.0
        self.observation: NDArray[np.float32] | None = None
        """What was read for the newest action; None before the first."""
        self._past: Array = np.zeros(self.task.history * history.FRAME)

    @property
    def action(self) -> Array:
        """The newest action (20,), zero before the first."""
        return self._action

    def act(self, percept: Percept, reading: FieldReading) -> Array | None:
        """Joint targets (20,) [rad]; None, with the memory as it was, where input or output is not finite."""
        observation = observe(percept, reading, self._carrying, self._action, self._phase, self.task.scan, self._past)
        if not np.isfinite(observation).all():
            return None
        raw = self._policy.run(observation[None])[0].astype(float)
        if not np.isfinite(raw).all():
            return None
        self.observation, self._past = observation, remember(self._past, observation)
        self._action = next_action(raw, self.task.action_limit)
        self._phase = (self._phase + self._phase_step) % (2.0 * math.pi)
        return self.rest + self.task.action_scale * self._action
