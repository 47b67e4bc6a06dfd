"""What happens: physics backends, the transport task and its tables."""

from typing import TYPE_CHECKING, Any

from hotice.sim.env import Step, TransportEnv
from hotice.task.config import TaskConfig
from hotice.task.presets import PRESETS

if TYPE_CHECKING:
    from hotice.sim.vector_env import HoticeVectorEnv

__all__ = ["PRESETS", "HoticeVectorEnv", "Step", "TaskConfig", "TransportEnv"]


def __getattr__(name: str) -> Any:
    if name == "HoticeVectorEnv":  # imports gymnasium
        from hotice.sim.vector_env import HoticeVectorEnv

        return HoticeVectorEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
