"""Sight of what moves about a simulated robot: poses in the map of localization, without noise, late."""

from __future__ import annotations

import numpy as np

from hotice.deploy.frames import Pose
from hotice.deploy.simulated.senses.localization import MapPlace
from hotice.deploy.simulated.senses.posting import Posting
from hotice.deploy.simulated.world import World
from hotice.deploy.sources.protocol import Sender
from hotice.deploy.sources.records import MoverSample, scene_mark
from hotice.model.frames import normalize
from hotice.task.moving import MovingConfig

TRAINED = MovingConfig()
"""Rate and delay of training and evaluation: 10 Hz, 0.1 s."""


class MoverSight:
    """Measures where all that moves truly is. Attributes lost and nan are for mishaps."""

    def __init__(self, world: World, sender: Sender, *, place: MapPlace | None = None) -> None:
        """`place`: of the map, default `MapPlace.of` the world's scene."""
        self._world, self._place = world, place or MapPlace.of(world.scene)
        self._posting = Posting(sender, TRAINED.sensor_hz, TRAINED.sensor_delay_s)
        self._mark = scene_mark(o.name for o in world.scene.moving)
        self.lost = self.nan = False

    def live(self, time_s: float, stamp_s: float | None = None) -> None:
        """Measures if it is time, and sends what is due; `stamp_s`: now on the sender's clock. Raises `LinkError`."""
        if self._posting.due(time_s):
            poses = self._measured()
            sample = MoverSample(
                number=self._posting.number,
                measured_s=time_s if stamp_s is None else stamp_s,
                scene=self._mark,
                poses_M=poses * np.nan if self.nan else poses,
            )
            self._posting.post(sample.encode(), time_s, lost=self.lost)
        self._posting.send(time_s)

    def _measured(self) -> np.ndarray:
        data = self._world.data
        pairs = zip(data.mocap_pos, data.mocap_quat, strict=True)
        seen = [self._place.pose(Pose.of(p, normalize(quat))) for p, quat in pairs]
        return np.array([np.concatenate(pose) for pose in seen])
