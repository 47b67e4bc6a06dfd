"""Step of a controller made of a phase machine, its tracking and the whole-body QP."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hotice.control.controller import Command, Measurement
from hotice.control.pickup.machine import Machine
from hotice.control.pickup.memory import PickupMemory
from hotice.control.pickup.tracking import Tracking
from hotice.control.whole_body.qp import WholeBodyQp

Array = NDArray[np.float64]


class Phased:
    """Base of the controllers that pick up and put down; see `hotice.control.controller.Controller`."""

    _qp: WholeBodyQp
    _phases: Machine
    _tracking: Tracking

    def placed(self, memory: PickupMemory, measurement: Measurement) -> PickupMemory:
        """The memory of a robot that stands where it is measured, its stance included."""
        raise NotImplementedError

    def step(self, memory: PickupMemory, measurement: Measurement) -> tuple[Command, PickupMemory]:
        """One control step."""
        memory = memory.copy()
        track, finite = self._tracking, measurement.finite()
        if finite:
            if memory.stance is None:
                memory = self.placed(memory, measurement)
            measurement = _seen(memory, measurement)
            self._qp.terms.update(measurement)
            track.follow(memory, self._phases.advance(memory, measurement))
        torque = self._qp.solve(measurement, track.targets, track.contacts, memory.qp, updated=finite).copy()
        return Command(torque=torque, phase=memory.phase, faults=memory.qp.faults), memory


def configuration(m: Measurement) -> Array:
    """Measured configuration (27,) in Pinocchio's order."""
    return np.concatenate([m.p_WP, np.roll(m.quat_WP, -1), m.joint_pos])


def _seen(memory: PickupMemory, m: Measurement) -> Measurement:
    return m if memory.stance is None else memory.stance.measurement(m)
