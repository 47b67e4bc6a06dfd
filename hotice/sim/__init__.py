"""What happens: physics backends, the transport task and its tables."""

from hotice.sim.config import PRESETS, TaskConfig
from hotice.sim.env import Step, TransportEnv

__all__ = ["PRESETS", "Step", "TaskConfig", "TransportEnv"]
