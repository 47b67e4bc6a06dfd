"""Carry states: a robot that already holds an object and goes on holding it.

Inverse kinematics puts both palms on the object and the feet under the common centre of mass; static torques of
gravity, ground reaction and grasp give servo targets q* = q + τ/kp, so that the zero action holds the load (the servo
of a joint that carries torque τ must be commanded past its angle). Training and evaluation start from carry states.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice import checks
from hotice.checks import Range
from hotice.errors import CarryInfeasible
from hotice.model import builder, g1, self_contact
from hotice.model.frames import GRAVITY, quat_from_axis_angle
from hotice.model.least_squares import minimize
from hotice.model.objects import Box, CarriedObject, Cylinder

ARM_TORQUE_SHARE = 0.85  # of the limit; the rest is for moving
MAX_GAP_M = 0.0015
PRELOAD_M = 0.0003
TORSO_GAP_M = 0.015
TORSO_FRONT_M = 0.079
PALM_FRICTION = 0.6
"""The slipperiest palms that a grasp must hold with (protocol `robot`)."""
GRIP_MARGIN = 1.3
"""Multiple of the object's weight that the palms' friction must be able to carry."""
ELBOW_WEIGHT = 30.0
ELBOWS_OUT_M = (0.0, 0.15)
"""From the middle to each elbow at least, tried in turn: anywhere; a centimetre more than half the chest and the
forearm take."""
MAX_INSIDE_M = 0.0005
_ACTION = np.array([g1.ALL_JOINTS.index(j) for j in g1.ACTION_JOINTS])


@dataclass(frozen=True, kw_only=True)
class Posture:
    """Where the pelvis is: height above the sole plane [m] and forward lean [rad]."""

    pelvis_height_m: float = 0.74
    lean_rad: float = 0.0

    def __post_init__(self) -> None:
        checks.number("pelvis_height_m", self.pelvis_height_m, Range(least=0.4, most=0.785, note="squat to upright"))
        checks.number("lean_rad", self.lean_rad, Range(least=-0.2, most=0.6, note="back to forward"))


@dataclass(frozen=True, kw_only=True)
class CarryState:
    """A robot holding an object, at rest. Joint order is `g1.ACTION_JOINTS`; the heading is +x, soles on z = 0.

    Attributes:
        joint_pos: (20,) angles [rad].
        wrist_pos: (6,) angles at which the wrists stay locked [rad], order `g1.WRIST_JOINTS`.
        joint_target: (20,) servo targets that hold the state [rad].
        torque: (20,) static servo torques [N m].
        root_pos_W: (3,) pelvis position [m]; quat_WP: (4,) its orientation, wxyz.
        object_pos_W: (3,) centre of the object [m]; quat_WO: (4,) its orientation, wxyz.
        squeeze_n: normal force of each hand [N].
    """

    carried: CarriedObject
    posture: Posture
    joint_pos: NDArray
    wrist_pos: NDArray
    joint_target: NDArray
    torque: NDArray
    root_pos_W: NDArray
    quat_WP: NDArray
    object_pos_W: NDArray
    quat_WO: NDArray
    squeeze_n: float

    def qpos(self) -> NDArray:
        """(34,) configuration of the 20-joint model with object."""
        return np.concatenate([self.root_pos_W, self.quat_WP, self.joint_pos, self.object_pos_W, self.quat_WO])


@lru_cache(maxsize=1)
def _robot() -> mujoco.MjModel:
    return builder.build_model(None, joints=29, floor=False)


class _Kinematics:
    """The robot as a function of 20 joint angles and 6 locked wrist angles, at a given pelvis orientation."""

    def __init__(self, posture: Posture) -> None:
        self.model = _robot()
        self.data = mujoco.MjData(self.model)
        self.quat_WP = quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(posture.lean_rad))
        self.q = np.zeros(g1.ACTIONS)
        self.wrist = np.zeros(6)
        self.qpos_of = {j: self.model.joint(j).qposadr[0] for j in g1.ALL_JOINTS}
        self.action_qpos = [self.qpos_of[j] for j in g1.ACTION_JOINTS]
        self.wrist_qpos = [self.qpos_of[j] for j in g1.WRIST_JOINTS]
        self.action_dof = [self.model.joint(j).dofadr[0] for j in g1.ACTION_JOINTS]
        self.joint_dof = [self.model.joint(j).dofadr[0] for j in g1.ALL_JOINTS]
        self.palm_id = {s: [self.model.geom(f"{s}_palm_{i}").id for i in range(4)] for s in g1.SIDES}
        self.elbow_body = self.model.body("left_elbow_link").id
        self.hand_body = {s: self.model.body(f"{s}_wrist_yaw_link").id for s in g1.SIDES}
        self.foot_body = {s: self.model.body(f"{s}_ankle_roll_link").id for s in g1.SIDES}
        self.sole_id = {s: [self.model.geom(f"{s}_sole_{i}").id for i in range(4)] for s in g1.SIDES}
        self.joint_id = {j: self.model.joint(j).id for j in g1.ALL_JOINTS}
        self.left_arm = [self.joint_id[j] for j in (*g1.ARM_JOINTS[:4], *g1.WRIST_JOINTS[:3])]
        self.palm_radius = float(self.model.geom_size[self.palm_id["left"][0], 0])
        self.range = self.model.jnt_range[[self.model.joint(j).id for j in g1.ACTION_JOINTS]]
        self.wrist_range = self.model.jnt_range[[self.model.joint(j).id for j in g1.WRIST_JOINTS]]
        limit = {
            self.model.joint(a.trnid[0]).name: a.forcerange[1] for a in map(self.model.actuator, range(self.model.nu))
        }
        self.torque_limit = np.array([limit[j] for j in g1.ACTION_JOINTS])

    def update(self) -> None:
        """Places the pelvis at the origin, orientation of the posture, joints at `self.q`."""
        self.data.qpos[g1.ROOT_POS] = 0.0
        self.data.qpos[g1.ROOT_QUAT] = self.quat_WP
        self.data.qpos[self.action_qpos] = self.q
        self.data.qpos[self.wrist_qpos] = self.wrist
        mujoco.mj_kinematics(self.model, self.data)

    def palms(self, side: str) -> NDArray:
        """Centres of the palm spheres, (4, 3) relative to the pelvis, in world directions."""
        return self.data.geom_xpos[self.palm_id[side]].copy()

    def point_jacobian(self, points: NDArray, joints: list[int]) -> NDArray:
        """Jacobian (N, 3, J) of points (N, 3) carried by all of the joint ids, by their angles: axis × arm."""
        arm = points[:, None] - self.data.xanchor[joints]
        return np.moveaxis(np.cross(self.data.xaxis[joints], arm), 1, 2)


def surface_distance(carried: CarriedObject, p_O: NDArray) -> tuple[NDArray, NDArray]:
    """Signed distance to the object's surface and its gradient, (N, 3) in O -> (N,), (N, 3)."""
    if isinstance(carried, Box):
        out = np.abs(p_O) - carried.half_extents_m  # beyond each pair of faces
        normal = np.sign(p_O)[:, :, None] * np.eye(3)
    elif isinstance(carried, Cylinder):
        radial = np.hypot(p_O[:, 0], p_O[:, 1])
        out = np.stack([radial - carried.radius_m, np.abs(p_O[:, 2]) - 0.5 * carried.length_m], axis=1)
        normal = np.zeros((len(p_O), 2, 3))
        normal[:, 0, :2] = p_O[:, :2] / np.maximum(radial, 1e-12)[:, None]
        normal[:, 1, 2] = np.sign(p_O[:, 2])
    else:
        radial = np.linalg.norm(p_O, axis=1, keepdims=True)
        out, normal = radial - carried.radius_m, (p_O / np.maximum(radial, 1e-12))[:, None]
    # Outside, the distance is that to the nearest face, edge or corner; inside, that to the nearest face.
    outside = np.maximum(out, 0.0)
    length = np.sqrt((outside**2).sum(axis=1))
    weight = np.where(
        length[:, None] > 0, outside / np.maximum(length, 1e-300)[:, None], out == out.max(axis=1)[:, None]
    )
    return length + np.minimum(out.max(axis=1), 0.0), (weight[:, :, None] * normal).sum(axis=1)


