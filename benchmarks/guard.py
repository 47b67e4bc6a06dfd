"""Figures of the guard in real processes: from a cause to damping, rate and lateness, time of a tick, CPU.

    python -m benchmarks.guard [--stops 100] [--seconds 60] [--dds DOMAIN] [--json out.json]

Guard, runner and robot are toys of the right shape: the robot's joints move by themselves, the runner gives one posture
50 times a second. Without `--dds` the robot lives in the guard's process, over the link in memory; with it in a third
process over loopback. Causes: the runner is killed, stopped, or gives targets that are not numbers; the robot falls
silent, or its tick stands still. Delays are from the cause, on the machine's one monotonic clock, to the guard's tick
that damps. State to command: from the read that finds a new state until its command has gone, and from the state's
arrival, which over DDS is an upper bound (the read before). The last table has all figures beside their aims:

    python -m benchmarks.guard --dds 79 --stops 100 --seconds 600
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import select
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count, from_zero
from hotice.console import PlainConsole
from hotice.deploy.clock import MonotonicClock
from hotice.deploy.command import CheckedCommand
from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.loop import EDGES_MS, Lateness, run_loop
from hotice.deploy.guard.modes import Mode, Request
from hotice.deploy.guard.process import run_guard
from hotice.deploy.link.memory import MemoryBus
from hotice.deploy.link.protocol import Link, ReceivedState, RobotEnd
from hotice.deploy.messages.hg import JOINTS, LOW_STATE
from hotice.deploy.slot.records import TARGETS
from hotice.deploy.slot.slot import GuardSlot, RunnerSlot
from hotice.files import write_text

CAUSES = ("runner killed", "runner stopped", "targets not numbers", "robot silent", "tick stands still")
ROOT = Path(__file__).parents[1]
LONG_S = 60.0
POSTURE = np.full(29, 0.1)
INERTIA, DT_S = 0.5, 0.002


class ToyRobot:
    """29 joints that move by themselves, behind a robot's end; `state` is "well", "silent" or "frozen"."""

    def __init__(self, end: RobotEnd) -> None:
        self._end, self._record = end, LOW_STATE.zeros()
        self._record["mode_machine"], self._record["imu_state"]["quaternion"] = 5, (1.0, 0.0, 0.0, 0.0)
        self._record["wireless_remote"][0] = 1
        self._q, self._dq = np.zeros(29), np.zeros(29)
        self.state = "well"

    def step(self) -> None:
        command = self._end.command()
        if command is not None:
            m = command.record["motor_cmd"][JOINTS]
            torque = m["tau"] + m["kp"] * (m["q"] - self._q) + m["kd"] * (m["dq"] - self._dq)
            self._dq = 0.999 * (self._dq + DT_S / INERTIA * torque)
            self._q = self._q + DT_S * self._dq
        if self.state != "frozen":
            self._record["tick"] += 1
        motors = self._record["motor_state"][JOINTS]
        motors["q"], motors["dq"] = self._q, self._dq
        if self.state != "silent":
            self._end.publish_state(self._record)


class TickedLink:
    """A link in memory whose robot lives as often as its states are read."""

    def __init__(self, link: Link, robot: ToyRobot) -> None:
        self._link, self._robot = link, robot
        self.publish, self.counts, self.close = link.publish, link.counts, link.close

    def state(self) -> ReceivedState | None:
        self._robot.step()
        return self._link.state()


class TimedLink:
    """A link that remembers how long after a new state its command went; see `Link`."""

    def __init__(self, link: Link, clock: MonotonicClock) -> None:
        self._link, self._clock = link, clock
        self.counts, self.close = link.counts, link.close
        self._sequence, self._read_s, self._came_s = 0, None, 0.0
        self.from_read_s: array[float] = array("d")
        self.from_arrival_s: array[float] = array("d")

    def state(self) -> ReceivedState | None:
        began_s = self._clock.now()
        received = self._link.state()
        if received is not None and received.sequence != self._sequence:
            self._sequence, self._read_s, self._came_s = received.sequence, began_s, received.received_s
        return received

    def publish(self, command: CheckedCommand) -> None:
        self._link.publish(command)
        if self._read_s is not None:
            now_s = self._clock.now()
            self.from_read_s.append(now_s - self._read_s)
            self.from_arrival_s.append(now_s - self._came_s)
            self._read_s = None


def spread_ms(times_s: Sequence[float]) -> dict[str, float]:
    """Median, 99 in 100, and longest of times [s], in ms."""
    if not len(times_s):
        return dict.fromkeys(("p50", "p99", "worst"), math.nan)
    middle, most, worst = 1e3 * np.percentile(np.asarray(times_s), [50.0, 99.0, 100.0])
    return {"p50": float(middle), "p99": float(most), "worst": float(worst)}


def orders() -> str:
    """A line that was written to this process, without waiting; "" if there is none."""
    return sys.stdin.readline().strip() if select.select([sys.stdin], [], [], 0.0)[0] else ""


def say(**fields: Any) -> None:
    print(json.dumps(fields), flush=True)


