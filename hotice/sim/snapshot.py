"""Everything the task knows of one instant, read from the simulator once.

`Snapshot` alone reads simulator data; rewards, observations and terminations are functions of it. Tensors are float32
with leading axis N (environments). Frames: W world, P pelvis, Y pelvis position with heading only (yaw frame), O
object.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import torch
from torch import Tensor

from hotice.fields.bank import FieldSample
from hotice.model import builder, g1
from hotice.sim.encoder_error import chains
from hotice.sim.physics.protocol import Physics
from hotice.task import history

POINTS = g1.SGF_KEYPOINTS + g1.OGF_KEYPOINTS + g1.FOOT_ENDS
NUM_SGF = len(g1.SGF_KEYPOINTS)
HANDS = slice(NUM_SGF, NUM_SGF + 2)
FOOT_ENDS = slice(NUM_SGF + 2, NUM_SGF + 6)
TOES, HEELS = slice(NUM_SGF + 2, NUM_SGF + 4), slice(NUM_SGF + 4, NUM_SGF + 6)
STEERED = tuple(g1.SGF_KEYPOINTS.index(k) for k in g1.STEERED_KEYPOINTS)
HEAD, PELVIS = g1.SGF_KEYPOINTS.index("head"), g1.SGF_KEYPOINTS.index("pelvis")
LOOK_AHEAD_S = 0.35
"""A quarter of a metre at the commanded speed: time to crouch or to turn aside."""
FEET = tuple(g1.SGF_KEYPOINTS.index(k) for k in ("left_foot", "right_foot"))


@dataclass
class Memory:
    """State of the task that outlasts a step; the environment updates it in one place.

    action, last_action (N, 20); phase (N,) [rad] of the left leg's step clock; step (N,) control steps so far;
    scene (N,) and model (N,) ids; past (N, H) what the actors read in the steps before, frames of
    `hotice.task.history`, the newest first; true_past (N, H) the same without noise and delay, which critics and
    teachers read.
    """

    action: Tensor
    last_action: Tensor
    phase: Tensor
    step: Tensor
    scene: Tensor
    model: Tensor
    past: Tensor
    true_past: Tensor

    @classmethod
    def zeros(cls, num_envs: int, device: torch.device, history_steps: int = 0) -> Memory:
        """All zero."""
        n_action = len(g1.ACTION_JOINTS)
        longs = (torch.zeros(num_envs, dtype=torch.int64, device=device) for _ in range(3))
        step, scene, model = longs
        return cls(
            action=torch.zeros(num_envs, n_action, device=device),
            last_action=torch.zeros(num_envs, n_action, device=device),
            phase=torch.zeros(num_envs, device=device),
            step=step,
            scene=scene,
            model=model,
            past=torch.zeros(num_envs, history_steps * history.FRAME, device=device),
            true_past=torch.zeros(num_envs, history_steps * history.FRAME, device=device),
        )


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Object and grasp of each environment, rows of the carry bank: see `hotice.sim.carry_bank.CarryBank`."""

    joint_pos: Tensor  # (N, 20)
    half_extents: Tensor  # (N, 3)
    mass: Tensor  # (N, 1), as drawn: what the hands feel, not what the carry state was solved for
    keypoints_O: Tensor  # (N, 8, 3)
    world_aligned: Tensor  # (N,) bool: keypoints keep world directions
    p_OH: Tensor  # (N, 2, 3) hands in the object frame at the start
    height_P: Tensor  # (N,) height of the object over the pelvis at the start


class Layout:
    """Where bodies, joints and points of the compiled model are; made once from names."""

    def __init__(self, model: mujoco.MjModel, device: torch.device) -> None:
        def ids(names, of) -> Tensor:
            return torch.tensor([of(n).id for n in names], device=device)

        joints = [model.joint(j) for j in g1.ACTION_JOINTS]
        self.q = torch.tensor([j.qposadr[0] for j in joints], device=device)
        self.qd = torch.tensor([j.dofadr[0] for j in joints], device=device)
        free = model.joint("object_free")
        self.object_q, self.object_v = int(free.qposadr[0]), int(free.dofadr[0])
        self.pelvis = model.body(g1.ROOT_BODY).id
        self.object = model.body(builder.OBJECT_BODY).id
        sites = [model.site(n) for n in POINTS]
        self.point_body = torch.tensor([int(model.site_bodyid[s.id]) for s in sites], device=device)
        self.point_offset = torch.tensor([model.site_pos[s.id].tolist() for s in sites], device=device)
        self.joint_body = torch.tensor([int(model.jnt_bodyid[j.id]) for j in joints], device=device)
        self.joint_axis = torch.tensor(model.jnt_axis[[j.id for j in joints]], dtype=torch.float32, device=device)
        self.joint_offset = torch.tensor(model.jnt_pos[[j.id for j in joints]], dtype=torch.float32, device=device)
        self.chains = chains(model, list(g1.ACTION_JOINTS), self.point_body.tolist())
        self.limits = torch.tensor(model.jnt_range[[j.id for j in joints]], dtype=torch.float32, device=device)
        self.torque_limit = torch.tensor(model.actuator_forcerange[:, 1], dtype=torch.float32, device=device)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The simulator's part of a snapshot: poses and velocities, before fields and commands."""

    p_WP: Tensor
    R_WP: Tensor
    yaw: Tensor
    v_WP: Tensor
    w_WP_P: Tensor
    gravity_P: Tensor
    q: Tensor
    qd: Tensor
    joint_axis_W: Tensor
    joint_anchor_W: Tensor
    torque: Tensor
    p_WK: Tensor
    v_WK: Tensor
    p_WO: Tensor
    R_WO: Tensor
    v_WO: Tensor
    w_WO: Tensor
    p_WOK: Tensor
    v_WOK: Tensor

    def to_yaw_frame(self, v_W: Tensor) -> Tensor:
        """Turns vectors (N, ..., 3) from W into Y."""
        shape = (-1,) + (1,) * (v_W.ndim - 2)
        cos, sin = torch.cos(self.yaw).view(shape), torch.sin(self.yaw).view(shape)
        x, y, z = v_W.unbind(-1)
        return torch.stack([cos * x + sin * y, cos * y - sin * x, z], dim=-1)