LEFT_ARM = slice(g1.UPPER.start, g1.UPPER.start + 4)
RIGHT_ARM = slice(g1.UPPER.start + 4, g1.UPPER.stop)
ARM_GUESS = np.array([0.1, 0.1, 0.05, -0.3, -0.1, 0.0, -0.05])  # hands ahead, wrists straight [rad]
ARM_GUESS_PER_M = np.array([0.0, 2.4, 2.0, 3.0, 0.0, 0.0, 0.0])  # elbows out, per metre of half width beyond 0.15 m
RIGHT_SIGN = g1.mirror_joints()[1][RIGHT_ARM]
WRIST_SIGN = np.array([-1.0, 1.0, -1.0])  # roll, pitch, yaw


def _set_arms(kin: _Kinematics, angles: NDArray) -> None:
    """Sets the left arm and wrist, (7,), and their mirror image on the right."""
    kin.q[LEFT_ARM], kin.q[RIGHT_ARM] = angles[:4], RIGHT_SIGN * angles[:4]
    kin.wrist[:3], kin.wrist[3:] = angles[4:], WRIST_SIGN * angles[4:]


def _solve_arms(
    kin: _Kinematics, carried: CarriedObject, guess: NDArray | None, grasp_height_m: float, elbow_out_m: float
) -> tuple[NDArray, NDArray, float]:
    """Arm and wrist angles and object position (relative to the pelvis, world directions); upright, centred in y.

    `elbow_out_m`: from the middle to each elbow at least [m].

    Returns the solution (9,), left arm and wrist angles, then x and z of the object, a `guess` for the next call; the
    object position (3,); and the largest residual gap [m] between palm spheres and object.
    """
    half = carried.half_extents_m
    lower = np.concatenate([kin.range[LEFT_ARM, 0], kin.wrist_range[:3, 0]])
    upper = np.concatenate([kin.range[LEFT_ARM, 1], kin.wrist_range[:3, 1]])
    lean = 2.0 * float(np.arcsin(kin.quat_WP[2]))
    x_front = TORSO_FRONT_M + TORSO_GAP_M + half[0] + 0.28 * np.sin(max(lean, 0.0))
    knees = np.array([kin.data.xpos[kin.model.body(f"{s}_knee_link").id] for s in g1.SIDES])  # from the legs' solution
    thighs_below = knees[:, 0].max() + 0.06 > x_front - half[0]
    z_low = max(0.02, knees[:, 2].max() + 0.06 + half[2] + 0.01) if thighs_below else 0.02
    wish = np.array([0.0, 0.1, 0.0, 0.3, 0.0, 0.0, 0.0, x_front, max(0.10, z_low)])  # close to the chest, elbow height
    weight = np.array([0.02] * 4 + [0.06] * 3 + [1.0, 1.0])  # wrists as straight as they can be

    def residual(v: NDArray, touch: float) -> tuple[NDArray, NDArray]:
        _set_arms(kin, v[:7])
        kin.update()
        palms = kin.palms("left")
        p_O = palms - np.array([v[7], 0.0, v[8]])
        distance, normal = surface_distance(carried, p_O)
        by_v = np.zeros((4, 3, 9))
        by_v[:, :, :7] = kin.point_jacobian(palms, kin.left_arm)
        # Seen from the object, the palms move back as it moves ahead or up.
        by_v[:, 0, 7] = by_v[:, 2, 8] = -1.0
        gap = touch * (distance - kin.palm_radius + PRELOAD_M)  # every palm sphere touches
        elbow = kin.data.xpos[kin.elbow_body]
        inside = max(0.0, elbow_out_m - elbow[1])  # beside the chest, not in it
        elbow_by_v = np.zeros((1, 9))
        if inside > 0:
            elbow_by_v[0, :3] = -ELBOW_WEIGHT * kin.point_jacobian(elbow[None], kin.left_arm[:3])[0, 1]
        middle = np.array([30.0, 10.0])  # in the middle of the side
        centre, centre_by_v = p_O.mean(axis=0)[[0, 2]], by_v.mean(axis=0)[[0, 2]]
        rows = [
            touch * np.einsum("ni,niv->nv", normal, by_v),
            middle[:, None] * centre_by_v,
            np.diag(weight),
            elbow_by_v,
        ]
        above = np.array([0.0, grasp_height_m])
        rest = [middle * (centre - above), weight * (v - wish), [ELBOW_WEIGHT * inside]]
        return np.concatenate([gap, *rest]), np.concatenate(rows)

    low, high = np.append(lower + 0.02, [x_front, z_low]), np.append(upper - 0.02, [x_front + 0.30, z_low + 0.5])
    if guess is None:  # stiff contact from afar follows a curved valley in small steps and may end in a bent-back wrist
        angles = ARM_GUESS + ARM_GUESS_PER_M * (half[1] - 0.15)
        guess = minimize(lambda v: residual(v, 12.0), np.append(angles, [x_front + 0.03, wish[8]]), low, high)
    found = minimize(lambda v: residual(v, 400.0), guess, low, high)
    residual(found, 400.0)
    object_pos = np.array([found[7], 0.0, found[8]])
    p_O = kin.palms("left") - object_pos
    distance, normal = surface_distance(carried, p_O)
    gap = np.abs(distance - kin.palm_radius)
    facing = normal.mean(axis=0)
    if facing[1] < 0.8 * np.linalg.norm(facing):  # at front, back, top or bottom: no grasp
        gap = np.maximum(gap, np.abs(half[1] + kin.palm_radius - p_O[:, 1]))
    return found, object_pos, float(gap.max())


