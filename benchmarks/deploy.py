"""Success of the whole deployment in lock step: guard, runner, estimator and simulated robot over the link in memory.

    python -m benchmarks.deploy [--scenes bench20] [--rollouts 1] [--seed 0] [--policy student] [--noise trained]
        [--delays trained] [--dynamics drawn] [--from-cloud] [--as-evaluated] [--json out.json]

Each trial begins as those of `hotice evaluate`: the robot stands in the carry state, the box between its hands. Its
own controller holds it so until the guard is ready, and lets go as the guard enters carry; from there every state,
pose, tag, target and command goes the way that it goes on a robot, on a simulated clock, by the real time's rates.
Success: `hotice.task.rules`, with contacts judged by MuJoCo in every physics step, the referee `exact`, within
`HORIZON_S`. With `--from-cloud` the runner knows the scene only as a FAST-LIO-like cloud of it, imported without
options, and localization speaks in that cloud's frame; each scene is mapped `MAPS` times, with a ceiling and without.
With `--as-evaluated` the trials are those of `hotice evaluate` with the same scenes, rollouts and seed: its objects,
robots, starts, delays and pushes, and its verdicts stand beside; otherwise the box is the same in all trials, and
nobody pushes. Either way joints, speeds, gyro, gravity and localization are as noisy as there; waist and wrists, welded
there, are held by servos, and the box's pose comes from tags (0.3 px) rather than with ± 5 cm and ± 5 degrees.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.arguments import a_count, a_seed
from benchmarks.evaluated import EvaluatedTrial, become, evaluated_trials
from hotice.console import PlainConsole
from hotice.deploy import CheckedCommand, Link, MemoryBus
from hotice.deploy.guard import Event, Guard, GuardConfig, Mode, Request
from hotice.deploy.link.protocol import LinkCounts, ReceivedState
from hotice.deploy.programs.prepare import Prepared, around_of, estimator_of
from hotice.deploy.runner import RobotRunner
from hotice.deploy.simulated import LivingClock, SimulatedRobot, SimulatedRobotConfig
from hotice.deploy.simulated.lidar_map import LidarScan, pcd_of, scan
from hotice.deploy.simulated.robot import DrawnRobot
from hotice.deploy.sources import MemorySource, MoverSample, PoseSample, TagSample
from hotice.errors import SimulationError
from hotice.evaluate.trials import success_interval
from hotice.fields import build_hod_pf
from hotice.files import write_text
from hotice.model import Box, Scene, solve_carry
from hotice.model.importers import ImportOptions, import_scene
from hotice.model.shipped import resolve_scenes
from hotice.policy import PolicyTask, open_policy
from hotice.task.rules import PRECEDENCE, arrived

STEP_S, TICK_STEPS = 0.002, 10
HORIZON_S = 5.0
STAY_S = 1.0
"""Whether a robot stays at the goal is seen so long after its arrival."""
MAPS, CEILING_M = 4, 2.4
BOX = (0.3, 0.3, 0.25, 1.5)
WISHES = {Mode.OFF: Request.START, Mode.DAMPING: Request.POSTURE}


class Withheld:
    """A link whose commands do not reach the robot until it is opened. See `Link`."""

    def __init__(self, link: Link) -> None:
        self._link, self.open = link, False

    def publish(self, command: CheckedCommand) -> None:
        if self.open:
            self._link.publish(command)

    def state(self) -> ReceivedState | None:
        return self._link.state()

    def counts(self) -> LinkCounts:
        return self._link.counts()

    def close(self) -> None:
        self._link.close()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a trial went: `outcome` by its name in `hotice.task.rules`, or "stopped" by the guard."""

    scene: str
    seed: int
    outcome: str
    time_s: float
    """From the guard's carry to the end [s]."""
    stayed: bool
    """Whether it stood at the goal `STAY_S` later, the box in its hands."""
    refused: int
    """Targets that the guard refused."""
    faults: tuple[str, ...]
    """What the guard told in carry, each once."""
    evaluated: str = ""
    """How the same trial went in an evaluation."""


