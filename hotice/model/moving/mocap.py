"""Places of what moves in a MuJoCo model of a scene, whose mocap bodies are its moving obstacles in their order."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from hotice.model.scene import Obstacle


def place_moving(data: mujoco.MjData, moving: Sequence[Obstacle], time_s: float) -> None:
    """Puts the mocap bodies where the obstacles `moving`, all that move in the model's scene, are at `time_s` [s]."""
    for m, obstacle in enumerate(moving):
        then = obstacle.at(time_s)
        data.mocap_pos[m], data.mocap_quat[m] = then.position_m, then.quaternion_wxyz