def _solve_legs(kin: _Kinematics, posture: Posture, carried: CarriedObject | None, object_pos: NDArray) -> None:
    """Hip pitch, knee and ankle pitch that put level soles at the demanded depth under the centre of mass."""
    joints = {s: [f"{s}_{k}_joint" for k in ("hip_pitch", "knee", "ankle_pitch")] for s in g1.SIDES}
    index = {s: [g1.ACTION_JOINTS.index(j) for j in joints[s]] for s in g1.SIDES}
    left = [kin.joint_id[j] for j in joints["left"]]
    dofs = {s: [kin.action_dof[i] for i in index[s]] for s in g1.SIDES}
    mass = float(kin.model.body_mass.sum())
    load = 0.0 if carried is None else carried.mass_kg
    com_by_q = np.zeros((3, kin.model.nv))

    def residual(v: NDArray) -> tuple[NDArray, NDArray]:
        kin.q[index["left"]] = kin.q[index["right"]] = v
        kin.update()
        mujoco.mj_comPos(kin.model, kin.data)
        mujoco.mj_jacSubtreeCom(kin.model, kin.data, com_by_q, 1)
        com_x = (mass * kin.data.subtree_com[0, 0] + load * object_pos[0]) / (mass + load)
        com_x_by_v = mass / (mass + load) * (com_by_q[0, dofs["left"]] + com_by_q[0, dofs["right"]])
        soles = kin.data.geom_xpos[kin.sole_id["left"]]  # two at the heel, two at the toe
        ends, ends_by_v = (a.reshape(2, 2, *a.shape[1:]).mean(axis=1) for a in (soles, kin.point_jacobian(soles, left)))
        middle, middle_by_v = ends.mean(axis=0), ends_by_v.mean(axis=0)
        # Soles are spheres of 5 mm: their lowest points are that much below the centres.
        r = [middle[2] - 0.005 + posture.pelvis_height_m, ends[1, 2] - ends[0, 2], middle[0] - com_x]
        return np.array(r), np.stack([middle_by_v[2], ends_by_v[1, 2] - ends_by_v[0, 2], middle_by_v[0] - com_x_by_v])

    # Start from two equal links, 0.69 m long in all: half of the knee's bend in the hip, half in the ankle.
    bend = float(np.arccos(np.clip((posture.pelvis_height_m - 0.1) / 0.69, -1, 1)))
    found = minimize(residual, [-bend - posture.lean_rad, 2 * bend, -bend], *kin.range[index["left"]].T)
    worst = float(np.abs(residual(found)[0]).max())
    if worst > 1e-3:
        raise CarryInfeasible(
            f"no stance with the pelvis at {posture.pelvis_height_m:.2f} m and lean {posture.lean_rad:.2f} rad keeps "
            f"the centre of mass over level feet (missed by {1e3 * worst:.0f} mm): use another height or less lean"
        )


