"""Sensor model: noise, delay and a root pose refreshed now and then between the true state and the robot.

The one-robot twin of `hotice.sim.sensing.Sensors`, with the state of its random numbers in the Context. The numbers and
rules, those of delays too, are in `hotice.task.sensing`.
"""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from hotice.model import g1
from hotice.model.frames import quat_from_axis_angle, quat_to_mat, rotation_z
from hotice.model.objects import CarriedObject
from hotice.policy.percept import Percept, PerceptModel
from hotice.systems.signals import NQ, PERCEPT, ROBOT_STATE
from hotice.task.sensing import TRACK_HEADING, TRACK_PLACE, TRACK_TILT, TRACK_VELOCITY, SensingConfig, reads_late

Array = NDArray[np.float64]
DRAWS = 56
"""Uniform numbers a measurement takes: heading 1, place 3, gyro 3, gravity 3, joint angles 20, object 3 + 3, joint
velocities 20."""
ESTIMATE = 20
"""Numbers of an estimate: the root's x, y, z [m], sine and cosine of its heading, its tracked velocity [m/s], the
direction of gravity in P, then of the object in P its position [m] and first two axes."""
_ESTIMATE, _AGE, _LATE, _SEED, _LAST = slice(0, 20), 20, 21, 22, slice(23, 23 + PERCEPT)
_PLACE, _VELOCITY, _DOWN, _OBJECT = slice(0, 3), slice(5, 8), slice(8, 11), slice(11, 20)


def measure(
    true: Percept,
    estimate: Array,
    draws: Array,
    config: SensingConfig,
    world_aligned: bool,
    joint_offset: Array | float = 0.0,
    *,
    keypoints: Callable[[Array], Array] | None = None,
    refresh: bool = True,
    gain: float = 1.0,
    tilt_gain: float = 1.0,
    hold_s: float = 0.0,
    dt_s: float = 0.0,
) -> tuple[Percept, Array]:
    """A measurement of a true percept, and the estimate of root and object behind it.

    Args:
        true: the percept without noise.
        estimate: (20,) the last one, see `ESTIMATE`.
        draws: (56,) uniform numbers in [-1, 1).
        config: half widths of the noise.
        world_aligned: keypoints of the object keep world directions (spheres).
        joint_offset: (20,) error of the encoders [rad].
        keypoints: gives those of the robot (11, 3), its root where it truly is, for measured joints (20,); None: the
            true ones.
        refresh: whether the root's place is measured anew.
        gain: weight of the newest pose of the object; 1 forgets all others.
        tilt_gain: the same of the direction of gravity.
        hold_s, dt_s: time between refreshes and since the last measurement [s], which tracking needs; 0 at the first.
    """
    u_yaw, u_root, u_gyro, u_gravity, u_q, u_pos, u_rot, u_qd = np.split(draws, [1, 4, 7, 10, 30, 33, 36])
    gravity_P, w_WP_P = true.gravity_P + config.gravity * u_gravity, true.w_WP_P + config.gyro_rad_s * u_gyro
    seen = np.concatenate([true.p_WP + config.root_pos_m * u_root, true.yaw + config.root_yaw_rad * u_yaw])
    down_P = gravity_P
    if config.gravity or config.gyro_rad_s:
        predicted = estimate[_DOWN] + dt_s * np.cross(estimate[_DOWN], w_WP_P)
        down_P = _blend(predicted, gravity_P, tilt_gain)
        down_P = down_P / np.linalg.norm(down_P)
    if config.root_tracking and dt_s:
        root = track_root(estimate[: _DOWN.start], seen if refresh else None, -float(down_P @ w_WP_P), hold_s, dt_s)
    elif refresh:
        root = np.concatenate([seen[:3], np.sin(seen[3:]), np.cos(seen[3:]), np.zeros(3)])
    else:
        root = estimate[: _DOWN.start]
    p_WP = root[_PLACE].copy()
    yaw = np.arctan2(root[3:4], root[4:5])
    R_WP = attitude(true.yaw[0], true.gravity_P)
    R_EW = attitude(yaw[0], down_P) @ R_WP.T  # into the estimated world frame
    q = true.q + joint_offset + config.joint_pos_rad * u_q
    p_WK = true.p_WK if keypoints is None else keypoints(q)
    p_PO = true.p_WO - true.p_WP + config.object_pos_m * u_pos
    tilt = config.object_rot_rad * u_rot
    R_tilt = quat_to_mat(quat_from_axis_angle(tilt, np.linalg.norm(tilt)))
    newest = np.vstack([p_PO, (R_tilt @ true.R_WO)[:, :2].T]) @ R_WP
    seen_object = newest if gain >= 1.0 else _blend(estimate[_OBJECT].reshape(3, 3), newest, gain)
    if gain < 1.0:
        p_PO, x, y = seen_object @ R_WP.T
        x = x / np.linalg.norm(x)
        z = np.cross(x, y)
        z = z / np.linalg.norm(z)
        R_tilt = np.column_stack([x, np.cross(z, x), z]) @ true.R_WO.T
    p_WO = p_WP + R_EW @ p_PO
    arms = true.p_WOK - true.p_WO
    percept = Percept.of(
        p_WP=p_WP,
        yaw=yaw,
        gravity_P=gravity_P,
        w_WP_P=w_WP_P,
        q=q,
        qd=true.qd + config.joint_vel_rad_s * u_qd,
        p_WK=p_WP + (p_WK - true.p_WP) @ R_EW.T,
        p_WO=p_WO,
        R_WO=R_EW @ R_tilt @ true.R_WO,
        p_WOK=p_WO + (arms if world_aligned else arms @ (R_EW @ R_tilt).T),
    )
    return percept, np.concatenate([root, down_P, seen_object.ravel()])


def track_root(root: Array, seen: Array | None, turning: float, hold_s: float, dt_s: float) -> Array:
    """The root one measurement later: moved on with its velocity, turned by the gyro, corrected by what is `seen`.

    Args:
        root: (8,) x, y, z [m], sine and cosine of the heading, velocity [m/s].
        seen: (4,) x, y, z [m], heading [rad]; None between refreshes.
        turning: rate of the heading [rad/s]. hold_s: time between refreshes [s]. dt_s: time that passed [s].
    """
    velocity = root[_VELOCITY]
    place, yaw = root[_PLACE] + dt_s * velocity, float(np.arctan2(root[3], root[4])) + dt_s * turning
    if seen is not None:
        off, yaw_off = seen[:3] - place, float(seen[3]) - yaw
        place, velocity = place + TRACK_PLACE * off, velocity + TRACK_VELOCITY / hold_s * off
        yaw += TRACK_HEADING * float(np.arctan2(np.sin(yaw_off), np.cos(yaw_off)))
    return np.concatenate([place, [np.sin(yaw), np.cos(yaw)], velocity])


def _blend(old: Array, new: Array, gain: float) -> Array:
    return old + gain * (new - old)


def attitude(yaw: float, down_P: Array) -> Array:
    """R_WP (3, 3) from the heading [rad] and the direction of gravity in P, a unit vector."""
    along, across, up = -down_P
    level = np.hypot(across, up)
    R_YP = np.array(
        [
            [level, -along * across / level, -along * up / level],
            [0.0, up / level, -across / level],
            [along, across, up],
        ]
    )
    return rotation_z(yaw) @ R_YP


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
