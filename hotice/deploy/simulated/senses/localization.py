"""Localization of a simulated robot: where its lidar's IMU is in the map, with the trained noise, and drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.deploy.frames import WAIST, Pose, lidar_in_pelvis
from hotice.deploy.simulated.senses.posting import Posting
from hotice.deploy.simulated.world import World
from hotice.deploy.sources.protocol import Sender
from hotice.deploy.sources.records import PoseSample
from hotice.model import g1
from hotice.model.frames import rotation_z
from hotice.model.scene import Scene
from hotice.task.sensing import SensingConfig

Array = NDArray[np.float64]
RATE_HZ = 10.0
"""Of FAST-LIO with the usual driver, and the rate that students are trained with."""


class MapPlace(NamedTuple):
    """Where the map M of localization lies in the scene, and how long its unit is."""

    X_WM: Pose
    unit_m: float = 1.0

    @classmethod
    def of(cls, scene: Scene) -> MapPlace:
        """By the scene's `source`; without one M is W."""
        if scene.source is None:
            return cls(Pose(np.eye(3), np.zeros(3)))
        return cls(Pose.of(scene.source.position_m, scene.source.quaternion_wxyz), scene.source.unit_m)

    def pose(self, X_WB: Pose) -> tuple[Array, Array]:
        """Position in the map's unit and quaternion of a body whose pose is known in the scene."""
        X_MB = self.X_WM.inverse @ X_WB
        return X_MB.p / self.unit_m, X_MB.quat


class Localization:
    """Measures at 10 Hz; noise is that of the pelvis' place and heading, uniform, as students are trained with.

    Roll and pitch are exact. Attributes lost, offset_m and turn_rad are for mishaps.
    """

    def __init__(
        self,
        world: World,
        sender: Sender,
        sensing: SensingConfig,
        rng: np.random.Generator,
        *,
        place: MapPlace | None = None,
        drift_m_s: float = 0.0,
        latency_s: float = 0.0,
    ) -> None:
        """`place`: of the map, default `MapPlace.of` the world's scene."""
        self._place = place or MapPlace.of(world.scene)
        self._world, self._sensing, self._rng = world, sensing, rng
        self._posting = Posting(sender, RATE_HZ, latency_s)
        along = rng.uniform(-np.pi, np.pi)
        self._drift_W = drift_m_s * np.array([np.cos(along), np.sin(along), 0.0])
        self._frozen: tuple[Array, Array] | None = None
        self.lost = self.frozen = self.nan = False
        self.offset_m, self.turn_rad = 0.0, 0.0

    def live(self, time_s: float, stamp_s: float | None = None) -> None:
        """Measures if it is time, and sends what is due; `stamp_s`: now on the sender's clock. Raises `LinkError`."""
        if self._posting.due(time_s):
            position, quat = self._measure(time_s)
            if self.frozen:
                position, quat = self._frozen = self._frozen or (position, quat)
            else:
                self._frozen = None
            if self.nan:
                position = position * np.nan
            sample = PoseSample(
                number=self._posting.number,
                measured_s=time_s if stamp_s is None else stamp_s,
                p_ML=position,
                quat_ML=quat,
            )
            self._posting.post(sample.encode(), time_s, lost=self.lost)
        self._posting.send(time_s)

    def _measure(self, time_s: float) -> tuple[Array, Array]:
        draws = self._rng.uniform(-1.0, 1.0, 4)
        qpos = self._world.data.qpos
        true = Pose.of(qpos[g1.ROOT_POS], qpos[g1.ROOT_QUAT])
        turn = rotation_z(self._sensing.root_yaw_rad * draws[3] + self.turn_rad)
        place = true.p + self._sensing.root_pos_m * draws[:3] + self._drift_W * time_s + [self.offset_m, 0.0, 0.0]
        X_WP = Pose(turn @ true.R, place)
        return self._place.pose(X_WP @ lidar_in_pelvis(self._world.joint_pos[list(WAIST)]))
