"""The task: rules, numbers, presets, perturbations, sensing, scan and history. NumPy and mujoco only."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.task.config import TaskConfig
    from hotice.task.judge import Judge
    from hotice.task.policy_task import PolicyTask
    from hotice.task.presets import DUAL, PRESETS, SINGLE, Preset, get_preset
    from hotice.task.protocols import PROTOCOLS, Protocol, get_protocol
    from hotice.task.rules import OUTCOMES, arrived, dropped, fallen
    from hotice.task.sensing import STUDENT_SENSING, SensingConfig
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "DUAL",
    "Judge",
    "OUTCOMES",
    "PRESETS",
    "PROTOCOLS",
    "PolicyTask",
    "Preset",
    "Protocol",
    "SINGLE",
    "STUDENT_SENSING",
    "SensingConfig",
    "TaskConfig",
    "arrived",
    "dropped",
    "fallen",
    "get_preset",
    "get_protocol",
]
