"""Reward terms: pure functions of a `Snapshot`, each (N,). Weights and receivers are in `hotice.sim.rewards`."""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.fields.alignment import cosine, residual_cosine
from hotice.model import g1
from hotice.sim.snapshot import FEET, HANDS, HEAD, HEELS, PELVIS, TOES, Snapshot

SPEED_EPS = 0.1
"""Softening of the cosines: the direction of a body at rest, or of a residual that is noise, scores nothing [m/s]."""
FADE_M = 0.5
"""Closer to the goal than this the cosines fade out: there head and feet are drawn to a point at pelvis height [m]."""
_STEM = [g1.stem(j) for j in g1.ACTION_JOINTS]
_STANCE_JOINTS = [i for i, s in enumerate(_STEM) if s in ("hip_roll", "hip_yaw")]


def _moving(s: Snapshot) -> Tensor:
    """1 while a walking speed is commanded, fading to 0 as the robot is to stand."""
    return torch.clamp(s.speed / 0.2, 0.0, 1.0)


def _travelling(s: Snapshot) -> Tensor:
    """1 farther than `FADE_M` from the goal, fading to 0 on it."""
    return torch.clamp(s.goal_distance / FADE_M, 0.0, 1.0)


def _at_command(s: Snapshot) -> Tensor:
    """F_object·speed/η, the object-centric field at the commanded speed, (N, 10, 3) [m/s].

    The paper takes c from F itself, whose size in free space is η. Our c has the walking speed, which is another one
    and falls near the goal: F − c would ask hands and object to lag behind the body, or to run ahead of it, where no
    obstacle is. At the commanded speed what remains is what obstacles ask for, and that the field draws every point to
    the goal at pelvis height while c is one vector: 0.13 m/s two metres before the goal, vanishing farther away.
    """
    return s.ogf.force_W * (s.speed / s.eta)[:, None, None]


# shared: potential fields and lifting


def sgf_head(s: Snapshot) -> Tensor:
    """Cosine between F of the SGF and v of the head; softened, fading at the goal."""
    return cosine(s.sgf.force_W[:, HEAD], s.v_WK[:, HEAD], SPEED_EPS) * _travelling(s)


def sgf_pelvis(s: Snapshot) -> Tensor:
    """Cosine between F of the SGF and v of the pelvis; softened, fading at the goal."""
    return cosine(s.sgf.force_W[:, PELVIS], s.v_WK[:, PELVIS], SPEED_EPS) * _travelling(s)


def sgf_feet(s: Snapshot) -> Tensor:
    """Cosine between F of the SGF and v of the feet, mean of both; softened, fading at the goal."""
    return cosine(s.sgf.force_W[:, FEET], s.v_WK[:, FEET], SPEED_EPS).mean(dim=1) * _travelling(s)


def ogf_hands(s: Snapshot) -> Tensor:
    """Cosine between [F_object·speed/η − c] and [v − c] at the hands, mean of both; softened, fading at the goal."""
    return residual_cosine(_at_command(s)[:, :2], s.v_WK[:, HANDS], s.c_W, SPEED_EPS).mean(dim=1) * _travelling(s)


def ogf_object(s: Snapshot) -> Tensor:
    """Cosine between [F_object·speed/η − c] and [v − c] at the object's eight, mean; softened, fading at the goal."""
    return residual_cosine(_at_command(s)[:, 2:], s.v_WOK, s.c_W, SPEED_EPS).mean(dim=1) * _travelling(s)


def object_lift(s: Snapshot) -> Tensor:
    """The object stays at its height over the pelvis."""
    return torch.exp(-((s.p_WO[:, 2] - s.p_WP[:, 2] - s.grasp.height_P) / 0.10).square())


def clearance(s: Snapshot) -> Tensor:
    """Intrusion of robot and object into the last 5 cm before an obstacle, and into it: 0 to 2 each."""
    return _intrusion(s.clearance) + _intrusion(s.object_clearance)


