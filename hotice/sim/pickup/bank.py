"""Many picks at once: objects on supports, robots before them, and the courses that teachers follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import torch
from torch import Tensor

from hotice.model import BoxShape, Obstacle, Scene, builder, g1
from hotice.model.dynamics import DynamicsConfig, joint_offset, perturb
from hotice.model.frames import quat_from_axis_angle
from hotice.model.picks.book import PickBook
from hotice.sim.pickup.standing import SUPPORT
from hotice.sim.pickup.truth import true_course
from hotice.sim.snapshot import Grasp

FINE_S = 0.002
"""Physics steps up to this long have elliptic cones, solved to convergence, as in the protocol `robot` [s]."""
TABLE_M = (0.6, 0.8)
"""Depth and width of a support."""


@dataclass(frozen=True, kw_only=True)
class PickBank:
    """M picks, their models and their rows as tensors (leading axis M); see `PickBook`.

    Attributes:
        qpos: (M, 34) start. target: (M, 20) servo targets of the end, around which actions are.
        joint_offset: (M, 20) of the encoders; kp: (M, 20) of the servos [N m/rad].
        course_target: (M, K, 20), course_pelvis: (M, K, 2) in G: the plan;
            true_q, true_target, true_pelvis, true_rate: what a teacher follows, the plan changed for the masses of the
            robot (`hotice.sim.pickup.truth`); phase: (K,), share: (K,) of it that is over.
        place: (M, 3) of the object in the carry state, in G; ankles: (M, 2) middle of the ankles in G.
        top, near: (M,) of the support. told: (M, 1) mass as told [kg]. wrist: (M, 6). shape: (M,) index into `SHAPES`.
    """

    book: PickBook
    models: tuple[mujoco.MjModel, ...]
    qpos: Tensor
    target: Tensor
    joint_offset: Tensor
    kp: Tensor
    course_target: Tensor
    course_pelvis: Tensor
    true_q: Tensor
    true_target: Tensor
    true_pelvis: Tensor
    true_rate: Tensor
    phase: Tensor
    share: Tensor
    place: Tensor
    ankles: Tensor
    top: Tensor
    near: Tensor
    told: Tensor
    wrist: Tensor
    shape: Tensor
    grasp: Grasp

    @classmethod
    def of(
        cls,
        book: PickBook,
        timestep_s: float,
        control_dt_s: float,
        device: torch.device,
        *,
        dynamics: DynamicsConfig | None = None,
        seed: int = 0,
    ) -> PickBank:
        """Compiles the model of each pick; `dynamics`: spread of the robots, each drawn from a generator of its own."""
        fine = timestep_s <= FINE_S
        carried = [book.carried(i) for i in range(len(book))]
        models = [
            builder.build_model(
                thing, table(*book.support[i]), wrist_pos=book.wrist[i], timestep_s=timestep_s, elliptic=fine
            )
            for i, thing in enumerate(carried)
        ]
        hands = [_ends(m, book, i) for i, m in enumerate(models)]
        described = models
        if dynamics is not None and not dynamics.nominal:
            rngs = [np.random.default_rng([seed, 1, i]) for i in range(len(book))]
            models = [perturb(m, dynamics, rng) for m, rng in zip(models, rngs, strict=True)]

        def rows(values: Sequence[np.ndarray] | np.ndarray) -> Tensor:
            return torch.tensor(np.asarray(np.stack(list(values))), dtype=torch.float32, device=device)

        phase = np.asarray(book.phase)
        share = np.concatenate([np.arange(1, n + 1) / n for n in np.bincount(phase) if n])

        def rate_of(place: Tensor) -> Tensor:
            rate = torch.zeros_like(place)
            rate[:, :-1] = (place[:, 1:] - place[:, :-1]) / control_dt_s
            return rate

        pelvis = rows(book.pelvis[:, :, :2])
        kp, _ = g1.gains()
        courses = [true_course(book, i, described[i], m) for i, m in enumerate(models)]
        true_pelvis = rows([c.pelvis for c in courses])
        return cls(
            book=book,
            models=tuple(models),
            qpos=torch.tensor(np.stack([book.qpos(i) for i in range(len(book))]), dtype=torch.float64, device=device),
            target=rows(book.target[:, -1]),
            joint_offset=rows([joint_offset(m) for m in models]),
            kp=rows([m.actuator_gainprm[:, 0] for m in models]),
            course_target=rows(book.target),
            course_pelvis=pelvis,
            true_q=rows([c.joint_pos for c in courses]),
            true_target=rows([c.joint_pos + c.torque / kp for c in courses]),
            true_pelvis=true_pelvis,
            true_rate=rate_of(true_pelvis),
            phase=torch.tensor(phase, device=device),
            share=torch.tensor(share, dtype=torch.float32, device=device),
            place=rows(book.pelvis[:, -1] + book.end),
            ankles=rows([h.ankles for h in hands]),
            top=rows(book.support)[:, 0],
            near=rows(book.support)[:, 1],
            told=rows(book.mass)[:, None],
            wrist=rows(book.wrist),
            shape=torch.tensor(np.asarray(book.shape), device=device),
            grasp=Grasp(
                joint_pos=rows(book.joint_pos[:, -1]),
                half_extents=rows(0.5 * book.extents),
                mass=rows([m.body_mass[[m.body(builder.OBJECT_BODY).id]] for m in models]),
                keypoints_O=rows([c.keypoints() for c in carried]),
                world_aligned=torch.tensor([c.keypoints_world_aligned for c in carried], device=device),
                p_OH=rows([h.p_OH for h in hands]),
                height_P=rows(book.end[:, 2]),
            ),
        )


def table(top_m: float, near_m: float) -> Scene:
    """A support before a robot at the origin."""
    depth, width = TABLE_M
    shape = BoxShape((depth, width, float(top_m)))
    place = (float(near_m) + 0.5 * depth, 0.0, 0.5 * float(top_m))
    return Scene("pickup", obstacles=(Obstacle(SUPPORT, "side", shape, place),))


@dataclass(frozen=True)
class _Ends:
    """p_OH (2, 3): hands from the object at the end; ankles (2,): their middle at the start, in G."""

    p_OH: np.ndarray
    ankles: np.ndarray


def _ends(model: mujoco.MjModel, book: PickBook, row: int) -> _Ends:
    data = mujoco.MjData(model)
    data.qpos[:] = book.qpos(row)
    mujoco.mj_kinematics(model, data)
    ankles = np.mean([data.body(f"{side}_ankle_roll_link").xpos[:2] for side in g1.SIDES], axis=0)
    place = book.pelvis[row, -1] + book.end[row]
    lean = quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(book.lean[row]))
    data.qpos[:] = np.concatenate([book.pelvis[row, -1], lean, book.joint_pos[row, -1], place, [1.0, 0.0, 0.0, 0.0]])
    mujoco.mj_kinematics(model, data)
    return _Ends(np.stack([data.site(f"{side}_hand").xpos for side in g1.SIDES]) - place, ankles)
