"""Runs of the deployment as a user starts it: `hotice deploy` and `hotice robot-sim` in processes over loopback.

    python -m benchmarks.deploy_processes [--scenes open_floor gap beam] [--runs 20] [--seed 0] [--domain 40]
        [--json out.json]

The runner knows each scene as a FAST-LIO-like cloud of it alone, made by `hotice scene scan` and read by `hotice scene
import`. Guard, runner and robot are three processes on one machine, in real time, so a busy machine fails where an
idle one does not: the load is told, and the time that a virtual machine's host took from it (Linux). Each run hangs the
robot up, moves it to the posture, hands it the box, lowers it and lets it carry (keys by the clock). Success: the guard
says that the goal is reached within `CARRY_S` of the wish to carry, and until the end, `STAY_S` later or more, the
robot has neither fallen nor dropped the box nor touched anything, as the simulated robot itself tells.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.table import Table

from benchmarks.arguments import a_count, a_seed, from_zero
from hotice.console import PlainConsole
from hotice.errors import HoticeError
from hotice.evaluate.trials import success_interval
from hotice.files import write_text
from hotice.model.shipped import resolve_scenes

ROOT = Path(__file__).parents[1]
LONG_S = 300.0
PRESSED = ("start@2s", "L2+up@4s", "F1@8.5s", "F1@12s", "F2@14s", "R1+X@17s")
CARRY_S, STAY_S = 6.0, 2.0
ENDS_S = 17.0 + CARRY_S + STAY_S
POSE_PORT = 47_900


@dataclass(frozen=True, kw_only=True)
class Run:
    """How a run went: whether it was a success, and what was told."""

    scene: str
    seed: int
    success: bool
    robot: dict[str, str]
    """Lines of the simulated robot's table."""
    guard: tuple[str, ...]
    """Changes of the guard's mode and their reasons."""
    load: float
    """Of the machine at the end."""
    stolen_s: float
    """Time of cores that the host of a virtual machine took meanwhile [s]; 0 where that is not known."""


class Program:
    """A command of hotice in a process of its own, and its lines."""

    def __init__(self, *arguments: object, cwd: Path = ROOT) -> None:
        self.lines: list[str] = []
        self._came = threading.Condition()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "hotice", *map(str, arguments)],
            cwd=cwd,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "COLUMNS": "200"},
        )
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._came:
                self.lines.append(line.rstrip())
                self._came.notify_all()
        with self._came:
            self._came.notify_all()

    @property
    def text(self) -> str:
        """All lines so far."""
        return "\n".join(self.lines)

    def hear(self, part: str) -> None:
        """Waits for a line with this part. Raises `HoticeError` where the program ends before."""
        with self._came:
            self._came.wait_for(
                lambda: any(part in line for line in self.lines) or self.process.poll() is not None, LONG_S
            )
            if not any(part in line for line in self.lines):
                raise HoticeError(f"{part!r} never came: {' | '.join(self.lines[-5:])}")

    def end(self, number: int | None = None) -> int:
        """Its exit status, after a signal if there is a number."""
        if number is not None and self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(LONG_S)
        self._thread.join(LONG_S)
        return status


def stolen_s() -> float:
    """Time of cores that the host has taken from this machine so far [s]; 0 where the system does not say it."""
    try:
        cores = Path("/proc/stat").read_text().splitlines()[0].split()
    except OSError:
        return 0.0
    return int(cores[8]) / os.sysconf("SC_CLK_TCK")


def ask(*arguments: object) -> None:
    """Runs a command to its end. Raises `HoticeError` where it fails."""
    program = Program(*arguments)
    if program.end():
        raise HoticeError(f"hotice {' '.join(map(str, arguments))}: {' | '.join(program.lines[-5:])}")


def mapped(name: str, folder: Path) -> tuple[Path, Path]:
    """Cloud of a scene, and the scene that is imported from it."""
    scene = resolve_scenes([name])[0]
    cloud, made = folder / f"{scene.name.replace('/', '_')}.pcd", folder / f"{scene.name.replace('/', '_')}.json"
    ask("scene", "scan", name, "--out", cloud)
    ask("scene", "import", cloud, "--start", *scene.start[:2], "--goal", *scene.goal, "--out", made)
    return cloud, made


def run(name: str, cloud: Path, made: Path, seed: int, domain: int) -> Run:
    """One run, from the gantry to the goal."""
    before_s = stolen_s()
    network = ["--domain", domain, "--pose-port", POSE_PORT, "--tags-port", POSE_PORT + 1]
    deploy = Program("deploy", "--robot", "sim", "--scene", made, "--map", cloud, *network)
    try:
        deploy.hear("runner: warm")
        robot = Program(
            "robot-sim",
            "--scene",
            name,
            "--localized-in",
            "scan",
            "--start",
            "held",
            "--seed",
            seed,
            "--duration-s",
            ENDS_S,
            "--press",
            *PRESSED,
            *network,
        )
        robot.end()
    finally:
        # Ctrl-C would only brake where the guard has not noticed yet that the robot is gone
        deploy.end(signal.SIGTERM)
    cells = [re.split(r"\s*[│┃|]\s*", line.strip("│┃| ")) for line in robot.lines if "│" in line]
    told = {cell[0]: cell[1] for cell in cells if len(cell) > 1}
    modes = tuple(line for line in deploy.lines if re.match(r"[a-z]+: ", line) and not line.startswith("runner"))
    success = (
        any(line.startswith("hold: the goal is reached") for line in modes)
        and told.get("robot and object") == "neither fallen nor dropped"
        and told.get("touched") == "no obstacle"
        and "given to the robot" in told.get("object", "")
    )
    return Run(
        scene=name,
        seed=seed,
        success=success,
        robot=told,
        guard=modes,
        load=os.getloadavg()[0],
        stolen_s=stolen_s() - before_s,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["open_floor", "gap", "beam"])
    parser.add_argument("--runs", type=a_count, default=20, help="of each scene")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--domain", type=from_zero, default=40, help="DDS domain on loopback")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args(arguments)
    console, found = PlainConsole(), []
    try:
        with tempfile.TemporaryDirectory(prefix="hotice-maps-") as folder:
            for name in args.scenes:
                cloud, made = mapped(name, Path(folder))
                for seed in range(args.seed, args.seed + args.runs):
                    began_s = time.monotonic()
                    found.append(run(name, cloud, made, seed, args.domain))
                    last = found[-1]
                    why = "success" if last.success else f"FAILED: {last.robot}; {'; '.join(last.guard)}"
                    console.print(
                        f"{name} {seed}: {why} (load {last.load:.1f}, {last.stolen_s:.2f} s stolen, "
                        f"{time.monotonic() - began_s:.0f} s)",
                        soft_wrap=True,
                    )
                    if args.json:
                        write_text(args.json, json.dumps([asdict(each) for each in found], indent=1))
    except HoticeError as error:
        print(f"deploy_processes: {error}", file=sys.stderr)
        return 2
    table = Table("scene", "successes", "95 %", title="deployment in processes over loopback, from imported clouds")
    for name in args.scenes:
        good, all_ = sum(r.success for r in found if r.scene == name), args.runs
        low, high = success_interval(good, all_)
        table.add_row(name, f"{good} of {all_}", f"{low:.0%} to {high:.0%}")
    console.print(table)
    return 0 if all(r.success for r in found) else 1


if __name__ == "__main__":
    sys.exit(main())