def obey(robot: ToyRobot, order: str) -> None:
    if order:
        robot.state = order
        say(done=order, time_s=time.monotonic())


def play_guard(slot_name: str, domain: int | None) -> None:
    """Wishes to carry at every tick, and says what happens, until a signal."""
    clock, slot = MonotonicClock(), GuardSlot(slot_name)
    with contextlib.ExitStack() as stack:
        robot = None
        if domain is None:
            bus = MemoryBus(clock)
            memory = bus.link()
            robot = ToyRobot(bus.robot())
            link: Link = TickedLink(memory, robot)
        else:
            from hotice.deploy.dds.link import DdsLink
            from hotice.deploy.dds.node import DdsNode

            link = DdsLink(stack.enter_context(DdsNode(domain=domain, interface="lo")))

        def wishes() -> tuple[Request, ...]:
            if robot is not None:
                obey(robot, orders())
            return (Request.START, Request.POSTURE, Request.CARRY)

        seen, timed = Lateness(), TimedLink(link, clock)
        began = time.process_time(), time.monotonic()
        run_guard(
            timed,
            slot,
            clock,
            GuardConfig(posture_s=1.0, battery_needed=False),
            wishes=wishes,
            on_event=lambda e: say(time_s=e.time_s, mode=e.mode.name, cause=e.cause.name, text=e.text),
            lateness=seen,
        )
        cpu = (time.process_time() - began[0]) / (time.monotonic() - began[1])
        say(
            seconds=time.monotonic() - began[1],
            ticks=seen.ticks,
            skipped=seen.skipped,
            late=seen.late.tolist(),
            took=seen.took.tolist(),
            worst_late_s=seen.worst_late_s,
            worst_took_s=seen.worst_took_s,
            cpu=cpu,
            state_to_command_ms=spread_ms(timed.from_read_s),
            arrival_to_command_ms=spread_ms(timed.from_arrival_s),
        )
        link.close()
        slot.close()


def play_runner(slot_name: str, _: int | None) -> None:
    """Writes one posture 50 times a second; ordered "nan", no numbers."""
    slot, clock, targets, end = RunnerSlot(slot_name), MonotonicClock(), np.zeros((), TARGETS), os.getppid()
    targets["q"], targets["warm"] = POSTURE, 1

    def tick() -> None:
        order = orders()
        targets["number"] += 1
        targets["stamp_s"] = clock.now()
        if order == "nan":
            targets["q"] = np.nan
        slot.put(targets)
        if order:
            say(done=order, time_s=clock.now())

    run_loop(tick, clock, 50.0, lambda: os.getppid() == end)


def play_robot(_: str, domain: int | None) -> None:
    """Publishes states over loopback."""
    from hotice.deploy.dds.link import DdsRobot
    from hotice.deploy.dds.node import DdsNode

    assert domain is not None
    end = os.getppid()
    with DdsNode(domain=domain, interface="lo") as node:
        robot = ToyRobot(DdsRobot(node))

        def tick() -> None:
            obey(robot, orders())
            robot.step()

        run_loop(tick, MonotonicClock(), 500.0, lambda: os.getppid() == end)


ROLES: dict[str, Callable[[str, int | None], None]] = {
    "guard": play_guard,
    "runner": play_runner,
    "robot": play_robot,
}