def _contact_jacobian(kin: _Kinematics, body: int, point: NDArray) -> NDArray:
    jacobian = np.zeros((3, kin.model.nv))
    mujoco.mj_jac(kin.model, kin.data, jacobian, None, point, body)
    return jacobian


def _static_torque(kin: _Kinematics, carried: CarriedObject, object_pos: NDArray, squeeze_n: float) -> NDArray:
    """τ = g(q) − Σ Jᵀ f over both soles and both palms, (29,) [N m] in the order of `g1.ALL_JOINTS`."""
    kin.update()
    mujoco.mj_comPos(kin.model, kin.data)
    kin.data.qvel[:] = 0
    mujoco.mj_forward(kin.model, kin.data)
    # At rest the bias forces are gravity's.
    torque = kin.data.qfrc_bias.copy()
    weight = carried.mass_kg * GRAVITY
    for side, inward in (("left", -1.0), ("right", 1.0)):
        palms = kin.palms(side)
        touching = palms.mean(axis=0)
        # The object pushes back at the hand, and half of its weight hangs on it.
        force_on_hand = np.array([0.0, -inward * squeeze_n, -0.5 * weight])
        point = touching + [0.0, inward * kin.palm_radius, 0.0]
        torque -= _contact_jacobian(kin, kin.hand_body[side], point).T @ force_on_hand
        total = float(kin.model.body_mass.sum()) * GRAVITY + weight
        sole = kin.data.geom_xpos[kin.sole_id[side]].mean(axis=0) - [0.0, 0.0, 0.005]
        torque -= _contact_jacobian(kin, kin.foot_body[side], sole).T @ np.array([0.0, 0.0, 0.5 * total])
    return torque[kin.joint_dof]


