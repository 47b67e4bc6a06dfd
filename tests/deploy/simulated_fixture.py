"""Simulated robots in lock step with the test that commands them."""

from __future__ import annotations

from functools import cache

import numpy as np

from hotice.deploy.command import LIMITS, CheckedCommand
from hotice.deploy.estimate import SeenPose
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.simulated import LivingClock, SimulatedRobot, SimulatedRobotConfig
from hotice.deploy.sources import MemorySource, MoverSample, PoseSample, TagSample
from hotice.model import builder, g1
from hotice.model.carry import CarryState, solve_carry
from hotice.model.frames import quat_conj, quat_mul, quat_rotate
from hotice.model.objects import Box

STEP_S = 0.002


@cache
def carry(box: tuple[float, float, float, float]) -> CarryState:
    return solve_carry(Box(box[:3], box[3]))


class Lab:
    """A robot, a link to it and their clock."""

    def __init__(self, *, scene=None, **config) -> None:
        self.config = SimulatedRobotConfig(**{"noise": "none", **config})
        self.clock = LivingClock()
        self.bus = MemoryBus(self.clock)
        self.link = self.bus.link()
        self.poses = MemorySource(self.clock, PoseSample.decode)
        self.tags = MemorySource(self.clock, TagSample.decode)
        self.movers = MemorySource(self.clock, MoverSample.decode)
        self.robot = SimulatedRobot(
            self.config,
            self.bus.robot(),
            pose=self.poses,
            tags=self.tags,
            movers=self.movers,
            carry=carry(self.config.box),
            scene=scene,
        )
        self.world = self.robot.world
        self.clock.every_step(self.robot.step)

    def state(self):
        received = self.link.state()
        assert received is not None
        return received.record

    def pelvis(self, *_) -> SeenPose:
        """Where the pelvis truly is: a `Look` of an estimator."""
        pelvis = self.world.data.body(g1.ROOT_BODY)
        return SeenPose(pelvis.xpos.copy(), pelvis.xquat.copy(), self.clock.now())

    def box(self, *_) -> SeenPose:
        """The object seen from there."""
        pelvis, box = (self.world.data.body(name) for name in (g1.ROOT_BODY, builder.OBJECT_BODY))
        back = quat_conj(pelvis.xquat)
        return SeenPose(quat_rotate(back, box.xpos - pelvis.xpos), quat_mul(back, box.xquat), self.clock.now())

    def live(self, seconds: float, command: CheckedCommand | None = None) -> None:
        """Lives on under one command, sent anew every 2 ms, or under none."""
        for _ in range(round(seconds / STEP_S)):
            # before the first state nothing can be sent
            if self.link.state() is not None and command is not None:
                self.link.publish(command)
            self.clock.sleep(STEP_S)

    def holding(self) -> CheckedCommand:
        """What holds the carry state."""
        told = self.world.holding()
        return CheckedCommand(
            q=np.clip(told.q, LIMITS.lower, LIMITS.upper),
            dq=told.dq,
            tau=told.tau,
            kp=LIMITS.kp,
            kd=told.kd,
            enabled=np.ones(29, bool),
        )


def command(**values) -> CheckedCommand:
    """All motors on, everything else zero but for `values`."""
    zero = {name: np.zeros(29) for name in ("q", "dq", "tau", "kp", "kd")}
    return CheckedCommand(**{**zero, "enabled": np.ones(29, bool), **values})
