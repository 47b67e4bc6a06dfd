"""Sources of perturbation of students and of evaluation, each of which can be switched off to see what it costs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from hotice.errors import UnknownName
from hotice.model.dynamics import DynamicsConfig
from hotice.task.config import TaskConfig
from hotice.task.sensing import SensingConfig

SENSED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "sensor-noise": ("joint_pos_rad", "joint_vel_rad_s", "gravity", "gyro_rad_s", "root_pos_m", "root_yaw_rad"),
        "object-noise": ("object_pos_m", "object_rot_rad", "object_filter_s"),
        "delay": ("action_delay_s", "sensor_delay_steps"),
        "root-rate": ("root_hz", "root_tracking"),
    }
)
"""Fields of `SensingConfig` that a source stands for; with the noise of the object goes the filter against it."""
SOURCES = (*SENSED, "pushes", "dynamics")


def without(task: TaskConfig, sources: Iterable[str], nominal: DynamicsConfig | None = None) -> TaskConfig:
    """The task without these sources of perturbation; `nominal`: robots without "dynamics". Raises `UnknownName`."""
    for source in sources:
        if source in SENSED:
            exact = {name: getattr(SensingConfig(), name) for name in SENSED[source]}
            task = replace(task, sensing=replace(task.sensing, **exact))
        elif source == "pushes":
            task = replace(task, push_m_s=0.0)
        elif source == "dynamics":
            task = replace(task, dynamics=nominal or DynamicsConfig())
        else:
            raise UnknownName("source of perturbation", source, SOURCES)
    return task
