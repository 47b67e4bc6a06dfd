"""The solids of a model that are shown, and where they are in a state."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.errors import HoticeError
from hotice.replay.solids import SOLIDS

Array = NDArray[np.float64]
GROUPS = (0, 1, 2)
_TYPE_NAMES = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{name.upper()}")): name for name in SOLIDS}


class InvalidRollout(HoticeError):
    """A rollout record or its file that cannot be used."""


class Placed(NamedTuple):
    """Where things are in one state: solids (G, 3) [m] and (G, 4) wxyz, root and object (3,) [m], all in W."""

    pos_W: Array
    quat_W: Array
    root_pos_W: Array
    object_pos_W: Array


class ShownSolids:
    """Solids of a model but for those of the world (floor, obstacles), of a hidden group or fully transparent.

    Args:
        model: robot and carried object.
        groups: MuJoCo geom groups that are shown.
        root_body: body whose position is the root's.
        object_body: body of the carried object.

    Raises:
        InvalidRollout: a body is missing, or a moving solid is not a primitive.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        groups: Collection[int] = GROUPS,
        root_body: str = "pelvis",
        object_body: str = "object",
    ) -> None:
        self.model, self._data = model, mujoco.MjData(model)
        self._root, self._object = _body(model, root_body), _body(model, object_body)
        self._shown = _shown_geoms(model, groups)

    def described(self) -> dict[str, Any]:
        """Fields of a `RolloutRecord` that are the same in every frame: names, types, sizes, colours."""
        model, shown = self.model, self._shown
        material = model.geom_matid[shown]
        rgba = model.geom_rgba[shown].astype(float)
        rgba[material >= 0] = model.mat_rgba[material[material >= 0]]
        return {
            "geom_names": [model.geom(int(g)).name or f"geom_{g}" for g in shown],
            "geom_types": [_TYPE_NAMES[int(model.geom_type[g])] for g in shown],
            "geom_sizes": model.geom_size[shown].copy(),
            "geom_rgba": rgba,
            "geom_is_object": model.geom_bodyid[shown] == self._object,
        }

    def place(self, qpos: Array) -> Placed:
        """Poses in a state (nq,)."""
        data = self._data
        data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, data)
        quat = np.empty((len(self._shown), 4))
        for g, geom in enumerate(self._shown):
            mujoco.mju_mat2Quat(quat[g], data.geom_xmat[geom])
        return Placed(data.geom_xpos[self._shown], quat, data.xpos[self._root].copy(), data.xpos[self._object].copy())


def _body(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        known = ", ".join(model.body(i).name for i in range(model.nbody))
        raise InvalidRollout(f"the model has no body {name!r}: known are {known}")
    return index


def driven(model: mujoco.MjModel, body: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Whether bodies (n,) belong to robot or object: neither fixed to the world nor a mocap body of the scene."""
    return (model.body_weldid[body] != 0) & (model.body_mocapid[model.body_weldid[body]] < 0)


def _shown_geoms(model: mujoco.MjModel, groups: Collection[int]) -> NDArray[np.int64]:
    moving = driven(model, model.geom_bodyid)
    visible = np.isin(model.geom_group, list(groups)) & (model.geom_rgba[:, 3] > 0)
    shown = np.flatnonzero(moving & visible)
    for geom in shown:
        if int(model.geom_type[geom]) not in _TYPE_NAMES:
            raise InvalidRollout(f"geom {model.geom(int(geom)).name!r} is not one of {', '.join(SOLIDS)}")
    return shown
