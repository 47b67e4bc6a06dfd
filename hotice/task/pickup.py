"""The pick-up in numbers: what of the task is another than when carrying, and what is lost of the object's pose."""

from __future__ import annotations

from dataclasses import fields, replace

from hotice.model.dynamics import ROBOT_DYNAMICS
from hotice.task.config import TaskConfig
from hotice.task.rules import HELD_S
from hotice.task.sensing import STUDENT_SENSING

PICKUP: dict[str, float | int] = {
    "physics_dt_s": 0.002,
    "substeps": 10,
    "episode_s": 17.0,
    "leg_scale_rad": 0.4,
    "arm_scale_rad": 0.65,
    "joint_noise_rad": 0.01,
}
"""Defaults of the pick-up where they are not those of `TaskConfig`. Fine physics, because objects creep out of the
palms in coarse physics before they are lifted; larger actions, because arms come from beside the body and legs from a
crouch; 17 s for ten of motion and five of holding."""
OBJECT_FILTER_S = 0.5
"""Time constant of the filter of the object's pose, in the frame of the feet, where an object on its support rests."""
LOST_EVERY_S, LOST_S = 2.5, 0.5
"""Mean time between losses of the object's pose, and the longest of them (ours); the last estimate counts meanwhile."""


def pickup_task(task: TaskConfig) -> TaskConfig:
    """The task with the defaults of the pick-up where it has those of carrying."""
    usual = {f.name: getattr(TaskConfig(), f.name) for f in fields(TaskConfig)}
    task = replace(task, **{n: v for n, v in PICKUP.items() if getattr(task, n) == usual[n]})
    if task.sensing.object_filter_s:
        task = replace(task, sensing=replace(task.sensing, object_filter_s=OBJECT_FILTER_S))
    return task


def perturbed(task: TaskConfig) -> TaskConfig:
    """A task of the pick-up under the sensing of students and the dynamics of the protocol `robot`; nobody pushes.

    Physics is fine already: palms need no friction that stands for creep.
    """
    sensing = replace(STUDENT_SENSING, object_filter_s=OBJECT_FILTER_S)
    return replace(task, sensing=sensing, dynamics=ROBOT_DYNAMICS)


def shortest_s(steps: int, control_dt_s: float) -> float:
    """Shortest episode in which a pick of so many steps can succeed [s]."""
    return steps * control_dt_s + HELD_S
