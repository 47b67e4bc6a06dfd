"""The walking controller: plan in, joint torques out.

At each landing the plan of the remaining footsteps becomes a DCM reference that starts from the feet as they stand.
While a foot swings, step adjustment chooses zero-moment point, foothold and time of landing for the measured DCM; while
both feet stand, the zero-moment point follows the reference with DCM feedback. A whole-body QP realises the resulting
acceleration of the centre of mass, the swing foot, the pelvis and the grasp.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hotice.control.controller import Command, Measurement
from hotice.control.walk.adjust import AdjustConfig, StepAdjuster
from hotice.control.walk.config import WalkConfig
from hotice.control.walk.dcm import DcmReference, natural_frequency
from hotice.control.walk.footsteps import SIDE, Footstep
from hotice.control.walk.leg import toe_down
from hotice.control.walk.memory import DOUBLE, SHIFT, STAND, SWING, WalkMemory
from hotice.control.walk.plan import WalkPlan
from hotice.control.walk.swing import Swing
from hotice.control.whole_body.contacts import Contacts
from hotice.control.whole_body.qp import QpConfig, Targets, WholeBodyQp
from hotice.control.whole_body.terms import LEFT_FOOT, PELVIS
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.frames import quat_to_mat, rotation_y, rotation_z

Array = NDArray[np.float64]
SOLE_HEIGHT_M = 0.035


class WalkController:
    """Carries an object along a plan. See `hotice.control.controller.Controller`.

    Args:
        plan: footsteps and profile of the scene, see `plan_walk`.
        state: the carry state that the robot starts from; its grasp is kept.
        config: gait. adjust: step adjustment. qp: whole-body QP. rate_hz: of `step`.
    """

    def __init__(
        self,
        plan: WalkPlan,
        state: CarryState,
        config: WalkConfig | None = None,
        *,
        adjust: AdjustConfig | None = None,
        qp: QpConfig | None = None,
        rate_hz: float = 200.0,
    ) -> None:
        self.plan, self.state, self.config, self.rate_hz = plan, state, config or WalkConfig(), rate_hz
        self.qp = WholeBodyQp(state.wrist_pos, qp or QpConfig(limit_horizon_s=0.05, hand_weight=0.5, force_weight=2e-5))
        self.adjuster = StepAdjuster(adjust or AdjustConfig())
        self.load_kg = state.carried.mass_kg
        self.mass_kg = self.qp.terms.mass_kg + self.load_kg
        self._targets, self._contacts = self._tasks()

    def _tasks(self) -> tuple[Targets, Contacts]:
        t = Targets()
        w = self.config.weights
        t.com_weight[:2] = w.com
        t.gain_frame("pelvis", [0.0, 0.0, w.pelvis_height, w.tilt, w.tilt, w.yaw], 12.0)
        for foot in ("left_foot", "right_foot"):
            t.gain_frame(foot, [w.foot] * 3 + [w.foot_turn] * 3, 30.0)
        t.joint_pos[:] = self.state.joint_pos
        t.gain_joints(np.repeat([w.legs, w.arms], [len(g1.LEG_JOINTS), len(g1.ARM_JOINTS)]), 20.0)
        c = Contacts(load_kg=self.load_kg)
        c.hand_force_max_n[:] = 150.0
        return t, c

    def start(self, measurement: Measurement) -> WalkMemory:
        """Memory before the first step: the feet stand where they are measured."""
        terms = self.qp.terms
        terms.update(measurement)
        feet = self._feet()
        com, _ = self._com(measurement)
        omega = natural_frequency(com[2])
        height, lean = float(measurement.p_WP[2]), _lean(measurement.quat_WP)
        memory = WalkMemory(
            phase=SHIFT,
            since_s=measurement.time_s,
            last_s=measurement.time_s,
            step=0,
            feet=feet,
            zmp=com[:2].copy(),
            omega=omega,
            reference=DcmReference.through(np.zeros(1), com[None, :2], omega),
            height_m=height,
            lean_rad=lean,
            qp=self.qp.start(measurement),
            footsteps=tuple(self.plan.footsteps),
        )
        self._refer(memory, measurement.time_s, self.config.shift_s)
        return memory

    def step(self, memory: WalkMemory, measurement: Measurement) -> tuple[Command, WalkMemory]:
        """One control step."""
        m = memory.copy()
        if not measurement.finite():
            torque = self.qp.solve(measurement, self._targets, self._contacts, m.qp)
            return Command(torque=torque.copy(), phase=m.phase, faults=m.qp.faults), m
        t = measurement.time_s
        terms = self.qp.terms
        terms.update(measurement)
        com, v_com = self._com(measurement)
        m.omega = natural_frequency(com[2])
        dcm = com[:2] + v_com[:2] / m.omega
        if measurement.stand and not m.stops and m.phase in (SHIFT, DOUBLE):
            self._stop(m, t)
        self._advance(m, measurement, t)
        self._choose_zmp(m, dcm, t)
        self._write_targets(m, com, t)
        torque = self.qp.solve(measurement, self._targets, self._contacts, m.qp, updated=True)
        m.last_s = t
        m.com, m.dcm = com, dcm
        return Command(torque=torque.copy(), phase=m.phase, faults=m.qp.faults), m

    def _com(self, measurement: Measurement) -> tuple[Array, Array]:
        """Common centre of mass of robot and object, and its velocity, (3,) each; heights over the soles."""
        terms, load = self.qp.terms, self.load_kg
        if measurement.p_WO is None or measurement.v_WO is None:
            return terms.com.copy(), terms.v_com.copy()
        share = load / self.mass_kg
        return (
            (1.0 - share) * terms.com + share * measurement.p_WO,
            (1.0 - share) * terms.v_com + share * measurement.v_WO,
        )

    def _feet(self) -> Array:
        terms = self.qp.terms
        R = terms.R_WF[LEFT_FOOT : LEFT_FOOT + 2]
        yaw = np.arctan2(R[:, 1, 0], R[:, 0, 0])
        return np.column_stack([terms.p_WF[LEFT_FOOT : LEFT_FOOT + 2, :2], yaw])

    def _middle(self, foot: Array) -> Array:
        """Where the zero-moment point belongs in a sole, from the ankle's x, y, yaw."""
        return foot[:2] + self.config.zmp_ahead_m * np.array([np.cos(foot[2]), np.sin(foot[2])])

    def _stop(self, m: WalkMemory, t: float) -> None:
        """The plan ends here, or, of a robot that walks, after two more steps: half of one, and the other foot beside.

        One step alone ends in a fall at full speed.
        """
        ahead, m.stops = m.footsteps[m.step :], True
        if m.phase == SHIFT:
            m.footsteps = m.footsteps[: m.step]
        elif len(ahead) > 2:
            beside = self._beside(m.feet[1 - ahead[0].foot], ahead[0])
            half = replace(ahead[0], **{name: 0.5 * (getattr(beside, name) + getattr(ahead[0], name)) for name in "xy"})
            m.footsteps = (*m.footsteps[: m.step], half, self._beside(np.array([half.x, half.y, half.yaw]), ahead[1]))
        self._refer(m, t, max(self.config.double_support_s - (t - m.since_s), 0.0))

    def _beside(self, foot: Array, step: Footstep) -> Footstep:
        """The step moved to beside the other foot, which stands at x, y, yaw."""
        x, y, yaw = foot
        aside = 2.0 * SIDE[step.foot] * self.config.half_width_m
        return replace(step, x=x - aside * np.sin(yaw), y=y + aside * np.cos(yaw), yaw=yaw)

    def _refer(self, m: WalkMemory, t: float, shift_s: float) -> None:
        """DCM reference from now to the end of the plan; the load leaves the present zero-moment point in `shift_s`."""
        cfg, steps = self.config, m.footsteps[m.step :]
        feet = [m.feet[0], m.feet[1]]
        time, zmp = [t], [m.zmp]
        now = t
        for i, step in enumerate(steps):
            now += shift_s if i == 0 else cfg.double_support_s
            stance = self._middle(feet[1 - step.foot])
            time.append(now)
            zmp.append(stance)
            now += step.span_s
            time.append(now)
            zmp.append(stance)
            feet[step.foot] = np.array([step.x, step.y, step.yaw])
        time.append(now + cfg.settle_s)
        zmp.append(0.5 * (self._middle(feet[0]) + self._middle(feet[1])))
        m.reference = DcmReference.through(np.array(time), np.array(zmp), m.omega)

    def _advance(self, m: WalkMemory, measurement: Measurement, t: float) -> None:
        """Phase changes."""
        cfg, since = self.config, t - m.since_s
        if m.phase in (SHIFT, DOUBLE):
            if m.step >= len(m.footsteps):
                m.phase, m.since_s = STAND, t
            elif since >= (cfg.shift_s if m.phase == SHIFT else cfg.double_support_s) - 1e-9:
                step = m.footsteps[m.step]
                m.phase, m.since_s = SWING, t
                foot = m.feet[step.foot]
                start = self.qp.terms.p_WF[LEFT_FOOT + step.foot]
                m.swing = Swing(start, foot[2], step.swing, step.span_s)
                m.landing, m.lands_s = step.xy, t + step.span_s
        elif m.phase == SWING:
            step = m.footsteps[m.step]
            force = measurement.foot_force_W
            touches = force is not None and force[step.foot, 2] > cfg.touch_n and since > 0.7 * (m.lands_s - m.since_s)
            if touches or t >= m.lands_s - 1e-9:
                m.feet[step.foot] = self._feet()[step.foot]
                m.phase, m.since_s, m.step, m.swing = DOUBLE, t, m.step + 1, None
                self._refer(m, t, cfg.double_support_s)

    def _choose_zmp(self, m: WalkMemory, dcm: Array, t: float) -> None:
        cfg = self.config
        if m.phase == SWING:
            step = m.footsteps[m.step]
            stance = m.feet[1 - step.foot]
            left = m.lands_s - t
            planned = step.span_s - (t - m.since_s)
            landing_dcm = m.reference.at(m.since_s + step.span_s)[0]
            offset = landing_dcm - self._middle(np.array([step.x, step.y, step.yaw]))
            freeze = left < cfg.freeze_s
            target = m.landing if freeze else step.xy
            ahead = self._middle(np.array([*target, step.yaw])) - target
            found = self.adjuster.solve(
                dcm,
                self._middle(stance),
                float(stance[2]),
                target + ahead,
                offset,
                max(left if freeze else planned, 1e-3),
                m.omega,
                SIDE[step.foot],
                shift_s=(-min(step.hurry_s(cfg), max(planned - cfg.freeze_s, 0.0)), cfg.wait_s),
                slack_m=step.slack_m,
                freeze=freeze,
            )
            if not freeze:
                m.landing, m.lands_s = found.foothold - ahead, t + max(found.remaining_s, cfg.freeze_s)
            m.zmp = found.zmp
            m.unadjusted += not found.solved
            return
        reference, _, zmp = m.reference.at(t)
        m.zmp = self._inside(m, zmp + (1.0 + cfg.dcm_gain) * (dcm - reference))

    def _inside(self, m: WalkMemory, zmp: Array) -> Array:
        """Nearest point of the strip between both soles."""
        a, b = self._middle(m.feet[0]), self._middle(m.feet[1])
        along = b - a
        length = float(np.linalg.norm(along))
        along = along / max(length, 1e-6)
        across = np.array([-along[1], along[0]])
        s = np.clip((zmp - a) @ along, -0.015, length + 0.015)
        return a + s * along + np.clip((zmp - a) @ across, -0.045, 0.045) * across

    def _write_targets(self, m: WalkMemory, com: Array, t: float) -> None:
        cfg, g, k, terms = self.config, self._targets, self._contacts, self.qp.terms
        g.com_acc[:2] = m.omega**2 * (com[:2] - m.zmp)
        middle = 0.5 * (m.feet[0, :2] + m.feet[1, :2])
        station = self.plan.path.station_of(com[:2] if m.phase != STAND else middle)
        height, lean = self.plan.profile.at(station)
        dt = min(max(t - m.last_s, 0.0), 0.05)
        before, lean_before = m.height_m, m.lean_rad
        m.height_m += np.clip(height - m.height_m, -cfg.height_speed_m_s * dt, cfg.height_speed_m_s * dt)
        m.lean_rad += np.clip(lean - m.lean_rad, -cfg.lean_speed_rad_s * dt, cfg.lean_speed_rad_s * dt)
        arms_before, arms = self.plan.arms.at(lean_before), self.plan.arms.at(m.lean_rad)
        g.joint_pos[g1.UPPER] = arms
        g.joint_vel[g1.UPPER] = (arms - arms_before) / dt if dt > 0 else 0.0
        g.frame_pos[PELVIS, 2] = m.height_m
        g.frame_vel[PELVIS, 2] = (m.height_m - before) / dt if dt > 0 else 0.0
        yaw = self.plan.path.at(station)[1]
        g.frame_rot[PELVIS] = rotation_z(float(yaw)) @ rotation_y(m.lean_rad)
        k.foot_force_max_n[:] = 400.0
        for hand in range(2):
            R = terms.R_WF[3 + hand]
            inward = R[:, 1] * (-1.0 if hand == 0 else 1.0)
            k.hand_normal_W[hand] = -inward
            k.hand_force_ref_W[hand] = -inward * self.state.squeeze_n
        if m.phase == SWING and m.swing is not None:
            step = m.footsteps[m.step]
            foot = LEFT_FOOT + step.foot
            landing = np.array([*m.landing, SOLE_HEIGHT_M])
            pose, speed, accel = m.swing.step(t - m.since_s, landing, step.yaw, m.lands_s - t)
            pitch, rise = toe_down(terms.p_WF[PELVIS], terms.R_WF[PELVIS], SIDE[step.foot], pose)
            pitch_rate, rise_rate = m.swing.tilt(pitch, rise, dt)
            c, s = np.cos(pose[3]), np.sin(pose[3])
            g.frame_pos[foot] = [pose[0], pose[1], pose[2] + rise]
            g.frame_rot[foot] = rotation_z(pose[3]) @ rotation_y(pitch)
            g.frame_vel[foot] = [*speed[:2], speed[2] + rise_rate, -s * pitch_rate, c * pitch_rate, speed[3]]
            g.frame_acc[foot] = [*accel[:3], 0.0, 0.0, accel[3]]
            k.foot_force_max_n[step.foot] = 0.0


def _lean(quat_WP: Array) -> float:
    R = quat_to_mat(quat_WP)
    return float(np.arcsin(np.clip(-R[2, 0], -1.0, 1.0)))
