"""A rollout as MuJoCo's renderer draws it, with shadows: the palette and the camera of the replay page."""

from __future__ import annotations

from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.replay.offscreen import open_context
from hotice.replay.palette import AHEAD_M, FAR_M, FROM, HEIGHT_M, OGF_COLOR, SGF_COLOR
from hotice.replay.picture import arrows_of
from hotice.replay.rollout import RolloutRecord
from hotice.replay.stage_model import OBSTACLES, SUN, rgba, stage_model

SEEN_M = ((0.0, 0.0, 0.45), (0.0, 0.0, 0.15), (0.0, 0.0, -0.3))
"""Points of the robot from its pelvis that, with the carried object's centre, no obstacle is to hide [m]."""
SEE_THROUGH = 0.3
"""Opacity of an obstacle that would hide one of them."""
ARROW_RADIUS_M = 0.008
_GEOM = mujoco.mjtGeom


class Stage:
    """Draws moments of one record. Use `with`. Raises `NoRenderer`."""

    def __init__(self, record: RolloutRecord, size_px: tuple[int, int]) -> None:
        self._record, self._size = record, size_px
        self._model = stage_model(record, size_px)
        self._data = mujoco.MjData(self._model)
        self._obstacles = np.flatnonzero(self._model.geom_group == OBSTACLES).tolist()
        self._scene = mujoco.MjvScene(self._model, self._model.ngeom + len(record.arrow_is_ogf) + 10)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = True
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        toward = -np.array(FROM) / np.linalg.norm(FROM)
        self._camera.azimuth = np.degrees(np.arctan2(toward[1], toward[0]))
        self._camera.elevation = np.degrees(np.arcsin(toward[2]))
        self._camera.distance = FAR_M
        self._context = open_context(*size_px)
        self._context.make_current()
        self._drawer = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._drawer)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._drawer.free()
        self._context.free()

    def draw(self, frame: int) -> NDArray[np.uint8]:
        """Image (H, W, 3) of a frame of the record."""
        self._place(frame)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, self._camera, everything, self._scene)
        self._draw_arrows(frame)
        width, height = self._size
        whole, image = mujoco.MjrRect(0, 0, width, height), np.empty((height, width, 3), np.uint8)
        mujoco.mjr_render(whole, self._scene, self._drawer)
        mujoco.mjr_readPixels(image, None, whole, self._drawer)
        # OpenGL's lines begin at the bottom
        return np.ascontiguousarray(image[::-1])

    def _place(self, frame: int) -> None:
        record, model, data = self._record, self._model, self._data
        root = record.root_pos_W[frame]
        obstacles = [obstacle.at(float(record.time_s[frame])) for obstacle in record.scene.obstacles]
        sun = SUN + [root[0], root[1], 0.0]
        data.mocap_pos[:] = [sun, *record.geom_pos_W[frame], *(o.position_m for o in obstacles)]
        data.mocap_quat[:] = [(1, 0, 0, 0), *record.geom_quat_W[frame], *(o.quaternion_wxyz for o in obstacles)]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        look_at = np.array([root[0] + AHEAD_M, root[1], HEIGHT_M])
        self._camera.lookat[:] = look_at
        eye = look_at + FAR_M * np.array(FROM) / np.linalg.norm(FROM)
        seen = [*(root + np.array(SEEN_M)), record.object_pos_W[frame]]
        for geom in self._obstacles:
            hides = any(self._is_between(geom, eye, point) for point in seen)
            model.geom_rgba[geom, 3] = SEE_THROUGH if hides else 1.0

    def _is_between(self, geom: int, eye: NDArray[np.float64], point: NDArray[np.float64]) -> bool:
        """Whether a line from `eye` to `point` meets a geom."""
        model, data, way = self._model, self._data, point - eye
        if model.geom_type[geom] == _GEOM.mjGEOM_MESH:
            share = mujoco.mj_rayMesh(model, data, geom, eye, way)
        else:
            pose = data.geom_xpos[geom], data.geom_xmat[geom], model.geom_size[geom]
            share = mujoco.mju_rayGeom(*pose, eye, way, model.geom_type[geom])
        return 0.0 <= share < 1.0

    def _draw_arrows(self, frame: int) -> None:
        start, shaft = arrows_of(self._record, frame)
        for begin, way, is_ogf in zip(start, shaft, self._record.arrow_is_ogf, strict=True):
            geom = self._scene.geoms[self._scene.ngeom]
            color = np.array(rgba(OGF_COLOR if is_ogf else SGF_COLOR), np.float32)
            mujoco.mjv_initGeom(geom, _GEOM.mjGEOM_ARROW, np.zeros(3), np.zeros(3), np.eye(3).ravel(), color)
            mujoco.mjv_connector(geom, _GEOM.mjGEOM_ARROW, ARROW_RADIUS_M, begin, begin + way)
            self._scene.ngeom += 1
