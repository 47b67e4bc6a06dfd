"""The simulated robot: states out and commands in over a `RobotEnd`, a world in between, 500 times a second.

What it does where the real robot is not known has names in `SimulatedRobotConfig`. Commands that do not open, of a bad
checksum or for another machine, are dropped by the robot's end of the link, and counted there.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from hotice.deploy.command import DAMPING_KD
from hotice.deploy.link.protocol import RobotEnd
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.simulated.config import SimulatedRobotConfig
from hotice.deploy.simulated.gantry import Gantry
from hotice.deploy.simulated.handing import Handing
from hotice.deploy.simulated.motors import LIMP, MotorCommand
from hotice.deploy.simulated.remote import SimulatedRemote
from hotice.deploy.simulated.states import StateWriter
from hotice.deploy.simulated.world import STEP_S, World
from hotice.model.carry import CarryState, solve_carry
from hotice.model.robot_state import RobotState
from hotice.model.scene import Scene
from hotice.model.shipped import load_scene
from hotice.task.protocols import get_protocol
from hotice.task.sensing import STUDENT_SENSING, draw_delays

GIVE_KEY, LOWER_KEY = "F1", "F2"
"""Keys of the gamepad by which whoever stands beside the robot gives it the object, and lowers the gantry."""
HANGING_M = 0.15
"""Soles above the floor at the start `held`."""
LATE_S = 0.02
DAMPED = LIMP._replace(kd=np.full(29, DAMPING_KD), on=np.ones(29, bool))


class SimulatedRobot:
    """Lives in steps of 2 ms: `step` after each of them has passed on the clock (see `LivingClock`).

    Attributes:
        world: robot, object and scene. remote: its gamepad. gantry: what holds or steadies it.
        time_s: simulated time [s]. steps: how many.
    """

    def __init__(
        self,
        config: SimulatedRobotConfig,
        end: RobotEnd,
        *,
        carry: CarryState | None = None,
        scene: Scene | None = None,
    ) -> None:
        """Puts it at its start.

        Args:
            config: choices about it.
            end: the robot's end of a link.
            carry: how it holds the object; default: `solve_carry` of the configuration's box.
            scene: default: the configuration's.

        Raises:
            HoticeError: no such scene, or a box that it cannot hold
        """
        self.config, self._end = config, end
        carry = carry or solve_carry(config.carried)
        scene = scene or load_scene(config.scene)
        self.world = World(carry, scene, get_protocol("robot"), config.drawn_from, config.seed)
        self.remote = SimulatedRemote()
        held = config.start == "held"
        if held:
            self.world.place(_hanging(self.world))
        self.gantry, self.handing = Gantry(self.world), Handing(self.world, "aside" if held else "gone")
        self._told = LIMP if held else self.world.holding()
        self.world.motors.command(self._told)
        rng = np.random.default_rng([config.seed, 2])
        self.states = StateWriter(self.world, config.sensing, config.machine, config.battery_percent, rng)
        late, self._command_delay_s = False, 0.0
        if config.delays == "trained":
            late, self._command_delay_s = draw_delays(STUDENT_SENSING, LATE_S, round(LATE_S / STEP_S), config.seed)
        self._late: deque[np.ndarray] = deque(maxlen=1 + (round(LATE_S / STEP_S) if late else 0))
        self._due: deque[tuple[float, MotorCommand]] = deque()
        self._heard = 0
        self._keys_before: frozenset[str] = frozenset()
        self.steps = 0

    @property
    def time_s(self) -> float:
        """Since the start [s]."""
        return self.steps * STEP_S

    def press(self, *keys: str, for_s: float = 0.2) -> None:
        """Presses keys of the gamepad. Raises `UnknownName`."""
        self.remote.press(keys, self.time_s, for_s=for_s)

    def step(self) -> None:
        """Hears the newest command, lives 2 ms with it, publishes a state. Raises `SimulationError`, `LinkError`."""
        self._hear()
        self._help()
        self.gantry.act()
        self.handing.act()
        self.world.step()
        self.steps += 1
        state = self.states.write(self.remote.bytes(self.time_s), np.asarray(self._told.on, bool))
        self._late.append(state)
        self._end.publish_state(self._late[0])

    def _hear(self) -> None:
        received = self._end.command()
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
        if self.config.start == "standing" and self._on(told):
            self.gantry.let_go()
        self._told = told
        self.world.motors.command(told)

    def _be_silent(self) -> None:
        told = {"hold": self._told, "limp": LIMP, "damp": DAMPED}[self.config.silence]
        if told is not self._told:
            self._told = told
            self.world.motors.command(told)

    def _help(self) -> None:
        keys = self.remote.pressed(self.time_s)
        new, self._keys_before = keys - self._keys_before, keys
        if GIVE_KEY in new:
            self.handing.go_on()
        if LOWER_KEY in new:
            self.gantry.lower()

    @staticmethod
    def _on(told: MotorCommand) -> bool:
        return bool(np.any(told.on))


def _hanging(world: World) -> RobotState:
    """Hanging with all joints at zero, `HANGING_M` above the floor."""
    start = world.start
    world.place(RobotState(p_WP=start.p_WP, joint_pos=np.zeros(29), carried=start.carried, p_WO=start.p_WO))
    x, y, yaw = world.scene.start
    height_m = start.p_WP[2] - world.lowest_sole_m + HANGING_M
    turn = np.array([np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)])
    return RobotState(
        p_WP=np.array([x, y, height_m]), quat_WP=turn, joint_pos=np.zeros(29), carried=start.carried, p_WO=start.p_WO
    )
