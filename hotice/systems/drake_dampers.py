"""Motors of a MultibodyPlant that only damp: the Drake plant's answer to a fall."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.tree import JointActuator, PdControllerGains
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem

from hotice.safety.limits import DAMPING_KD
from hotice.systems.signals import NUM_JOINTS

Array = NDArray[np.float64]


class DrakeDampers(LeafSystem):
    """Makes actuators dampers, which Drake integrates implicitly, and again what they were.

    Inputs `actuation` (20,), `damped` (20,), optional: joints where it is above 0 damp. Output `actuation` (20,):
    the same, no torque where a joint damps.

    Gains are the actuators' own and in no Context: they are set before each step of the plant, as `damped` has it in
    the Context that steps. Add this system to a diagram before the plant, so that its event comes first.

    Args:
        time_step_s: of the plant.
    """

    def __init__(self, time_step_s: float) -> None:
        super().__init__()
        self._actuators: list[JointActuator] = []
        self._trained: list[PdControllerGains] = []
        self._damps = b""
        self._actuation = self.DeclareVectorInputPort("actuation", NUM_JOINTS)
        self._damped = self.DeclareVectorInputPort("damped", NUM_JOINTS)
        self.DeclareVectorOutputPort(
            "actuation", NUM_JOINTS, self._output, {self._actuation.ticket(), self._damped.ticket()}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(time_step_s, 0.0, self._update)

    def drive(self, actuators: Sequence[JointActuator]) -> None:
        """Tells which actuators there are, of a finalized plant, in the order of the inputs."""
        none = PdControllerGains(p=0.0, d=0.0)
        self._actuators = list(actuators)
        self._trained = [a.get_controller_gains() if a.has_controller() else none for a in self._actuators]
        self._damps = np.zeros(NUM_JOINTS).tobytes()

    def set_gains(self, damped: Array) -> None:
        """Makes dampers where `damped` (20,) says so; the others are what they were."""
        if damped.tobytes() == self._damps:
            return
        damper = PdControllerGains(p=0.0, d=DAMPING_KD)
        for actuator, trained, damps in zip(self._actuators, self._trained, damped > 0, strict=True):
            actuator.set_controller_gains(damper if damps else trained)
        self._damps = damped.tobytes()

    @staticmethod
    def wanted(port: InputPort, context: Context) -> Array:
        """Which joints (20,) shall damp: what an input port `damped` says, none where nothing is connected."""
        return np.asarray(port.Eval(context)) if port.HasValue(context) else np.zeros(NUM_JOINTS)

    def _update(self, context: Context, _: DiscreteValues) -> None:
        self.set_gains(self.wanted(self._damped, context))

    def _output(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.where(self.wanted(self._damped, context) > 0, 0.0, self._actuation.Eval(context)))
