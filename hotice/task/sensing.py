"""Sensing of the robot's own state and the object's: noise, delays and refresh rate of its sensors, in numbers.

The delay model: each episode draws two delays and keeps them. Motors: an action arrives 0 to `action_delay_s` late, in
whole physics steps; until then they hold the target before. Sensors: in a share `LATE_SHARE` of episodes the policy
reads what was measured one control step before, but for `KNOWN_ROWS`, which nobody measures; the first measurement of
an episode is read at once.

`hotice.sim.sensing` (and `TransportEnv._advance`) apply all this to a batch, `hotice.systems.sensor_model` (and
`hotice.systems.policy`) to one robot in a diagram; the numbers and rules are here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hotice import checks
from hotice.checks import Range

LATE_SHARE = 0.5
"""Share of episodes whose measurements come a control step late, where `sensor_delay_steps` is 1 (ours)."""
KNOWN_ROWS = ("last_action", "clock", "carry_pos", "object_size", "history")
"""Rows of the policy observation that no sensor measures now: they are never late. The history keeps what was read."""


@dataclass(frozen=True, kw_only=True)
class SensingConfig:
    """Uniform noise of half width as named, delays and the rate of the root pose. Zero: none."""

    joint_pos_rad: float = 0.0
    """Joint angles (CAT: 0.03)."""
    joint_vel_rad_s: float = 0.0
    """Joint velocities (CAT: 1.5)."""
    gravity: float = 0.0
    """Components of the gravity direction (CAT: 0.05)."""
    gyro_rad_s: float = 0.0
    """Angular velocity of the pelvis (CAT: 0.2)."""
    object_pos_m: float = 0.0
    """Position of the object seen from the pelvis (CAT: 0.05)."""
    object_rot_rad: float = 0.0
    """Orientation of the object about each axis (CAT: 5 degrees)."""
    object_filter_s: float = 0.0
    """Time constant of the low-pass filter of the object's pose, in the pelvis frame, where a carried object hardly
    moves; the first measurements of an episode are averaged (ours: 0.2; 0: every measurement is taken as it comes)."""
    root_pos_m: float = 0.0
    """Position of the root in the scene, its height too (ours: 0.02)."""
    root_yaw_rad: float = 0.0
    """Heading of the root in the scene (ours: 0.03)."""
    root_hz: float = 0.0
    """Rate at which the root's place and heading are refreshed (CAT: 10); 0: with every step."""
    root_tracking: bool = False
    """Whether the root moves on between refreshes: with a tracked velocity (alpha-beta filter) and turned by the gyro
    (ours). Otherwise it stands where it was last seen, up to 7 cm behind a walking robot."""
    action_delay_s: float = 0.0
    """Longest delay from observation to motor, drawn for each episode in physics steps (ours: 0.02)."""
    sensor_delay_steps: int = 0
    """Longest delay of what is measured, drawn for each episode in control steps (ours: 1)."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.NOT_NEGATIVE, but=("root_tracking",))
        checks.flag("root_tracking", self.root_tracking)
        checks.whole("sensor_delay_steps", self.sensor_delay_steps, Range(least=0, most=1))

    @property
    def exact(self) -> bool:
        """Whether the actor reads the truth."""
        return not any(vars(self).values())

    def hold_steps(self, control_dt_s: float) -> int:
        """Control steps from one refresh of the root's place and heading to the next."""
        return max(1, round(1.0 / (self.root_hz * control_dt_s))) if self.root_hz else 1

    def object_gain(self, control_dt_s: float) -> float:
        """Weight of the newest pose of the object in its filter, 1 without one; larger in the first steps."""
        return min(1.0, control_dt_s / self.object_filter_s) if self.object_filter_s else 1.0

    def longest_delay(self, control_dt_s: float, substeps: int) -> int:
        """Most physics steps before an action reaches the motors, at most the `substeps` of a control step."""
        return min(substeps, round(self.action_delay_s * substeps / control_dt_s))


def draw_delays(config: SensingConfig, control_dt_s: float, substeps: int, seed: int) -> tuple[bool, float]:
    """Whether measurements of an episode come one control step late, and its time from action to motor [s].

    `substeps`: physics steps of a control step, the unit in which the latter is drawn.
    """
    rng = np.random.Generator(np.random.Philox(key=seed))
    late = bool(rng.random() < LATE_SHARE) if config.sensor_delay_steps else False
    return late, int(rng.integers(0, config.longest_delay(control_dt_s, substeps) + 1)) * control_dt_s / substeps


def reads_late(late: Any, count: Any) -> Any:
    """Whether measurement `count` of an episode, from 1, is read late, where `late` was drawn; of one robot or many."""
    return late & (count > 1)


TRACK_PLACE, TRACK_VELOCITY, TRACK_HEADING = 0.7, 0.5, 0.5
"""Gains of the root's filter: how much of the difference from the prediction place, velocity and heading take over.
Chosen on recorded walks of 64 robots through bench20: 1.5 cm and 0.017 rad off (root mean square); a held root: 3.0 cm,
0.046 rad."""

TRACK_TILT = 0.1
"""Share of its difference from the measured one that the direction of gravity takes over at each step; in between it is
turned by the gyro (complementary filter). On walks through bench20: 0.7 degrees off (root mean square); a reading
alone: 2.3 degrees."""

STUDENT_SENSING = SensingConfig(
    joint_pos_rad=0.03,
    joint_vel_rad_s=1.5,
    gravity=0.05,
    gyro_rad_s=0.2,
    object_pos_m=0.05,
    object_rot_rad=0.087,
    object_filter_s=0.2,
    root_pos_m=0.02,
    root_yaw_rad=0.03,
    root_hz=10.0,
    root_tracking=True,
    action_delay_s=0.02,
    sensor_delay_steps=1,
)
"""Sensing that students are trained and evaluated under."""
