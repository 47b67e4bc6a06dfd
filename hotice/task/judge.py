"""The rules of the task, read from a MuJoCo state of one robot with its object."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from hotice.model import builder, g1
from hotice.task import rules


class Judge:
    """Says what is wrong with states of a model, of 20 or 29 joints, with an object and with or without obstacles.

    `fallen`: the rule for falls, `rules.fallen` or `rules.falling`.
    """

    def __init__(self, model: mujoco.MjModel, fallen: Callable[[Any, Any], Any] = rules.fallen) -> None:
        self._fallen = fallen
        self._pelvis = model.body(g1.ROOT_BODY).id
        self._hands = [model.site(name).id for name in g1.OGF_KEYPOINTS]
        start = int(model.joint("object_free").qposadr[0])
        self._object = slice(start, start + 3)
        sensors = [model.sensor(i).name for i in range(model.nsensor)]
        self._hits = [
            (int(model.sensor(name).adr[0]), outcome)
            for who, outcome in zip(builder.HIT_SENSORS, ("robot_collision", "object_collision"), strict=True)
            for name in sensors
            if name == who or name.startswith(f"{who}/")
        ]
        self._movers = [
            (int(model.sensor(name).adr[0]), name.partition("/")[2])
            for name in sensors
            if name.startswith(tuple(f"{who}/" for who in builder.HIT_SENSORS))
        ]

    def failure(self, data: mujoco.MjData) -> str:
        """A diverged state, a fall or a drop, by its name in `rules.OUTCOMES`; empty for none. Needs kinematics."""
        if rules.diverged(data.qpos, data.qvel):
            return "unstable"
        if self._fallen(data.qpos[2], data.xmat[self._pelvis][8]):
            return "fall"
        p_WO = data.qpos[self._object]
        apart_m = np.linalg.norm(p_WO - data.site_xpos[self._hands].mean(axis=0))
        return "drop" if rules.dropped(apart_m, p_WO[2]) else ""

    def collision(self, data: mujoco.MjData) -> str:
        """Whether robot or object touches an obstacle, as `failure`. Needs sensors."""
        return next((outcome for at, outcome in self._hits if data.sensordata[at] > 0), "")

    def met(self, data: mujoco.MjData) -> set[str]:
        """Names of obstacles with a motion that robot or object touches. Needs sensors."""
        return {name for at, name in self._movers if data.sensordata[at] > 0}
