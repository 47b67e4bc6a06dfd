"""A simulated robot on a network: its topics and services over DDS, its sources over UDP."""

from __future__ import annotations

import json
from dataclasses import dataclass

from hotice.deploy.clock import MonotonicClock
from hotice.deploy.dds.battery import DdsBatteryEnd
from hotice.deploy.dds.link import DdsRobot
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.dds.service import DdsServer
from hotice.deploy.simulated.config import SimulatedRobotConfig
from hotice.deploy.simulated.robot import SimulatedRobot
from hotice.deploy.sources.udp import UdpSender
from hotice.deploy.switcher import CHECK, RELEASE, SERVICE

BATTERY_STEPS = 50
"""Steps from one state of the battery to the next: 10 Hz (ours; the maker says "low")."""
SERVE_STEPS = 10
NO_SUCH_CALL = 3203


@dataclass(frozen=True, kw_only=True)
class Ports:
    """UDP ports on this machine to which localization, tags and poses of what moves are sent."""

    pose: int
    tags: int
    movers: int


class NetworkRobot:
    """Everything of one simulated robot that others see; `step` it every 2 ms, `close` it in the end."""

    def __init__(self, config: SimulatedRobotConfig, node: DdsNode, ports: Ports) -> None:
        """Joins. Raises `HoticeError`."""
        self._clock = MonotonicClock()
        self._end = DdsRobot(node)
        self._battery = DdsBatteryEnd(node)
        self._switcher = DdsServer(node, SERVICE, self._answer)
        self._senders = pose, tags, movers = [UdpSender(port) for port in (ports.pose, ports.tags, ports.movers)]
        self.robot = SimulatedRobot(config, self._end, pose=pose, tags=tags, movers=movers)

    def step(self) -> None:
        """Lives 2 ms. Raises `SimulationError`, `LinkError`."""
        # its sources stamp by this machine's clock, as programs beside the robot do
        self.robot.epoch_s = self._clock.now() - self.robot.time_s
        self.robot.step()
        if self.robot.steps % BATTERY_STEPS == 0:
            self._battery.publish(self.robot.states.battery())
        if self.robot.steps % SERVE_STEPS == 0:
            self._switcher.serve()

    def _answer(self, api_id: int, parameter: str) -> tuple[int, str]:
        if api_id == RELEASE:
            self.robot.release()
        if api_id not in (CHECK, RELEASE):
            return NO_SUCH_CALL, ""
        return 0, json.dumps({"form": "0", "name": self.robot.controller})

    def close(self) -> None:
        """Leaves the network."""
        for end in (*self._senders, self._switcher, self._battery, self._end):
            end.close()