@dataclass(frozen=True, kw_only=True)
class Snapshot(Motion):
    """One instant of N environments. Positions [m], velocities [m/s, rad/s], in the frame that the name gives.

    `sgf` holds the Standard Guidance Field at the nine robot keypoints; `ogf` the field of hands and object at
    (left hand, right hand, eight object keypoints); `eta` is the attraction of both [m/s]. `c_W` (N, 3) is the
    navigation command c; its horizontal part has the commanded speed. `touch` (N, 2): soles on the floor.
    `clearance` and `object_clearance` (N,): from the sphere cover to the obstacles [m]; `clearance_ahead` (N,): the
    same of upper body and object together, where they will be after `LOOK_AHEAD_S` at the commanded velocity.
    `robot_hit` and `object_hit` (N,) bool: collisions, from the cover in training and from exact geometry in
    evaluation. `met` (N,) bool: of what is hit something moves; exact geometry alone tells. `scan` (N, 40): signed
    distances at the points of `hotice.task.scan` [m], or (N, 0) where the task has none. `past` (N, H): as in `Memory`.
    """

    sgf: FieldSample
    ogf: FieldSample
    eta: float
    c_W: Tensor
    speed: Tensor
    heading_error: Tensor
    goal_Y: Tensor
    goal_distance: Tensor
    scan: Tensor
    clearance: Tensor
    object_clearance: Tensor
    clearance_ahead: Tensor
    robot_hit: Tensor
    object_hit: Tensor
    met: Tensor
    touch: Tensor
    swing: Tensor
    stance: Tensor
    action: Tensor
    last_action: Tensor
    past: Tensor
    phase: Tensor
    time_left: Tensor
    grasp: Grasp


def read_motion(
    physics: Physics, layout: Layout, grasp: Grasp, ids: Tensor | None = None
) -> tuple[Motion, Tensor, Tensor]:
    """Reads poses and velocities of environments `ids` (default all) in float32.

    Returns:
        The motion, and the frames of all bodies: positions (N, B, 3) [m] and rotation matrices (N, B, 3, 3), in W.
    """

    def take(t: Tensor) -> Tensor:
        return (t if ids is None else t[ids]).float()

    xpos, xmat, cvel, com = (take(t) for t in (physics.xpos, physics.xmat, physics.cvel, physics.com))
    qpos, qvel = take(physics.qpos), take(physics.qvel)
    p, o = layout.pelvis, layout.object
    R_WP, R_WO = xmat[:, p], xmat[:, o]
    R_WJ = xmat[:, layout.joint_body]
    body = layout.point_body
    p_WK = xpos[:, body] + (xmat[:, body] @ layout.point_offset[:, :, None]).squeeze(-1)
    twist = cvel[:, body]
    v_WK = twist[..., 3:] + torch.linalg.cross(twist[..., :3], p_WK - com[:, p][:, None])
    p_WO = xpos[:, o]
    arm_WO = torch.where(
        grasp.world_aligned[:, None, None], grasp.keypoints_O, grasp.keypoints_O @ R_WO.transpose(1, 2)
    )
    w_WO, v_WO = cvel[:, o, :3], qvel[:, layout.object_v : layout.object_v + 3]
    spin = torch.where(grasp.world_aligned[:, None], torch.zeros_like(w_WO), w_WO)
    motion = Motion(
        p_WP=xpos[:, p],
        R_WP=R_WP,
        yaw=torch.atan2(R_WP[:, 1, 0], R_WP[:, 0, 0]),
        v_WP=qvel[:, :3],
        w_WP_P=qvel[:, 3:6],
        gravity_P=-R_WP[:, 2],
        q=qpos[:, layout.q],
        qd=qvel[:, layout.qd],
        joint_axis_W=(R_WJ @ layout.joint_axis[:, :, None]).squeeze(-1),
        joint_anchor_W=xpos[:, layout.joint_body] + (R_WJ @ layout.joint_offset[:, :, None]).squeeze(-1),
        torque=take(physics.actuator_force),
        p_WK=p_WK,
        v_WK=v_WK,
        p_WO=p_WO,
        R_WO=R_WO,
        v_WO=v_WO,
        w_WO=w_WO,
        p_WOK=p_WO[:, None] + arm_WO,
        v_WOK=v_WO[:, None] + torch.linalg.cross(spin[:, None].expand_as(arm_WO), arm_WO),
    )
    return motion, xpos, xmat
