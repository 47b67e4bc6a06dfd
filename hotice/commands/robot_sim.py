"""`hotice robot-sim`: a simulated robot in real time, on the topics of the real one, and what became of it."""

from __future__ import annotations

import gc
import math

from rich.table import Table

from hotice.commands.robot_sim_config import RobotSimConfig
from hotice.commands.signals import stopped_by_signals
from hotice.console import PlainConsole
from hotice.deploy.clock import MonotonicClock
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.guard.scheduling import SIMULATED_PRIORITY, take_precedence
from hotice.deploy.simulated.keys import KEYS, pressed_by
from hotice.deploy.simulated.on_network import NetworkRobot, Ports
from hotice.deploy.simulated.real_time import Lateness, live
from hotice.deploy.terminal import Terminal
from hotice.machine import usable_cores

LOOK_STEPS = 5
"""Steps from one look at the keyboard to the next."""
SHOWN_MS = (0.1, 0.5, 2.0, 10.0)


def robot_sim(config: RobotSimConfig) -> None:
    """Lives until its time is over or Ctrl-C, then prints what became of it. Raises `HoticeError`."""
    # a real robot is not late because this machine is busy; before the node, whose threads inherit it. On a single core
    # one that is too slow for real time would leave nothing to others
    if usable_cores() > 1:
        take_precedence(SIMULATED_PRIORITY)
    with DdsNode(domain=config.domain, interface=config.interface) as node:
        network = NetworkRobot(
            config, node, Ports(pose=config.pose_port, tags=config.tags_port, movers=config.movers_port)
        )
        try:
            _live(config, network)
        finally:
            network.close()


def _live(config: RobotSimConfig, network: NetworkRobot) -> None:
    robot, console, stopped = network.robot, PlainConsole(), []
    console.print(
        f"simulated robot in {robot.world.scene.name}, {config.start}: domain {config.domain} on {config.interface}, "
        f"pose to UDP {config.pose_port}, tags to {config.tags_port}"
        f"{f', movers to {config.movers_port}' if robot.world.scene.moving else ''}; Ctrl-C ends"
    )
    # what exists now is never looked at again
    gc.collect()
    gc.freeze()
    with Terminal() as terminal, stopped_by_signals(stopped):
        if terminal.there:
            console.print("keys: " + ", ".join(f"{letter!r} {'+'.join(keys)}" for letter, keys in KEYS.items()))

        def step() -> None:
            network.step()
            if terminal.there and robot.steps % LOOK_STEPS == 0:
                for keys in pressed_by(terminal.typed()):
                    robot.press(*keys)

        end_s = math.inf if config.duration_s is None else config.duration_s
        lateness = live(step, MonotonicClock(), lambda: not stopped and robot.time_s < end_s)
    gc.unfreeze()
    console.print(_summary(network, lateness))


def _summary(network: NetworkRobot, lateness: Lateness) -> Table:
    robot = network.robot
    counts = robot.end.counts()
    refused = ", ".join(f"{count} {reason}" for reason, count in sorted(counts.refused.items())) or "none"
    shares = ", ".join(f"{100.0 * lateness.share_below(edge):.2f} % below {edge:g} ms" for edge in SHOWN_MS)
    table = Table("", "", title="simulated robot", show_header=False)
    for row in (
        ("lived", f"{robot.time_s:.2f} s, {robot.steps} states"),
        ("steps late", f"{shares}; worst {1e3 * lateness.worst_s:.2f} ms, slipped {lateness.slipped_s:.3f} s"),
        ("commands", f"{counts.taken} taken; refused: {refused}"),
        *robot.told_story(),
    ):
        table.add_row(*row)
    return table
