"""The robot, its object and its scene in MuJoCo, as a Drake system."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from hotice.errors import InvalidStation, SimulationError
from hotice.model import builder
from hotice.model.moving.mocap import place_moving
from hotice.model.scene import Obstacle
from hotice.safety.limits import DAMPING_KD
from hotice.systems.joint_pd import JointServo, pd_torque
from hotice.systems.pushes import NOW_S, PUSH
from hotice.systems.signals import CONTACT_FORCE, TOUCHING_BODIES

Array = NDArray[np.float64]
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


class MujocoPlant(LeafSystem):
    """A compiled model whose whole state is one flat vector in the Context; `MjData` is scratch.

    The vector is MuJoCo's `mjSTATE_INTEGRATION` (time, qpos, qvel, warm start, controls, ...): stepping is bitwise that
    of `mj_step` in a loop, and a cloned Context replays identically.

    Input `actuation` (nu,): what the model's actuators take: torques [N m] of motors, targets [rad] of position servos
    or, with `servo`, of `pd_torque`, which then commands the motors anew at every time step of the model.
    `push` (3,), with `pushed`: see `hotice.systems.pushes`; felt by the step that begins at its time.
    `damped` (nu,), optional: actuators where it is above 0 only damp their joints, implicitly, whatever they are told.
    Outputs `state` (nq + nv,): qpos and qvel; `contact_force` (12,): see `signals`, under the last controls, `damped`;
    `full_state` (n,): the flat vector itself.

    Args:
        model: robot (20 joints), object and obstacles, of `builder.build_model`.
        qpos: (nq,) where the default Context starts, at rest; ctrl: (nu,) the controls before the first step.
        period_s: for which an actuation is held: a multiple of the model's time step (default: one).
        servo: of motors that take joint targets. pushed: whether there is an input `push`.
        moving: all obstacles of the model's scene that have a motion; they are moved by the diagram's time, before each
            time step to where they will be after it.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        qpos: ArrayLike,
        ctrl: ArrayLike,
        period_s: float | None = None,
        servo: JointServo | None = None,
        pushed: bool = False,
        moving: Sequence[Obstacle] = (),
    ) -> None:
        super().__init__()
        self.model, self._moving = model, tuple(moving)
        if len(self._moving) != model.nmocap:
            raise InvalidStation(f"{len(self._moving)} obstacles move, the model has {model.nmocap} that do")
        self._data, self._scratch = mujoco.MjData(model), mujoco.MjData(model)
        self._servo, self._ctrl = servo, self._data.ctrl
        self._joint_pos, self._joint_vel = self._data.qpos[7 : 7 + model.nu], self._data.qvel[6 : 6 + model.nu]
        self._met = ("", *(f"/{obstacle.name}" for obstacle in self._moving))
        self._holds = b""  # the state that `_data` was left in
        self.nq, self.nv, self.nu = model.nq, model.nv, model.nu
        self._touching = {model.body(name).id: i for i, name in enumerate(TOUCHING_BODIES)}
        self.size, self.first = (mujoco.mj_stateSize(model, part) for part in (STATE, mujoco.mjtState.mjSTATE_TIME))
        self._motion = slice(self.first, self.first + self.nq + self.nv)  # qpos and qvel follow the time
        index = self.DeclareDiscreteState(self.state_vector(qpos, ctrl=ctrl))
        only_state = {self.discrete_state_ticket(index)}
        self._actuation = self.DeclareVectorInputPort("actuation", self.nu)
        self._push = self.DeclareVectorInputPort("push", PUSH) if pushed else None
        self._damped = self.DeclareVectorInputPort("damped", self.nu)
        self._trained = [part.copy() for part in self._motors()]
        self._undamped = np.zeros(self.nu)
        self._damps = self._undamped.tobytes()
        self.DeclareVectorOutputPort("state", self.nq + self.nv, self._output_state, only_state)
        reads = only_state | {self._damped.ticket()}
        self.DeclareVectorOutputPort("contact_force", CONTACT_FORCE, self._output_contact_force, reads)
        self.DeclareStateOutputPort("full_state", index)
        self._steps = 1 if period_s is None else round(period_s / model.opt.timestep)
        if self._steps < 1:
            raise InvalidStation(f"period_s is {period_s!r}: at least the time step {model.opt.timestep:g} s is needed")
        self._period_s = self._steps * model.opt.timestep
        self.DeclarePeriodicDiscreteUpdateEvent(self._period_s, 0.0, self._step)
        self.DeclareInitializationDiscreteUpdateEvent(self._set_clock)

    def state_vector(
        self, qpos: ArrayLike, qvel: ArrayLike | None = None, ctrl: ArrayLike | None = None, time_s: float = 0.0
    ) -> Array:
        """The flat state of a configuration. Raises `InvalidStation` for arrays of the wrong size."""
        data = mujoco.MjData(self.model)
        for name, value, target in (("qpos", qpos, data.qpos), ("qvel", qvel, data.qvel), ("ctrl", ctrl, data.ctrl)):
            if value is not None:
                array = np.asarray(value, dtype=float)
                if array.shape != target.shape:
                    raise InvalidStation(f"{name} has shape {array.shape}: this model needs {target.shape}")
                target[:] = array
        data.time = time_s
        state = np.empty(self.size)
        mujoco.mj_getState(self.model, data, state, STATE)
        return state

    def set_state(self, context: Context, qpos: ArrayLike, qvel: ArrayLike | None = None) -> None:
        """Puts the plant's own Context into a configuration, without warm start."""
        context.SetDiscreteState(self.state_vector(qpos, qvel, time_s=context.get_time()))

    def hits(self, context: Context) -> tuple[bool, bool]:
        """Whether robot and object touch an obstacle in the present state."""
        if mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SENSOR, builder.HIT_SENSORS[0]) < 0:
            return False, False
        self._forward(context)
        robot, carried = (
            any(self._scratch.sensor(f"{name}{of}").data[0] > 0 for of in self._met) for name in builder.HIT_SENSORS
        )
        return robot, carried

    def _step(self, context: Context, discrete_state: DiscreteValues) -> None:
        model, data = self.model, self._data
        command = self._actuation.Eval(context)
        state = context.get_discrete_state_vector().value()
        if state.tobytes() != self._holds:  # another Context than the last step's, or one that was set
            mujoco.mj_setState(model, data, state, STATE)
        self._set_motors(context)
        if self._push is not None:
            push = self._push.Eval(context)  # change of the velocity, and when
            if abs(context.get_time() - push[-1]) < NOW_S:
                data.qvel[:2] += push[:-1]
        if self._servo is None:
            self._ctrl[:] = command
        if self._servo is None and not self._moving:
            mujoco.mj_step(model, data, self._steps)
        else:
            self._step_one_by_one(context.get_time(), command)
        new = discrete_state.get_mutable_value()
        mujoco.mj_getState(model, data, new, STATE)
        self._holds = new.tobytes()
        if not math.isfinite(new.dot(new)):
            raise SimulationError(f"physics diverged at {context.get_time():.3f} s: the state is not finite")

    def _set_clock(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Sets the plant's own time where a simulation begins at another than the state's."""
        state, now_s = context.get_discrete_state_vector().value(), context.get_time()
        # between its steps the state is that of the next one
        if not abs(state[self.first - 1] - now_s) <= self._period_s:
            discrete_state.get_mutable_value()[self.first - 1] = now_s

    def _motors(self) -> tuple[Array, Array, Array]:
        return self.model.actuator_gainprm, self.model.actuator_biastype, self.model.actuator_biasprm

    def _set_motors(self, context: Context) -> None:
        """Makes actuators what they are in this Context; the model, which all share, may be as in another."""
        damped = self._damped.Eval(context) if self._damped.HasValue(context) else self._undamped
        if damped.tobytes() != self._damps:
            self._damp(damped)

    def _damp(self, damped: Array) -> None:
        """Makes actuators dampers where `damped` (nu,) says so, and the others what they were."""
        for part, trained in zip(self._motors(), self._trained, strict=True):
            part[:] = trained
        gain, kind, bias = self._motors()
        joints = damped > 0
        gain[joints], bias[joints] = 0.0, 0.0
        kind[joints], bias[joints, 2] = mujoco.mjtBias.mjBIAS_AFFINE, -DAMPING_KD
        self._damps = damped.tobytes()

    def _step_one_by_one(self, now_s: float, target: Array) -> None:
        """Steps between which the servo commands anew, and obstacles move on."""
        servo = self._servo
        if servo is not None and servo.offset.any():
            target = target - servo.offset
        for k in range(self._steps):
            if servo is not None:
                self._ctrl[:] = pd_torque(target, self._joint_pos, self._joint_vel, servo.kp, servo.kd, servo.limit)
            place_moving(self._data, self._moving, now_s + (k + 1) * self.model.opt.timestep)
            mujoco.mj_step(self.model, self._data)

    def _output_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state_vector().value()[self._motion])

    def _output_contact_force(self, context: Context, output: BasicVector) -> None:
        self._forward(context)
        model, data = self.model, self._scratch
        force, wrench = np.zeros((len(TOUCHING_BODIES), 3)), np.empty(6)
        for i in range(data.ncon):
            contact = data.contact[i]
            bodies = model.geom_bodyid[contact.geom]
            mujoco.mj_contactForce(model, data, i, wrench)
            # its x axis points from the first geom to the second
            on_second_W = contact.frame.reshape(3, 3).T @ wrench[:3]
            for body, sign in zip(bodies, (-1.0, 1.0), strict=True):
                if int(body) in self._touching:
                    force[self._touching[int(body)]] += sign * on_second_W
        output.SetFromVector(force.ravel())

    def _forward(self, context: Context) -> None:
        self._set_motors(context)
        mujoco.mj_setState(self.model, self._scratch, context.get_discrete_state_vector().value(), STATE)
        mujoco.mj_forward(self.model, self._scratch)