class Trial:
    """One robot in lock step with its guard and its runner."""

    def __init__(
        self, made: Prepared, config: SimulatedRobotConfig, scene: Scene, like: EvaluatedTrial | None = None
    ) -> None:
        self.clock = LivingClock()
        bus = MemoryBus(self.clock)
        self.link = Withheld(bus.link())
        poses, tags = MemorySource(self.clock, PoseSample.decode), MemorySource(self.clock, TagSample.decode)
        movers = MemorySource(self.clock, MoverSample.decode)
        self.robot = SimulatedRobot(
            config,
            bus.robot(),
            pose=poses,
            tags=tags,
            movers=movers,
            carry=made.carry,
            scene=scene,
            drawn=None if like is None else drawn_as(like),
        )
        self._pushes = [] if like is None else like.pushes_W.tolist()
        self.clock.every_step(self.robot.step)
        self._targets = self._status = None
        self._steps, self.told = 0, []
        self.runner = RobotRunner(
            made.policy,
            made.pf,
            made.carry,
            estimator_of(made, poses, tags),
            lambda: self._status,
            self._put,
            self.clock,
            around_of(made, movers),
        )
        self.runner.warm()
        self.guard = Guard(
            self.link,
            lambda: self._targets,
            self._tell,
            self.clock,
            GuardConfig(posture_s=1.0),
            wishes=self._wishes,
            charge=lambda: 80.0,
            on_event=self.told.append,
        )

    def step(self) -> None:
        """2 ms of all."""
        if self._steps % TICK_STEPS == 0:
            self.runner.tick()
            if self.link.open and self._pushes:
                self.robot.world.push(self._pushes.pop(0))
        self.guard.tick()
        self._steps += 1
        self.clock.sleep(STEP_S)

    def _wishes(self) -> Iterable[Request]:
        if self.guard.mode is Mode.READY:
            # this tick's command is the first that the robot gets
            self.link.open = True
            self.robot.world.movers.begin()
            return (Request.CARRY,)
        return (WISHES[self.guard.mode],) if self.guard.mode in WISHES and not self.link.open else ()

    def _put(self, targets: np.ndarray) -> None:
        self._targets = targets.copy()

    def _tell(self, status: np.ndarray) -> None:
        self._status = status.copy()


def drawn_as(trial: EvaluatedTrial) -> DrawnRobot:
    """The robot of a trial of an evaluation."""
    return DrawnRobot(
        change=lambda model: become(model, trial.robot), late=trial.late, command_delay_s=trial.command_delay_s
    )


def run_trial(
    made: Prepared, config: SimulatedRobotConfig, scene: Scene | None = None, like: EvaluatedTrial | None = None
) -> Outcome:
    """A carry from the start to its end.

    `scene`: what the robot is in, by default the one that its runner knows; `like`: the trial that is repeated.
    """
    scene = made.scene if scene is None else scene
    trial = Trial(made, config, scene, like)
    world, goal = trial.robot.world, np.asarray(scene.goal_W[:2])

    def seen() -> str:
        if world.failure or world.touched:
            return min(filter(None, (world.failure, world.touched)), key=PRECEDENCE.index)
        return "success" if arrived(float(np.linalg.norm(world.data.qpos[:2] - goal))) else ""

    def outcome(limit_s: float, ends: str = "") -> str:
        try:
            for _ in range(round(limit_s / STEP_S)):
                trial.step()
                if trial.guard.mode is Mode.DAMPING and trial.link.open:
                    return "stopped"
                if (found := seen()) and found != ends:
                    return found
        except SimulationError:
            return "unstable"
        return ""

    while not trial.link.open:
        trial.step()
    began_s = trial.clock.now()
    result = outcome(HORIZON_S) or "timeout"
    time_s = trial.clock.now() - began_s
    stayed = result == "success" and not outcome(STAY_S, ends="success") and seen() == "success"
    return Outcome(
        scene=scene.name,
        seed=config.seed,
        outcome=result,
        time_s=time_s,
        stayed=stayed,
        refused=trial.guard.targets.refused,
        faults=tuple(dict.fromkeys(_what(e) for e in trial.told if e.time_s > began_s)),
        evaluated="" if like is None else like.outcome,
    )


def mapped(scene: Scene, number: int) -> Scene:
    """The scene as it is imported from a cloud of it; each second one has a ceiling."""
    made = LidarScan(ceiling_m=CEILING_M if number % 2 else None, seed=number)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{scene.name}.pcd"
        path.write_bytes(pcd_of(scan(scene, made)))
        return import_scene(path, ImportOptions(start=scene.start[:2], goal=scene.goal)).scene


