"""The simulated robot: states out and commands in over a `RobotEnd`, a world in between, 500 times a second.

What it does where the real robot is not known has names in `SimulatedRobotConfig`. Commands that do not open, of a bad
checksum or for another machine, are dropped by the robot's end of the link, and counted there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from hotice.deploy.command import DAMPING_KD
from hotice.deploy.link.protocol import RobotEnd
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.simulated.config import SimulatedRobotConfig
from hotice.deploy.simulated.gantry import Gantry
from hotice.deploy.simulated.handing import Handing
from hotice.deploy.simulated.lidar_map import map_in_scene
from hotice.deploy.simulated.mishaps import Mishaps
from hotice.deploy.simulated.motors import LIMP, MotorCommand
from hotice.deploy.simulated.moving import Moving
from hotice.deploy.simulated.outgoing_states import OutgoingStates
from hotice.deploy.simulated.remote import SimulatedRemote
from hotice.deploy.simulated.senses.localization import Localization, MapPlace
from hotice.deploy.simulated.senses.mover_sight import MoverSight
from hotice.deploy.simulated.senses.states import StateWriter
from hotice.deploy.simulated.senses.tag_sight import CORNER_PX, LATENCY_S, TagSight
from hotice.deploy.simulated.start import hang
from hotice.deploy.simulated.story import Story
from hotice.deploy.simulated.suffering import Suffering
from hotice.deploy.simulated.world import STEP_S, World
from hotice.deploy.sources.protocol import Sender
from hotice.deploy.tags import box_bundle
from hotice.model.carry import CarryState, solve_carry
from hotice.model.scene import Scene
from hotice.model.shipped import load_scene
from hotice.task.protocols import get_protocol
from hotice.task.sensing import STUDENT_SENSING, draw_delays

GIVE_KEY, LOWER_KEY = "F1", "F2"
"""Keys of the gamepad by which whoever stands beside the robot gives it the object, and lowers the gantry."""
CARRY_KEYS = frozenset({"R1", "X"})
"""Keys that begin the carry; by default the motions of the scene begin with them."""
OWN_CONTROLLER = "ai"
LOOK_STEPS = 5
"""Steps from one look for the story to the next."""
LATE_STEPS = 10
"""A control step, by which states come late in half of all episodes."""
DAMPED = LIMP._replace(kd=np.full(29, DAMPING_KD), on=np.ones(29, bool))


@dataclass(frozen=True, kw_only=True)
class DrawnRobot:
    """A robot and its delays that were drawn elsewhere, in place of those that the configuration draws."""

    change: Callable[[mujoco.MjModel], mujoco.MjModel]
    """Makes the nominal model of 29 joints this robot."""
    late: bool
    """Whether states come a control step late."""
    command_delay_s: float
    """From a command's arrival until the motors obey [s]."""