def clearance_ahead(s: Snapshot) -> Tensor:
    """Intrusion into the last 5 cm before an obstacle, and into it, of upper body and object moved on as commanded.

    0 to 4, 20 cm deep. Whether a body passes a beam or a table edge shows only when it is there: this tells on the way
    how much lower or farther aside it has to be.
    """
    return torch.clamp(1.0 - s.clearance_ahead / 0.05, 0.0, 4.0)


def _intrusion(distance: Tensor) -> Tensor:
    return torch.clamp(1.0 - distance / 0.05, 0.0, 2.0)


# lower body: locomotion and balance


def progress(s: Snapshot) -> Tensor:
    """Root velocity along the command, at most the commanded speed, over eta: linear, so that slow never beats fast."""
    along = (s.v_WP[:, :2] * torch.nn.functional.normalize(s.c_W[:, :2], dim=-1)).sum(dim=-1)
    return torch.minimum(along, s.speed) / s.eta


def arrival(s: Snapshot) -> Tensor:
    """The root is at the goal: two bells of the distance, 20 cm and 7 cm wide."""
    return 0.5 * (torch.exp(-(s.goal_distance / 0.20).square()) + torch.exp(-(s.goal_distance / 0.07).square()))


def velocity_tracking(s: Snapshot) -> Tensor:
    """exp(−4 |c − v|²) of the horizontal root velocity."""
    return torch.exp(-4.0 * (s.c_W[:, :2] - s.v_WP[:, :2]).square().sum(dim=-1))


def heading(s: Snapshot) -> Tensor:
    """Facing where the command points."""
    return torch.exp(-4.0 * s.heading_error.square())


def yaw_rate(s: Snapshot) -> Tensor:
    """Squared error of the yaw rate against twice the heading error."""
    return (s.w_WP_P[:, 2] - 2.0 * s.heading_error).square().clamp_max(4.0)


def upright(s: Snapshot) -> Tensor:
    """Squared horizontal part of gravity in the pelvis frame: sin² of the lean."""
    return s.gravity_P[:, :2].square().sum(dim=-1)


def root_height(s: Snapshot) -> Tensor:
    """Squared deviation of the pelvis from 0.74 m."""
    return (s.p_WP[:, 2] - 0.74).square()


def root_bounce(s: Snapshot) -> Tensor:
    """Squared vertical velocity of the pelvis."""
    return s.v_WP[:, 2].square().clamp_max(4.0)


def root_rocking(s: Snapshot) -> Tensor:
    """Squared roll and pitch rates of the pelvis."""
    return s.w_WP_P[:, :2].square().sum(dim=-1).clamp_max(10.0)


def gait_schedule(s: Snapshot) -> Tensor:
    """Feet touch the floor when the step clock says so: share of feet in agreement minus share in disagreement."""
    walking = _moving(s)[:, None] > 0.5
    wanted = torch.where(walking, s.stance, torch.ones_like(s.stance))
    unwanted = torch.where(walking, s.swing > 0.02, torch.zeros_like(s.stance))
    agree = wanted & s.touch | unwanted & ~s.touch
    disagree = wanted & ~unwanted & ~s.touch | unwanted & ~wanted & s.touch
    return (agree.float() - disagree.float()).mean(dim=1)


def single_support(s: Snapshot) -> Tensor:
    """Exactly one foot carries the robot: walking rather than hopping or shuffling."""
    return (s.touch[:, 0] ^ s.touch[:, 1]).float() * _moving(s)


def flight(s: Snapshot) -> Tensor:
    """Both feet are in the air."""
    return (~s.touch).all(dim=1).float()