def _what(event: Event) -> str:
    return f"{event.mode.name.lower()}: {event.text}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["bench20"])
    parser.add_argument("--rollouts", type=a_count, default=1, help="trials of each scene")
    parser.add_argument("--seed", type=a_seed, default=0)
    parser.add_argument("--policy", default="student")
    parser.add_argument("--noise", choices=("none", "trained"), default="trained")
    parser.add_argument("--delays", choices=("none", "trained"), default="trained")
    parser.add_argument("--dynamics", choices=("nominal", "drawn"), default="drawn")
    parser.add_argument("--from-cloud", action="store_true", help="of the scene the runner knows a lidar's map alone")
    parser.add_argument("--as-evaluated", action="store_true", help="the trials of `hotice evaluate`, pushes and all")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    console, found = PlainConsole(), []
    for made, config, scene, like in _as_evaluated(args) if args.as_evaluated else _as_asked(args):
        began_s = time.monotonic()
        result = run_trial(made, config, scene, like)
        found.append(result)
        console.print(
            f"{scene.name} {result.seed}: {result.outcome} after {result.time_s:.1f} s"
            f"{', stayed' * result.stayed}{f', evaluated: {result.evaluated}' * bool(like)}; {result.refused} refused; "
            f"{', '.join(result.faults) or 'no faults'} ({time.monotonic() - began_s:.0f} s)",
            soft_wrap=True,
        )
        if args.json:
            write_text(args.json, json.dumps([asdict(each) for each in found], indent=1))
    console.print(_table(found))


Task = tuple[Prepared, SimulatedRobotConfig, Scene, EvaluatedTrial | None]


def _as_asked(args: argparse.Namespace) -> Iterator[Task]:
    policy, carry = open_policy(args.policy), solve_carry(Box(BOX[:3], BOX[3]))
    task = PolicyTask.from_meta(policy.meta, policy.name)
    for number, scene in enumerate(resolve_scenes(args.scenes)):
        known = [mapped(scene, k) for k in range(min(MAPS, args.rollouts))] if args.from_cloud else [scene]
        made = [
            Prepared(policy, build_hod_pf(each.still(), task.resolution_m, task.margin_m), carry, each)
            for each in known
        ]
        for rollout in range(args.rollouts):
            config = SimulatedRobotConfig(
                box=BOX,
                noise=args.noise,
                delays=args.delays,
                dynamics=args.dynamics,
                localized_in="scan" if args.from_cloud else "scene",
                seed=args.seed + 1000 * number + rollout,
            )
            yield made[rollout % len(made)], config, scene, None


def _as_evaluated(args: argparse.Namespace) -> Iterator[Task]:
    policy, pf = open_policy(args.policy), None
    task = PolicyTask.from_meta(policy.meta, policy.name)
    trials = evaluated_trials(args.policy, tuple(args.scenes), args.rollouts, args.seed)
    for number, trial in enumerate(trials):
        if pf is None or pf.scene.name != trial.scene.name:
            pf = build_hod_pf(trial.scene.still(), task.resolution_m, task.margin_m)
        box = trial.carry.carried
        config = SimulatedRobotConfig(
            box=(*(2.0 * box.half_extents_m).tolist(), box.mass_kg), delays="trained", seed=args.seed + number
        )
        yield Prepared(policy, pf, trial.carry, trial.scene), config, trial.scene, trial


def _table(found: list[Outcome]) -> Table:
    counts = Counter(each.outcome for each in found)
    low, high = success_interval(counts["success"], len(found))
    table = Table("", "", show_header=False)
    table.add_row("trials", str(len(found)))
    table.add_row("success", f"{counts['success'] / len(found):.1%} (95 % interval {low:.1%} to {high:.1%})")
    table.add_row("stayed at the goal", str(sum(each.stayed for each in found)))
    for outcome, count in counts.most_common():
        table.add_row(outcome, str(count))
    if found[0].evaluated:
        same = Counter(each.evaluated for each in found)
        low, high = success_interval(same["success"], len(found))
        table.add_row(
            "evaluated: success", f"{same['success'] / len(found):.1%} (95 % interval {low:.1%} to {high:.1%})"
        )
        alone = [(e.outcome == "success", e.evaluated == "success") for e in found]
        table.add_row("success here alone, there alone", f"{alone.count((True, False))}, {alone.count((False, True))}")
    return table


if __name__ == "__main__":
    main()
