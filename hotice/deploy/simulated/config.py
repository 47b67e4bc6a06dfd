"""Choices about a simulated robot, and the names of those that no public source settles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from hotice import checks
from hotice.checks import Range
from hotice.deploy.messages.hg import ABSENT
from hotice.deploy.simulated.mishaps import Mishap
from hotice.deploy.simulated.move import Move
from hotice.deploy.simulated.remote import Press
from hotice.errors import InvalidConfig
from hotice.model.objects import Box
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

Start = Literal["standing", "held"]
Silence = Literal["hold", "limp", "damp"]
WHOLE_MACHINES = tuple(machine for machine, absent in ABSENT.items() if not absent)
"""Machines with all 29 motors. Gears and torques are those of machine 5, whichever the robot says it is."""


@dataclass(frozen=True, kw_only=True)
class SimulatedRobotConfig:
    """A simulated robot, its object and where they start. Raises `InvalidConfig`."""

    scene: str = "open_floor"
    """Scene name or file."""
    box: tuple[float, float, float, float] = (0.30, 0.30, 0.25, 1.5)
    """The object: size along x, y and z [m], mass [kg]."""
    start: Start = "standing"
    """- standing: on the floor in the carry state, the object in its hands; it holds itself and is steadied until the
    first command that turns a motor on.
    - held: hanging from a gantry with its motors off, the object kept aside; key F2 lowers the gantry, key F1 parts
    the palms and holds the object between them, pressed again lets it go."""
    noise: Literal["none", "trained"] = "trained"
    """Noise of what is sensed: none, or what students are trained and evaluated under."""
    delays: Literal["none", "trained"] = "none"
    """Delay of states and commands beside those of the link: none, or drawn by the seed as in training (states 0 or
    20 ms, commands 0 to 20 ms)."""
    dynamics: Literal["nominal", "drawn"] = "nominal"
    """The robot: the middle one of the evaluation protocol `robot`, or one drawn from it by the seed."""
    silence: Silence = "hold"
    """Motors when commands stop, which is not known of the real robot: hold the last command (worst for whoever
    relies on more), go limp, or damp (kp 0, kd 8)."""
    silence_after_s: float = 0.1
    """So long without a valid command are commands said to have stopped [s] (ours)."""
    machine: int = 5
    """`mode_machine` of states; commands with another one are dropped."""
    battery_percent: float = 80.0
    """Charge at the start [percent]."""
    localized_in: Literal["scene", "scan"] = "scene"
    """The map whose frame localization speaks in: the one that the scene was imported from (without one the scene's own
    frame), or the one that `hotice scene scan` makes of the scene."""
    drift_m_s: float = 0.0
    """Speed at which localization drifts away, in a direction drawn by the seed [m/s]."""
    fault: tuple[str, ...] = ()
    """What goes wrong and when: NAME@STARTs, or NAME@STARTs+DURATIONs, for example tag-loss@3s or tick-frozen@4s+0.5s.
    push and battery-low take none. Names: state-silent, state-lost, state-late, state-doubled, state-bad-crc,
    state-nan, tick-frozen, push, second-publisher, remote-loss, battery-low, motor-hot, motor-error, encoder-jump,
    joints-swapped, tag-loss, tag-foreign, pose-loss, pose-frozen, pose-jump, pose-turn, pose-nan, movers-loss,
    movers-nan."""
    motions_from_s: float | None = None
    """When the motions of the scene's obstacles begin [s]; without it with the gamepad's R1+X, which begins the carry.
    Until then they are where they begin."""
    press: tuple[str, ...] = ()
    """Keys of the gamepad pressed for 0.2 s, or longer: KEYS@STARTs, or KEYS@STARTs+DURATIONs, for example L2+B@4s."""
    move: tuple[str, ...] = ()
    """Joints that somebody moves by hand, there and back within 2 s, for `hotice robot-check --joints`: JOINT@STARTs,
    or all@STARTs for each in turn. Until the last one all others are kept still, as a real robot's gears keep them."""
    seed: int = 0
    """Seed of noise, delays, the drawn robot and faults."""

    def __post_init__(self) -> None:
        checks.vector("box", self.box, 4, checks.POSITIVE)
        checks.one_of("start", self.start, ("standing", "held"))
        checks.one_of("noise", self.noise, ("none", "trained"))
        checks.one_of("delays", self.delays, ("none", "trained"))
        checks.one_of("dynamics", self.dynamics, ("nominal", "drawn"))
        checks.one_of("silence", self.silence, ("hold", "limp", "damp"))
        checks.number("silence_after_s", self.silence_after_s, checks.POSITIVE)
        checks.one_of("localized_in", self.localized_in, ("scene", "scan"))
        if self.machine not in WHOLE_MACHINES:
            raise InvalidConfig(
                f"machine is {checks.shown(self.machine)}: simulated are those with 29 motors, "
                f"{', '.join(map(str, WHOLE_MACHINES))}"
            )
        checks.number("battery_percent", self.battery_percent, Range(least=0, most=100, unit="percent"))
        checks.number("drift_m_s", self.drift_m_s, checks.NOT_NEGATIVE)
        if self.motions_from_s is not None:
            checks.number("motions_from_s", self.motions_from_s, checks.NOT_NEGATIVE)
        checks.whole("seed", self.seed, checks.INT64)
        # read once for what they raise
        _ = self.mishaps, self.presses, self.moves

    @property
    def carried(self) -> Box:
        """The object."""
        return Box(self.box[:3], self.box[3])

    @property
    def sensing(self) -> SensingConfig:
        """Noise in numbers."""
        return STUDENT_SENSING if self.noise == "trained" else SensingConfig()

    @property
    def mishaps(self) -> tuple[Mishap, ...]:
        """What goes wrong. Raises `UnknownName`, `InvalidConfig`."""
        return tuple(Mishap.parse(text) for text in self.fault)

    @property
    def moves(self) -> list[Move]:
        """Joints moved by hand. Raises `UnknownName`, `InvalidConfig`."""
        return [move for text in self.move for move in Move.parse(text)]

    @property
    def presses(self) -> tuple[Press, ...]:
        """Keys and when. Raises `UnknownName`, `InvalidConfig`."""
        return tuple(Press.parse(text) for text in self.press)