def holding_torques(state: CarryState) -> NDArray:
    """Static torques of all 29 joints in a carry state, (29,) [N m], waist and wrists too; order `g1.ALL_JOINTS`."""
    kin = _Kinematics(state.posture)
    kin.q[:], kin.wrist[:] = state.joint_pos, state.wrist_pos
    object_pos_P = np.asarray(state.object_pos_W - state.root_pos_W, dtype=float)
    return _static_torque(kin, state.carried, object_pos_P, state.squeeze_n)


def solve_carry(
    carried: CarriedObject,
    posture: Posture | None = None,
    *,
    squeeze_n: float | None = None,
    grasp_height_m: float = 0.0,
) -> CarryState:
    """A carry state of the object in the posture.

    Args:
        carried: box, cylinder (upright) or sphere.
        posture: of the pelvis; default upright with slightly bent knees.
        squeeze_n: normal force of each hand [N]; default 32 N plus 4 N per kg, or what palms of friction 0.6 need.
        grasp_height_m: of the palms above the object's centre.

    Raises:
        CarryInfeasible: the object is too wide, too deep or too heavy for the arms, or the posture has no stance; says
            why.
    """
    posture = posture or Posture()
    weight = carried.mass_kg * GRAVITY
    least = GRIP_MARGIN * weight / (2 * PALM_FRICTION)
    squeeze = max(32.0 + 4.0 * carried.mass_kg, least) if squeeze_n is None else float(squeeze_n)
    if squeeze < least:
        raise CarryInfeasible(
            f"object of {carried.mass_kg:.2f} kg is too heavy for a squeeze of {squeeze:.0f} N: palm friction "
            f"{PALM_FRICTION:g} holds at most {2 * PALM_FRICTION * squeeze / GRIP_MARGIN / GRAVITY:.2f} kg: "
            f"squeeze with at least {least:.0f} N"
        )
    kin = _Kinematics(posture)
    object_pos = _solve_grasp(kin, posture, carried, grasp_height_m)
    torque = _static_torque(kin, carried, object_pos, squeeze)[_ACTION]
    share = np.abs(torque[g1.UPPER]) / kin.torque_limit[g1.UPPER]
    if share.max() > ARM_TORQUE_SHARE:
        joint = g1.ARM_JOINTS[int(share.argmax())]
        raise CarryInfeasible(
            f"object of {carried.mass_kg:.2f} kg is too heavy for the arms: {joint} would need "
            f"{np.abs(torque[g1.UPPER]).max():.1f} N m, allowed is {ARM_TORQUE_SHARE:.0%} of its limit"
        )
    return _at_rest(kin, carried, posture, object_pos, squeeze, torque)


