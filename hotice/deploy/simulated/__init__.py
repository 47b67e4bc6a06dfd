"""A simulated robot behind the robot's own messages: MuJoCo at 500 Hz, its sensors, its gamepad, its gantry."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.deploy.simulated.config import SimulatedRobotConfig
    from hotice.deploy.simulated.living_clock import LivingClock
    from hotice.deploy.simulated.robot import SimulatedRobot
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = ["LivingClock", "SimulatedRobot", "SimulatedRobotConfig"]
