"""The simulation: physics backends, the transport task and its tables."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.sim.batch_env import Step
    from hotice.sim.carry_bank import CarryBank
    from hotice.sim.env import TransportEnv
    from hotice.sim.observations import Observation, ObservationTable
    from hotice.sim.rewards import REWARDS, Reward, RewardTable
    from hotice.sim.snapshot import Snapshot
    from hotice.sim.terminations import TERMINATIONS, Termination
    from hotice.sim.vector_env import HoticeVectorEnv
    from hotice.task.config import TaskConfig
    from hotice.task.presets import PRESETS
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "CarryBank",
    "HoticeVectorEnv",
    "Observation",
    "ObservationTable",
    "PRESETS",
    "REWARDS",
    "Reward",
    "RewardTable",
    "Snapshot",
    "Step",
    "TERMINATIONS",
    "TaskConfig",
    "Termination",
    "TransportEnv",
]
