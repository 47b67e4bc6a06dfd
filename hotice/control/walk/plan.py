"""Everything that is planned before the first step: way, footsteps, posture."""

from __future__ import annotations

from dataclasses import dataclass

from hotice.control.walk.arms import ArmTable, level_arms
from hotice.control.walk.config import WalkConfig
from hotice.control.walk.footsteps import LEFT, Footstep, plan_footsteps
from hotice.control.walk.ground import Ground
from hotice.control.walk.path import WalkPath, plan_path
from hotice.control.walk.profile import PostureProfile, plan_profile, postures
from hotice.fields import HodPf
from hotice.model.carry import CarryState


@dataclass(frozen=True, eq=False)
class WalkPlan:
    """Plan that the controller follows.

    Attributes:
        path: of the middle between the ankles. footsteps: in order. profile: pelvis height and lean along the path.
        arms: angles that keep the load level at a lean.
    """

    path: WalkPath
    footsteps: tuple[Footstep, ...]
    profile: PostureProfile
    arms: ArmTable


def plan_walk(
    pf: HodPf,
    state: CarryState,
    start: tuple[float, float, float],
    config: WalkConfig | None = None,
    *,
    first_foot: int = LEFT,
) -> WalkPlan:
    """Plans a walk to the scene's goal.

    Args:
        pf: fields of the scene. state: what is carried and how. start: middle between the ankles, x, y [m], heading
            [rad].
        first_foot: which foot steps first, 0 left, 1 right.

    Raises `UnreachableGoal` where no footholds lead to the goal.
    """
    config = config or WalkConfig()
    arms = level_arms(state)
    table = postures(state, arms, config)
    path = plan_path(pf, start, table[0].body, margin_m=config.body_margin_m)
    steps = plan_footsteps(path, Ground(pf.scene, config.ground_margin_m), config, first_foot=first_foot)
    return WalkPlan(path, tuple(steps), plan_profile(pf, path, table, config), arms)
