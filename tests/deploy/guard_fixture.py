"""A guard in simulated time: a robot of 29 joints that move by themselves, and a runner that is a function."""

import copy
import dataclasses
from functools import cache

import numpy as np

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.guard import Guard
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.messages.hg import LOW_STATE
from hotice.deploy.messages.remote import encode_remote
from hotice.deploy.slot.records import TARGETS
from hotice.model import g1
from hotice.model.joint_limits import torque_limits

DT_S = 0.002
INERTIA = 0.5
POSTURE = np.where([j.endswith("knee_joint") for j in g1.ALL_JOINTS], 0.5, 0.05)
TORQUE = torque_limits()
FAST = GuardConfig(posture_s=1.0)


def untouched(state):
    """A state as the robot made it."""


@cache
def _led(mode):
    return Bench().to(mode)


def bench_in(mode):
    """A bench of its own, of which the way to the mode was made once."""
    return copy.deepcopy(_led(mode))


class Bench:
    """Robot, bus, runner and guard; `ticks` runs them all."""

    def __init__(self, config=None, *, machine=5, seed=0, link=lambda link: link, **bus):
        self.clock = SimulatedClock()
        self.bus = MemoryBus(self.clock, seed=seed, **bus)
        self.link, self.robot = link(self.bus.link()), self.bus.robot()
        self.state = LOW_STATE.zeros()
        self.state["mode_machine"] = machine
        self.state["imu_state"]["quaternion"][0] = 1.0
        self.state["motor_state"]["temperature"] = 40
        self.q, self.dq = np.zeros(29), np.zeros(29)
        self.silent = False
        self.keys = ()
        self.charge = 80.0
        self.wishes = set()
        self.targets = np.zeros((), TARGETS)
        self.targets["q"], self.targets["warm"] = POSTURE, 1
        self.runner_runs = True
        self.slot = None
        self.status = None
        self.events = []
        self.sent = []
        self.worst_torque = np.zeros(29)
        self.count = 0
        self.edit = untouched
        # methods, not lambdas: a copy of the bench must not ask this one
        self.guard = Guard(
            self.link,
            self._read,
            self._told,
            self.clock,
            config or FAST,
            wishes=self._asked,
            charge=self._charge,
            on_event=self._event,
        )

    def ticks(self, count):
        for _ in range(count):
            self._robot()
            if self.runner_runs and self.count % 10 == 0:
                self.put()
            self.sent.append(self.guard.tick())
            self.clock.sleep(DT_S)
            self.count += 1
        return self.guard.mode

    def seconds(self, seconds):
        return self.ticks(round(seconds / DT_S))

    def put(self, **fields):
        """The runner's next targets."""
        self.targets["number"] += 1
        self.targets["stamp_s"] = self.clock.now()
        record = self.targets.copy()
        for name, value in fields.items():
            record[name] = value
        self.slot = record

    def ask(self, request):
        self.wishes = {Request(request)}
        return self.ticks(1)

    def to(self, mode):
        """Leads the guard to a mode by wishes."""
        self.ticks(300)
        for request, after_s in (
            ("start", 0.1),
            ("posture", self.guard.config.posture_s + 0.1),
            ("carry", 0.1),
            ("hold", 0.1),
            ("lower", 0.1),
        ):
            if self.guard.mode is mode:
                break
            self.ask(request)
            if self.guard.mode is not mode:
                self.seconds(after_s)
        assert self.guard.mode is mode, self.events
        return self

    def until_damping(self, most=1000):
        """Ticks until the guard damps, and the time of that [s]."""
        for i in range(most):
            if self.guard.mode is Mode.DAMPING:
                return i * DT_S
            self.ticks(1)
        raise AssertionError(f"no damping: {self.guard.mode!r}")

    def _asked(self):
        asked, self.wishes = self.wishes, set()
        return asked

    def _read(self):
        return self.slot

    def _charge(self):
        return self.charge

    def _event(self, event):
        self.events.append(event)

    def _told(self, status):
        self.status = status.copy()

    def _robot(self):
        command = self.robot.command()
        torque = np.zeros(29)
        if command is not None:
            motors = command.record["motor_cmd"][:29]
            torque = motors["tau"] + motors["kp"] * (motors["q"] - self.q) + motors["kd"] * (motors["dq"] - self.dq)
            torque = np.where(motors["mode"] == 1, torque, 0.0)
            self.worst_torque = np.maximum(self.worst_torque, np.abs(torque))
        self.dq = (self.dq + DT_S / INERTIA * np.clip(torque, -TORQUE, TORQUE)) * 0.999
        self.q = self.q + DT_S * self.dq
        if self.silent:
            return
        self.state["tick"] += 2
        self.state["motor_state"]["q"][:29], self.state["motor_state"]["dq"][:29] = self.q, self.dq
        # a gamepad at rest differs from none by its sticks' noise
        self.state["wireless_remote"] = 0 if self.keys is None else encode_remote(self.keys)
        if self.keys == ():
            self.state["wireless_remote"][0] = 0x55
        state = self.state.copy()
        self.edit(state)
        self.robot.publish_state(state)


def with_limits(**limits):
    config = GuardConfig()
    return dataclasses.replace(config, limits=dataclasses.replace(config.limits, **limits))
