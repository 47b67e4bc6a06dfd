"""`hotice robot-check`: one table of what a robot sends, before it moves."""

from __future__ import annotations

import contextlib
import time

import numpy as np
from rich.table import Table

from hotice.commands.deploy.check_config import RobotCheckConfig
from hotice.commands.deploy.config import fitting_scene
from hotice.console import PlainConsole
from hotice.deploy.checkup import Row, all_rows, joint_rows, watch_robot
from hotice.deploy.clock import MonotonicClock
from hotice.deploy.dds.battery import DdsBattery
from hotice.deploy.dds.link import DdsLink
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.sources.records import PoseSample, TagSample
from hotice.deploy.sources.udp import UdpSource
from hotice.errors import HoticeError
from hotice.policy import open_policy

POLICY_MS, POLICY_STEPS = 5.0, 300
"""Largest time of 99 in 100 steps of the network; how many are tried, the first tenth for nothing."""
FOUND_S = 3.0
"""Time in which two programs on a network find each other."""


class CheckFailed(HoticeError):
    """A robot that is not ready; the table says why."""


def robot_check(config: RobotCheckConfig) -> None:
    """Watches the robot and prints the table. Raises `HoticeError`, `CheckFailed` where a row has failed."""
    scene, (interface, domain) = fitting_scene(config.deployment), config.deployment.network
    step = _policy_row(config.policy)
    clock, console = MonotonicClock(), PlainConsole()
    console.print(f"watching domain {domain} on {interface} for {config.seconds:g} s; nothing is sent")
    with contextlib.ExitStack() as stack:
        node = stack.enter_context(DdsNode(domain=domain, interface=interface))
        link, battery = DdsLink(node, clock), DdsBattery(node)
        poses = UdpSource(config.pose_port, PoseSample.decode, clock=clock)
        tags = UdpSource(config.tags_port, TagSample.decode, clock=clock)
        for opened in (link, battery, poses, tags):
            stack.callback(opened.close)
        # the first states come when both ends have found each other
        found_s = clock.now() + FOUND_S
        while link.state() is None and clock.now() < found_s:
            clock.sleep(0.01)
        observed = watch_robot(link, poses, tags, clock, config.seconds, battery.charge)

        def ask(joint: str) -> None:
            console.print(f"move by hand, then leave it: {joint}")

        moved = joint_rows(link, clock, ask, config.asked, config.joint_s)
    rows = [*all_rows(observed, source=scene.source, stands=config.stands), *moved, step]
    console.print(table_of(rows))
    failed = [row.name for row in rows if row.passed is False]
    if failed:
        raise CheckFailed(f"{len(failed)} of {len(rows)} rows failed: {', '.join(failed)}")


def table_of(rows: list[Row]) -> Table:
    """The rows as they are printed."""
    table = Table("", "measured", "needed", "", title="check of a robot that is held still")
    for row in rows:
        said = "–" if row.passed is None else "pass" if row.passed else "FAIL"
        table.add_row(row.name, row.value, row.needed, said, style="bold red" if row.passed is False else "")
    return table


def _policy_row(name: str) -> Row:
    policy = open_policy(name)
    observation = np.zeros((1, sum(width for _, width in policy.layout)), np.float32)
    took = []
    for _ in range(POLICY_STEPS):
        began = time.perf_counter()
        policy.run(observation)
        took.append(1e3 * (time.perf_counter() - began))
    slowest = float(np.percentile(took[POLICY_STEPS // 10 :], 99))
    return Row(f"step of {name}", f"{slowest:.2f} ms in 99 of 100", f"{POLICY_MS:g} ms at most", slowest <= POLICY_MS)
