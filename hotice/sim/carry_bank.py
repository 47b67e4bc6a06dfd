"""Many carry states at once: the objects and grasps from which episodes start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from hotice.errors import CarryInfeasible
from hotice.model import builder
from hotice.model.carry import CarryState, solve_carry
from hotice.model.dynamics import DynamicsConfig, joint_offset, perturb
from hotice.model.object_range import ObjectRange
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.sim.cover import object_cover
from hotice.sim.snapshot import Grasp


@dataclass(frozen=True, kw_only=True)
class CarryBank:
    """M carry states, their models and their rows as tensors (leading axis M)."""

    states: tuple[CarryState, ...]
    models: tuple[mujoco.MjModel, ...]
    qpos: Tensor  # (M, 34)
    target: Tensor  # (M, 20)
    joint_offset: Tensor  # (M, 20) error of the encoders
    cover_centre: Tensor  # (M, OBJECT_SPHERES, 3)
    cover_radius: Tensor  # (M, OBJECT_SPHERES)
    grasp: Grasp

    @classmethod
    def sample(
        cls, objects: ObjectRange, count: int, seed: int, timestep_s: float, device: torch.device, **build: Any
    ) -> CarryBank:
        """`count` random objects that can be held; `build`: see `of`.

        Raises `CarryInfeasible` when most of the range cannot be held.
        """
        rng = np.random.default_rng(seed)
        states: list[CarryState] = []
        reasons: list[str] = []
        while len(states) < count:
            try:
                states.append(solve_carry(objects.sample(rng)))
            except CarryInfeasible as error:
                reasons.append(str(error))
                if len(reasons) > 2 * count + 4:
                    raise CarryInfeasible(
                        f"{len(reasons)} of {len(reasons) + len(states)} objects of "
                        f"{' m to '.join(map(str, objects.size_m))} m and "
                        f"{' kg to '.join(map(str, objects.mass_kg))} kg cannot be held: give smaller or lighter ones; "
                        f"the last: {error}"
                    ) from None
        return cls.of(states, timestep_s, device, **{"seed": seed, **build})

    @classmethod
    def of_objects(
        cls, objects: Sequence[CarriedObject], timestep_s: float, device: torch.device, **build: Any
    ) -> CarryBank:
        """Carry states of the given objects, in order. Raises `CarryInfeasible`."""
        return cls.of([solve_carry(o) for o in objects], timestep_s, device, **build)

    @classmethod
    def of(
        cls,
        states: Sequence[CarryState],
        timestep_s: float,
        device: torch.device,
        *,
        scene: Scene | None = None,
        elliptic: bool = False,
        one_layout: bool = False,
        dynamics: DynamicsConfig | None = None,
        seed: int = 0,
        robots: Sequence[np.random.Generator] | None = None,
    ) -> CarryBank:
        """Compiles the model of each state, once where a state occurs again, and stacks their rows.

        Args:
            states: carry states. timestep_s: physics step. device: of the tensors.
            scene: its obstacles become part of every model (evaluation with exact geometry).
            elliptic: friction cones of evaluation, see `build_model`.
            one_layout: gives every model a geom of each shape that occurs, see `builder.add_object`.
            dynamics: spread of the robots' parameters, drawn anew for each row from a generator of its own: those of
                `robots`, or ones made of `seed`.
        """
        shapes = sorted({s.carried.shape for s in states})
        compiled = {
            key: builder.build_model(
                s.carried,
                scene,
                wrist_pos=s.wrist_pos,
                timestep_s=timestep_s,
                elliptic=elliptic,
                object_shapes=shapes if one_layout and len(shapes) > 1 else (),
            )
            for key, s in {id(s): s for s in states}.items()
        }
        models = [compiled[id(s)] for s in states]
        if dynamics is not None and not dynamics.nominal:
            # a generator each: a robot depends neither on those before it nor on how many obstacles there are
            rngs = robots or [np.random.default_rng([seed, 1, i]) for i in range(len(states))]
            models = [perturb(m, dynamics, rng) for m, rng in zip(models, rngs, strict=True)]

        def rows(values: Sequence[np.ndarray]) -> Tensor:
            return torch.tensor(np.stack(values), dtype=torch.float32, device=device)

        covers = [object_cover(s.carried.shape, s.carried.half_extents_m) for s in states]
        return cls(
            states=tuple(states),
            models=tuple(models),
            qpos=torch.tensor(np.stack([s.qpos() for s in states]), dtype=torch.float64, device=device),
            target=rows([s.joint_target for s in states]),
            joint_offset=rows([joint_offset(m) for m in models]),
            cover_centre=rows([c for c, _ in covers]),
            cover_radius=rows([r for _, r in covers]),
            grasp=Grasp(
                joint_pos=rows([s.joint_pos for s in states]),
                half_extents=rows([s.carried.half_extents_m for s in states]),
                mass=rows([m.body_mass[[m.body(builder.OBJECT_BODY).id]] for m in models]),
                keypoints_O=rows([s.carried.keypoints() for s in states]),
                world_aligned=torch.tensor([s.carried.keypoints_world_aligned for s in states], device=device),
                p_OH=rows([_hands(s, m) for s, m in zip(states, models, strict=True)]),
                height_P=rows([np.array(s.object_pos_W[2] - s.root_pos_W[2]) for s in states]),
            ),
        )


def _hands(state: CarryState, model: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    mujoco.mj_kinematics(model, data)
    hands = np.stack([data.site("left_hand").xpos, data.site("right_hand").xpos])
    return hands - state.object_pos_W


def pick(grasp: Grasp, ids: Tensor) -> Grasp:
    """Rows `ids` of a grasp table."""
    return Grasp(**{name: value[ids] for name, value in vars(grasp).items()})
