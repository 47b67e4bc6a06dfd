"""The lowest point of the soles, by forward kinematics."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1

Array = NDArray[np.float64]


def lowest_sole(q: Array, up_P: Array) -> float:
    """Height of the lowest point of the soles over the pelvis [m], negative.

    Args:
        q: (29,) joints, order `g1.ALL_JOINTS` [rad].
        up_P: (3,) upwards in the pelvis, unit.
    """
    model, data = _robot()
    data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    data.qpos[7:] = q
    mujoco.mj_kinematics(model, data)
    soles = [i for i in range(model.ngeom) if any(model.geom(i).name.startswith(f"{s}_sole_") for s in g1.SIDES)]
    return float((data.geom_xpos[soles] @ up_P - model.geom_size[soles, 0]).min())


@lru_cache
def _robot() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = builder.build_model(joints=29, floor=False)
    return model, mujoco.MjData(model)
