"""Places of what moves in a MuJoCo model of a scene, whose mocap bodies are its moving obstacles in their order."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model.scene import Obstacle, Scene

Array = NDArray[np.float64]
PART_STEPS = 5
"""Physics steps over which `Movers` takes a motion to be straight."""


def place_moving(data: mujoco.MjData, moving: Sequence[Obstacle], time_s: float) -> None:
    """Puts the mocap bodies where the obstacles `moving`, all that move in the model's scene, are at `time_s` [s]."""
    for m, obstacle in enumerate(moving):
        then = obstacle.at(time_s)
        data.mocap_pos[m], data.mocap_quat[m] = then.position_m, then.quaternion_wxyz


class Movers:
    """Moves the mocap bodies of a model of a scene. Its clock stands at 0 until `begin`.

    Args: data: of the model; scene: of the model; step_s: physics step [s].
    """

    def __init__(self, data: mujoco.MjData, scene: Scene, step_s: float) -> None:
        self._data, self._moving, self._step_s = data, scene.moving, step_s
        self._steps, self.under_way = 0, False
        self._from = self._to = self._poses(0.0)

    @property
    def time_s(self) -> float:
        """On the scene's clock [s]."""
        return self._steps * self._step_s

    def begin(self) -> None:
        """The motions begin; a second time does nothing."""
        self.under_way = True

    def step(self) -> None:
        """Puts all where they are after the physics step to come."""
        if not self.under_way:
            return
        part = self._steps % PART_STEPS
        if not part:
            self._from, self._to = self._to, self._poses((self._steps + PART_STEPS) * self._step_s)
            # a quaternion and its negative are one orientation: the short way
            turned = (self._from[:, 3:] * self._to[:, 3:]).sum(axis=1) < 0.0
            self._to[turned, 3:] *= -1.0
        self._steps += 1
        now = self._from + (part + 1) / PART_STEPS * (self._to - self._from)
        # MuJoCo makes quaternions unit ones
        self._data.mocap_pos[:], self._data.mocap_quat[:] = now[:, :3], now[:, 3:]

    def fast(self, limit: float) -> set[str]:
        """Names of those that go or turn faster now than `limit` [m/s, rad/s]."""
        if not self.under_way:
            return set()
        return {o.name for o in self._moving if o.velocity_at(self.time_s).fastest > limit}

    def _poses(self, time_s: float) -> Array:
        then = [o.at(time_s) for o in self._moving]
        return np.array([[*o.position_m, *o.quaternion_wxyz] for o in then]).reshape(-1, 7)
