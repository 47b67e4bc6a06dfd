"""The pick-up of a station before it begins: where robot and object are, and the plan that is followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.control.pick_plan import Support
from hotice.control.pickup.controller import Pickup
from hotice.control.pickup.end_state import carry_at_end
from hotice.control.pickup.footwork import Departure
from hotice.errors import PickInfeasible
from hotice.model import g1
from hotice.model.carry import CarryState
from hotice.model.frames import quat_from_yaw, quat_mul, quat_rotate
from hotice.model.scene import Scene
from hotice.systems.setup.config import StationConfig
from hotice.systems.setup.table import pick_origin

Array = NDArray[np.floating]


@dataclass(frozen=True, kw_only=True, eq=False)
class PickSetting:
    """A pick-up before it begins, in W.

    controller: of `hotice.control.pickup`; carry: the state in which it leaves the object; origin: x, y [m], yaw [rad]
    of its frame; qpos: (34,) robot and object, in MuJoCo's order.
    """

    controller: Pickup
    carry: CarryState
    origin: tuple[float, float, float]
    qpos: Array


def plan_pick(config: StationConfig, scene: Scene, departure: Departure | None) -> PickSetting:
    """The robot before the table and the plan to pick the object up from it.

    Args:
        config: the object and its table. scene: where both stand. departure: steps that follow; None: none.

    Raises:
        HoticeError: an object or a table that the pick-up refuses. MissingExtra: without what plans it.
    """
    carried, half, origin = config.carried, config.carried.half_extents_m, pick_origin(scene, config)
    try:
        support = Support(top_m=config.support_height_m, near_m=config.support_near_m)
        p_GO = np.array([support.near_m + 0.02 + half[0], 0.0, support.top_m + half[2]])
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        controller = Pickup(carried, support, p_GO, upright, departure=departure)
    except PickInfeasible as error:
        raise _out_of_reach(config, error) from None
    turn, offset = quat_from_yaw(origin[2]), np.array([*origin[:2], 0.0])
    q = controller.start_q
    qpos = np.concatenate(
        [
            quat_rotate(turn, q[g1.ROOT_POS]) + offset,
            quat_mul(turn, np.roll(q[g1.ROOT_QUAT], 1)),
            q[g1.JOINT_POS],
            quat_rotate(turn, p_GO) + offset,
            quat_mul(turn, upright),
        ]
    )
    return PickSetting(controller=controller, carry=carry_at_end(controller), origin=origin, qpos=qpos)


def _out_of_reach(config: StationConfig, why: PickInfeasible) -> PickInfeasible:
    return PickInfeasible(
        f"the {config.carried.shape} cannot be picked up with support_height_m {config.support_height_m:g} and "
        f"support_near_m {config.support_near_m:g}: {why}; move the support (0.25 m before the feet and 0.5 to 0.7 m "
        "high suit most objects)"
    )