def _solve_grasp(kin: _Kinematics, posture: Posture, carried: CarriedObject, grasp_height_m: float) -> NDArray:
    """Joints of legs and arms, and the object's position, (3,); where arms would be inside the chest, elbows go out."""
    object_pos, gap, inside = np.array([0.35, 0.0, 0.1]), np.inf, 0.0
    for elbow_out_m in ELBOWS_OUT_M:
        arms = None
        for _ in range(2):  # legs and arms see each other through the centre of mass and the thighs
            _solve_legs(kin, posture, carried, object_pos)
            arms, object_pos, gap = _solve_arms(kin, carried, arms, grasp_height_m, elbow_out_m)
        _solve_legs(kin, posture, carried, object_pos)
        inside = self_contact.depth(kin.model, kin.data)
        if gap > MAX_GAP_M or inside <= MAX_INSIDE_M:
            break
    if gap > MAX_GAP_M:
        width = 200.0 * carried.half_extents_m[1]
        raise CarryInfeasible(
            f"{carried.shape} {width:.0f} cm wide cannot be held between the palms: the nearest reachable grasp misses "
            f"its sides by {1e3 * gap:.0f} mm (allowed {1e3 * MAX_GAP_M:.0f} mm)"
        )
    if inside > MAX_INSIDE_M:
        raise CarryInfeasible(
            f"{carried.shape} of extents {np.round(200.0 * carried.half_extents_m)} cm: arms that hold it would be "
            f"{1e3 * inside:.0f} mm inside the body: use another posture or object"
        )
    return object_pos


def carry_state_at(
    carried: CarriedObject,
    joint_pos: NDArray,
    wrist_pos: NDArray,
    object_pos_P: NDArray,
    *,
    lean_rad: float = 0.0,
    squeeze_n: float,
) -> CarryState:
    """The carry state of a robot that holds an object in a given way, found otherwise than by `solve_carry`.

    Args:
        carried: what it holds, upright. joint_pos: (20,) angles [rad]; wrist_pos: (6,) those of the locked wrists.
        object_pos_P: (3,) the object's centre from the pelvis, in W's directions [m]. lean_rad: of the pelvis.
        squeeze_n: normal force of each hand [N].
    """
    kin = _Kinematics(Posture(lean_rad=lean_rad))
    kin.q[:], kin.wrist[:] = joint_pos, wrist_pos
    torque = _static_torque(kin, carried, np.asarray(object_pos_P, dtype=float), squeeze_n)[_ACTION]
    soles = kin.data.geom_xpos[[i for ids in kin.sole_id.values() for i in ids], 2]
    posture = Posture(pelvis_height_m=float(0.005 - soles.min()), lean_rad=lean_rad)
    return _at_rest(kin, carried, posture, np.asarray(object_pos_P, dtype=float), squeeze_n, torque)


def _at_rest(
    kin: _Kinematics, carried: CarriedObject, posture: Posture, object_pos: NDArray, squeeze_n: float, torque: NDArray
) -> CarryState:
    """State that the kinematics, already updated, show; the middle of the soles is put at the origin."""
    kp, _ = g1.gains()
    soles = kin.data.geom_xpos[[i for ids in kin.sole_id.values() for i in ids]]
    root = np.array([-soles[:, 0].mean(), 0.0, 0.005 - soles[:, 2].min()])
    return CarryState(
        carried=carried,
        posture=posture,
        joint_pos=kin.q.copy(),
        wrist_pos=kin.wrist.copy(),
        joint_target=kin.q + torque / kp,
        torque=torque,
        root_pos_W=root,
        quat_WP=np.asarray(kin.quat_WP),
        object_pos_W=object_pos + root,
        quat_WO=np.array([1.0, 0.0, 0.0, 0.0]),
        squeeze_n=squeeze_n,
    )