class SimulatedRobot:
    """Lives in steps of 2 ms: `step` after each of them has passed on the clock (see `LivingClock`).

    Attributes:
        world: robot, object and scene. remote: its gamepad. gantry: what holds or steadies it. handing: the object.
        states: what it says of itself, its battery too. localization, sight, mover_sight: its sources, None without a
            sender.
        story: what happened to it so far.
        steps: how many it has lived. epoch_s: its start on the clock by which its sources stamp [s].
    """

    def __init__(
        self,
        config: SimulatedRobotConfig,
        end: RobotEnd,
        *,
        pose: Sender | None = None,
        tags: Sender | None = None,
        movers: Sender | None = None,
        carry: CarryState | None = None,
        scene: Scene | None = None,
        drawn: DrawnRobot | None = None,
    ) -> None:
        """Puts it at its start.

        Args:
            config: choices about it.
            end: the robot's end of a link.
            pose, tags, movers: take the samples of localization (`PoseSample`), of the head camera (`TagSample`), and
                of who sees what moves (`MoverSample`), where something does.
            carry: how it holds the configuration's box; default: `solve_carry`.
            scene: default: the configuration's.
            drawn: default: by the configuration's `dynamics` and `delays`.

        Raises:
            HoticeError: no such scene, or a box that it cannot hold, or too small for tags
        """
        self.config, self.end, self.steps, self.epoch_s = config, end, 0, 0.0
        protocol = get_protocol("robot")
        self.world = World(
            carry or solve_carry(config.carried),
            scene or load_scene(config.scene),
            protocol,
            protocol.dynamics if config.dynamics == "drawn" else protocol.nominal,
            config.seed,
            None if drawn is None else drawn.change,
        )
        held = config.start == "held"
        if held:
            hang(self.world)
        self.gantry, self.handing = Gantry(self.world), Handing(self.world, "aside" if held else "gone")
        self.remote = SimulatedRemote()
        self.told = LIMP if held else self.world.holding()
        """What the motors do now."""
        self._own = not held
        self.world.motors.command(self.told)
        self._open_senses(pose, tags, movers, drawn)
        self._due: deque[tuple[float, MotorCommand]] = deque()
        self._heard = 0
        self.story = Story()
        self._moving = Moving(self.world, config.moves)
        self._keys_before: frozenset[str] = frozenset()
        self._presses = deque(sorted(config.presses, key=lambda press: press.from_s))

    def _open_senses(
        self, pose: Sender | None, tags: Sender | None, movers: Sender | None, drawn: DrawnRobot | None
    ) -> None:
        config, world = self.config, self.world
        late, self._command_delay_s = False, 0.0
        if drawn is not None:
            late, self._command_delay_s = drawn.late, drawn.command_delay_s
        elif config.delays == "trained":
            late, self._command_delay_s = draw_delays(STUDENT_SENSING, LATE_STEPS * STEP_S, LATE_STEPS, config.seed)
        late_steps = LATE_STEPS if late else 0
        self.states = StateWriter(world, config.sensing, config.machine, config.battery_percent, self._rng(2))
        mishaps = Mishaps(config.mishaps)
        self._suffering = Suffering(mishaps, config.seed, config.machine)
        self._outgoing = OutgoingStates(self.end, late_steps, mishaps.of_states(), config.seed)
        self.localization = self.sight = self.mover_sight = None
        place = MapPlace(map_in_scene(world.scene)) if config.localized_in == "scan" else None
        if movers is not None and world.scene.moving:
            self.mover_sight = MoverSight(world, movers, place=place)
        if pose is not None:
            self.localization = Localization(
                world,
                pose,
                config.sensing,
                self._rng(4),
                place=place,
                drift_m_s=config.drift_m_s,
                latency_s=late_steps * STEP_S,
            )
        if tags is not None:
            self.sight = TagSight(
                world,
                box_bundle(config.carried),
                tags,
                self._rng(5),
                corner_px=0.0 if config.noise == "none" else CORNER_PX,
                latency_s=0.0 if config.delays == "none" else LATENCY_S,
            )

    @property
    def time_s(self) -> float:
        """Since the start [s]."""
        return self.steps * STEP_S

    @property
    def controller(self) -> str:
        """Name of its own controller, which holds it at the start `standing` until it is released or commanded."""
        return OWN_CONTROLLER if self._own else ""

    @property
    def failure(self) -> str:
        """A fall, or a drop of an object that it was given, by its name in `hotice.task.rules`; empty for none."""
        failure = self.world.failure
        return "" if failure == "drop" and self.handing.stage != "gone" else failure

    def told_story(self) -> list[tuple[str, str]]:
        """What happened so far, as lines of a table."""
        return self.story.in_words(self.world, self.failure, self.handing.stage)

    def release(self) -> None:
        """Releases its own controller: limp at once, as the real one; what steadies it does so until a command."""
        if self._own:
            self._own = False
            self.told = LIMP
            self.world.motors.command(LIMP)

    def press(self, *keys: str, for_s: float = 0.2) -> None:
        """Presses keys of the gamepad. Raises `UnknownName`."""
        self.remote.press(keys, self.time_s, for_s=for_s)

    def step(self) -> None:
        """Hears the newest command, lives 2 ms with it, publishes a state. Raises `SimulationError`, `LinkError`."""
        self._suffering.of_body(self.time_s, self.world, self.end)
        self._hear()
        self._help()
        self.gantry.act()
        self.handing.act()
        self._moving.act(self.time_s, self.told)
        self.world.step()
        self.steps += 1
        self._suffering.of_states(self.time_s, self.states, self.remote)
        state = self.states.write(self.remote.bytes(self.time_s), np.asarray(self.told.on, bool))
        self._outgoing.send(state, self.time_s)
        self._suffering.of_sources(self.time_s, self.localization, self.sight, self.mover_sight)
        for sensor in (self.localization, self.sight, self.mover_sight):
            if sensor is not None:
                sensor.live(self.time_s, self.epoch_s + self.time_s)
        if self.steps % LOOK_STEPS == 0:
            self.story.see(self.time_s, self.world, self.failure, self.handing.stage)

    def _hear(self) -> None:
        received = self.end.command()
        if received is not None and received.sequence != self._heard:
            self._heard = received.sequence
            motors = received.record["motor_cmd"][JOINTS]
            told = MotorCommand(
                q=motors["q"],
                dq=motors["dq"],
                tau=motors["tau"],
                kp=motors["kp"],
                kd=motors["kd"],
                on=motors["mode"] == 1,
            )
            self._due.append((self.time_s + self._command_delay_s, told))
        while self._due and self._due[0][0] <= self.time_s + 1e-9:
            self._obey(self._due.popleft()[1])
        if received is not None and received.age_s > self.config.silence_after_s:
            self._be_silent()

    def _obey(self, told: MotorCommand) -> None:
        if self.config.start == "standing" and np.any(told.on):
            self.gantry.let_go()
        self._own = False
        self.told = told
        self.world.motors.command(told)

    def _be_silent(self) -> None:
        told = {"hold": self.told, "limp": LIMP, "damp": DAMPED}[self.config.silence]
        if told is not self.told:
            self.told = told
            self.world.motors.command(told)

    def _help(self) -> None:
        while self._presses and self._presses[0].from_s <= self.time_s + 1e-9:
            press = self._presses.popleft()
            self.remote.press(press.keys, self.time_s, for_s=press.for_s)
        keys = self.remote.pressed(self.time_s)
        new, self._keys_before = keys - self._keys_before, keys
        if GIVE_KEY in new:
            self.handing.go_on()
        if LOWER_KEY in new:
            self.gantry.lower()
        from_s = self.config.motions_from_s
        if keys >= CARRY_KEYS if from_s is None else self.time_s >= from_s - 1e-9:
            self.world.movers.begin()

    def _rng(self, stream: int) -> np.random.Generator:
        return np.random.default_rng([self.config.seed, stream])