def swing_height(s: Snapshot) -> Tensor:
    """Squared lack of height of the swinging foot (lower of toe and heel) against the clock's; more by obstacles."""
    lowest = torch.minimum(s.p_WK[:, TOES, 2], s.p_WK[:, HEELS, 2])
    near = torch.clamp((0.25 - s.sgf.signed_distance[:, FEET]) / 0.15, 0.0, 1.0)
    error = (torch.clamp(s.swing * (1.0 + 0.6 * near) - lowest, min=0.0) / 0.10).square()
    return (error * (s.swing > 0)).sum(dim=1) * _moving(s)


def foot_slip(s: Snapshot) -> Tensor:
    """Squared horizontal velocity of feet on the floor."""
    return (s.v_WK[:, FEET, :2].square().sum(dim=-1) * s.touch).sum(dim=1).clamp_max(4.0)


def foot_spread(s: Snapshot) -> Tensor:
    """Square of how much closer than 18 cm or wider than 34 cm the feet are, sideways [dm²]."""
    across = s.to_yaw_frame(s.p_WK[:, FEET[0]] - s.p_WK[:, FEET[1]])[:, 1]
    return ((torch.clamp(0.18 - across, min=0.0) + torch.clamp(across - 0.34, min=0.0)) * 10.0).square().clamp_max(4.0)


def hip_posture(s: Snapshot) -> Tensor:
    """Squared deviation of hip roll and yaw from the carry state."""
    return (s.q - s.grasp.joint_pos)[:, _STANCE_JOINTS].square().sum(dim=1)


def stand_still(s: Snapshot) -> Tensor:
    """Squared deviation of all legs from the carry state while standing is commanded."""
    return (s.q - s.grasp.joint_pos)[:, g1.LOWER].square().sum(dim=1) * (1.0 - _moving(s))


def leg_smoothness(s: Snapshot) -> Tensor:
    """Squared change of the leg actions."""
    return (s.action - s.last_action)[:, g1.LOWER].square().sum(dim=1)


def leg_torque(s: Snapshot) -> Tensor:
    """Squared leg torques [(100 N m)²]."""
    return (s.torque[:, g1.LOWER] / 100.0).square().sum(dim=1)


# upper body: reaching and grasp


def hand_reach(s: Snapshot) -> Tensor:
    """Hands stay on their places on the object (distance over 3 cm)."""
    return torch.exp(-_hand_error(s).square().sum(dim=-1) / 0.03**2).mean(dim=1)


def grasp_slip(s: Snapshot) -> Tensor:
    """Squared velocity of the object relative to the mean of the hands."""
    return (s.v_WO - s.v_WK[:, HANDS].mean(dim=1)).square().sum(dim=-1).clamp_max(4.0)


def object_upright(s: Snapshot) -> Tensor:
    """1 − cos of the object's tilt."""
    return 1.0 - s.R_WO[:, 2, 2]


def object_steady(s: Snapshot) -> Tensor:
    """Squared angular velocity of the object."""
    return s.w_WO.square().sum(dim=-1).clamp_max(20.0)


def arm_smoothness(s: Snapshot) -> Tensor:
    """Squared change of the arm actions."""
    return (s.action - s.last_action)[:, g1.UPPER].square().sum(dim=1)


def arm_posture(s: Snapshot) -> Tensor:
    """Squared arm actions: the carry targets hold the load already."""
    return s.action[:, g1.UPPER].square().sum(dim=1)


def _hand_error(s: Snapshot) -> Tensor:
    """Displacement of the hands on the object, (N, 2, 3) [m]; of a sphere only the distance from the centre counts."""
    p_OH = (s.p_WK[:, HANDS] - s.p_WO[:, None]) @ s.R_WO
    error = p_OH - s.grasp.p_OH
    radial = p_OH.norm(dim=-1, keepdim=True) - s.grasp.p_OH.norm(dim=-1, keepdim=True)
    sphere = torch.cat([radial, torch.zeros_like(error[..., :2])], dim=-1)
    return torch.where(s.grasp.world_aligned[:, None, None], sphere, error)
