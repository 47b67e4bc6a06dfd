"""Sensor model: noise, delay and a root pose refreshed now and then between the true state and the robot.

The one-robot twin of `hotice.sim.sensing.Sensors`, with the state of its random numbers in the Context. The numbers and
rules, those of delays too, are in `hotice.task.sensing`.
"""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from hotice.model import g1
from hotice.model.objects import CarriedObject
from hotice.policy.measuring import DRAWS, ESTIMATE, measure
from hotice.policy.percept import Percept, PerceptModel
from hotice.systems.signals import NQ, PERCEPT, ROBOT_STATE
from hotice.task.sensing import TRACK_TILT, SensingConfig, reads_late

Array = NDArray[np.float64]
_ESTIMATE, _AGE, _LATE, _SEED, _LAST = slice(0, 20), 20, 21, 22, slice(23, 23 + PERCEPT)


class SensorModel(LeafSystem):
    """Input `robot_state` (84,), true. Output `percept` (119,): the measurement of this control step.

    The state holds the estimate of root and object, the number of measurements, the seed and, for late sensors, the
    last percept: measurement k takes its random numbers from a generator that counts (Philox, key seed, counter k), so
    a cloned Context draws the same. Read it at multiples of the control period; in between it shows the next one early.

    Args:
        carried: the object.
        config: noise and delay.
        control_dt_s: period of the measurements.
        seed: of the noise.
        late: whether measurements come one control step late (see `hotice.task.sensing`).
        joint_offset: (20,) error of the encoders [rad].
    """

    def __init__(
        self,
        carried: CarriedObject,
        config: SensingConfig,
        control_dt_s: float,
        seed: int = 0,
        late: bool = False,
        joint_offset: Array | None = None,
    ) -> None:
        super().__init__()
        self.config, self._dt_s = config, control_dt_s
        self._offset = np.zeros(g1.ACTIONS) if joint_offset is None else joint_offset
        self._exact = config.exact and not self._offset.any()
        self._true = PerceptModel(carried)
        self._world_aligned = carried.keypoints_world_aligned
        self._hold = config.hold_steps(control_dt_s)
        self._gain = config.object_gain(control_dt_s)
        self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        if self._exact:
            self.DeclareVectorOutputPort("percept", PERCEPT, self._output, {self._state.ticket()})
            return
        start = np.zeros(ESTIMATE + 3 + PERCEPT)
        start[_LATE] = late
        start[_SEED] = seed
        self.DeclareDiscreteState(start)
        self.DeclareVectorOutputPort("percept", PERCEPT, self._output)
        self.DeclarePeriodicDiscreteUpdateEvent(control_dt_s, 0.0, self._update)

    def reseed(self, context: Context, seed: int) -> None:
        """Draws other noise from now on; exact sensors draw none."""
        if not self._exact:
            context.get_mutable_discrete_state_vector()[_SEED] = seed

    def _output(self, context: Context, output: BasicVector) -> None:
        if self._exact:
            output.SetFromVector(self._truth(context).vector)
            return
        held = context.get_discrete_state_vector().value()
        late = reads_late(bool(held[_LATE]), held[_AGE] + 1)
        output.SetFromVector(held[_LAST] if late else self._measure(context)[0].vector)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        percept, estimate = self._measure(context)
        held = context.get_discrete_state_vector().value()
        new = np.concatenate([estimate, held[_AGE : _SEED + 1], percept.vector])
        new[_AGE] += 1
        discrete_state.set_value(new)

    def _truth(self, context: Context) -> Percept:
        state = self._state.Eval(context)
        return self._true(state[:NQ], state[NQ:])

    def _measure(self, context: Context) -> tuple[Percept, Array]:
        held = context.get_discrete_state_vector().value()
        count = int(held[_AGE])
        rng = np.random.Generator(np.random.Philox(key=int(held[_SEED]), counter=[0, 0, 0, count + 1]))
        return measure(
            self._truth(context),
            held[_ESTIMATE],
            rng.uniform(-1.0, 1.0, DRAWS),
            self.config,
            self._world_aligned,
            self._offset,
            keypoints=self._true.keypoints_at(self._state.Eval(context)[:NQ]),
            refresh=count % self._hold == 0,
            gain=max(self._gain, 1.0 / (count + 1)),
            tilt_gain=max(TRACK_TILT, 1.0 / (count + 1)),
            hold_s=self._hold * self._dt_s,
            dt_s=self._dt_s if count else 0.0,
        )