class Player:
    """One of the processes."""

    def __init__(self, role: str, slot: str, domain: int | None) -> None:
        command = [sys.executable, "-m", "benchmarks.guard", "--role", role, "--slot", slot]
        if domain is not None:
            command += ["--dds", str(domain)]
        self.process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def order(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def hear(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The next line that is wanted. Raises `RuntimeError` if there is none within a minute."""
        assert self.process.stdout is not None
        end_s = time.monotonic() + LONG_S
        while time.monotonic() < end_s:
            line = self.process.stdout.readline()
            if not line:
                break
            said = json.loads(line)
            if wanted(said):
                return said
        raise RuntimeError(f"the process said nothing of the kind (exit {self.process.poll()})")

    def end(self, number: int | None) -> None:
        """Waits until it is gone, after a signal if there is a number."""
        if number is not None:
            self.process.send_signal(number)
        self.process.wait(LONG_S)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()


class Stage:
    """A guard, its robot and one runner after another."""

    def __init__(self, slot: str, domain: int | None = None) -> None:
        self._slot, self._domain = slot, domain
        self.guard = Player("guard", slot, domain)
        self.robot = self.guard if domain is None else Player("robot", slot, domain)
        self.guard.hear(lambda said: said.get("mode") == Mode.DAMPING.name)

    def delay_s(self, cause: str, after_s: float) -> float:
        """Time from a cause, `after_s` after the begin of a carry, to damping [s]."""
        runner = Player("runner", self._slot, self._domain)
        try:
            self.guard.hear(lambda said: said.get("mode") == Mode.CARRY.name)
            time.sleep(after_s)
            since_s = self._make(cause, runner)
            damped = self.guard.hear(lambda said: said.get("mode") == Mode.DAMPING.name)
        finally:
            runner.end(signal.SIGKILL)
            if cause in ("robot silent", "tick stands still"):
                self.robot.order("well")
        return float(damped["time_s"]) - since_s

    def _make(self, cause: str, runner: Player) -> float:
        if cause.startswith("runner"):
            since_s = time.monotonic()
            runner.process.send_signal(signal.SIGKILL if cause == "runner killed" else signal.SIGSTOP)
            return since_s
        who, order = {
            "targets not numbers": (runner, "nan"),
            "robot silent": (self.robot, "silent"),
            "tick stands still": (self.robot, "frozen"),
        }[cause]
        who.order(order)
        return float(who.hear(lambda said: said.get("done") == order)["time_s"])

    def end(self) -> dict[str, Any]:
        """Ends all; what the guard says of its ticks."""
        self.guard.process.send_signal(signal.SIGTERM)
        seen = self.guard.hear(lambda said: "ticks" in said)
        # a second signal would end it before its slot is unlinked
        self.guard.end(None)
        if self.robot is not self.guard:
            self.robot.end(signal.SIGTERM)
        return seen


@contextlib.contextmanager
def stage(slot: str, domain: int | None = None) -> Iterator[Stage]:
    """A `Stage` whose processes are gone afterwards."""
    made = Stage(slot, domain)
    try:
        yield made
    finally:
        for player in {made.guard, made.robot}:
            if player.process.poll() is None:
                player.end(signal.SIGKILL)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stops", type=a_count, default=100, help="trials of each cause")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the run for rate and lateness")
    parser.add_argument("--dds", type=from_zero, default=None, metavar="DOMAIN", help="of the robot over loopback")
    parser.add_argument("--json", type=Path, default=None, help="where to write the figures")
    parser.add_argument("--role", choices=ROLES, default=None, help=argparse.SUPPRESS)
    parser.add_argument("--slot", default=f"benchmark-{os.getpid()}", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.role is not None:
        ROLES[args.role](args.slot, args.dds)
        return 0
    figures: dict[str, Any] = {"load": os.getloadavg(), "stops": {}}
    rng = np.random.default_rng(0)
    with stage(args.slot, args.dds) as players:
        for cause in CAUSES:
            delays = [players.delay_s(cause, float(rng.uniform(0.1, 0.2))) for _ in range(args.stops)]
            figures["stops"][cause] = delays
            if delays:
                within = sum(delay <= 0.1 for delay in delays)
                print(
                    f"{cause}: {within} of {len(delays)} within 100 ms, longest {1e3 * max(delays):.1f} ms", flush=True
                )
        players.end()
    with stage(args.slot, args.dds) as players:
        runner = Player("runner", args.slot, args.dds)
        time.sleep(args.seconds)
        runner.end(signal.SIGKILL)
        figures["run"] = seen = players.end()
    figures["load at the end"] = os.getloadavg()
    print(f"{seen['ticks']} ticks, {seen['skipped']} left out, CPU {seen['cpu']:.1%} of a core")
    for edge, late, took in zip((*EDGES_MS, np.inf), seen["late"], seen["took"], strict=True):
        print(f"  up to {edge:g} ms: {late} late, {took} took so long")
    late, took = 1e3 * seen["worst_late_s"], 1e3 * seen["worst_took_s"]
    print(f"  worst: {late:.2f} ms late, took {took:.2f} ms; load of the machine {os.getloadavg()[0]:.1f}")
    table = Table("figure", "aim", "measured", title="guard")
    for row in rows_of(figures):
        table.add_row(*row)
    PlainConsole().print(table)
    if args.json is not None:
        write_text(args.json, json.dumps(figures, indent=1))
    return 0


def rows_of(figures: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Figure, aim and measurement of each line of the table."""
    seen = figures["run"]
    rate, lost = seen["ticks"] / seen["seconds"], seen["skipped"]
    yield (
        "length of the run, load before and after",
        "600 s, idle",
        (f"{seen['seconds']:.0f} s, {figures['load'][0]:.1f} and {figures['load at the end'][0]:.1f}"),
    )
    yield "commands a second", "500 ± 0.1 %", f"{rate:.2f} ({100.0 * (rate / 500.0 - 1.0):+.3f} %), {lost} left out"
    yield "longest time between two commands", "10 ms", f"{1e3 * (seen['worst_late_s'] + DT_S):.2f} ms at most"
    for name, aim in (("state_to_command_ms", "p50 0.3, p99 1 ms"), ("arrival_to_command_ms", "–")):
        ms = seen[name]
        said = f"p50 {ms['p50']:.3f}, p99 {ms['p99']:.3f}, worst {ms['worst']:.2f} ms"
        yield name.removesuffix("_ms").replace("_", " "), aim, said
    yield "CPU", "10 % of a core", f"{seen['cpu']:.1%}"
    for cause, delays in figures["stops"].items():
        if delays:
            within = f"{sum(delay <= 0.1 for delay in delays)} of {len(delays)}"
            yield f"{cause}: damping within 100 ms", "all", f"{within}, longest {1e3 * max(delays):.1f} ms"


if __name__ == "__main__":
    sys.exit(main())
