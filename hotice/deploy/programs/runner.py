"""The runner as a program: `python -m hotice.deploy.programs.runner OPTIONS`, beside a guard that has the slot."""

from __future__ import annotations

import contextlib
import gc
import signal
import sys

from hotice.deploy.clock import MonotonicClock
from hotice.deploy.estimate import LidarPelvis, TaggedBox, TrackingEstimator
from hotice.deploy.guard.loop import Lateness, run_loop
from hotice.deploy.guard.scheduling import RUNNER_PRIORITY, take_precedence
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.programs.prepare import prepare
from hotice.deploy.programs.saying import Saying, ended
from hotice.deploy.runner.runner import RobotRunner
from hotice.deploy.slot.slot import RunnerSlot
from hotice.deploy.sources.records import PoseSample, TagSample
from hotice.deploy.sources.udp import UdpSource
from hotice.deploy.tags import BoxPoser, box_bundle

TOLD_TICKS = 25
"""Ticks from one report to the next."""


def main(options: RunnerOptions) -> None:
    """Runs until a signal. Raises `HoticeError`."""
    clock, say, stopped = MonotonicClock(), Saying(), []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.append(1))
    with contextlib.ExitStack() as stack:
        poses = UdpSource(options.pose_port, PoseSample.decode, clock=clock)
        stack.callback(poses.close)
        tags = UdpSource(options.tags_port, TagSample.decode, clock=clock)
        stack.callback(tags.close)
        made = prepare(options, lambda stage: say(stage=stage))
        carried = made.carry.carried
        slot = RunnerSlot(options.slot)
        stack.callback(slot.close)
        estimator = TrackingEstimator(
            carried,
            LidarPelvis(poses, made.pf.scene.source),
            TaggedBox(tags, BoxPoser(box_bundle(carried))),
            latency_s=options.pose_latency_s,
        )
        runner = RobotRunner(made.policy, made.pf, made.carry, estimator, slot.status, slot.put, clock)
        say(stage="warming up")
        runner.warm()
        gc.collect()
        gc.freeze()
        take_precedence(RUNNER_PRIORITY)
        say(warm=True)
        lateness = Lateness()

        def tick() -> None:
            runner.tick()
            if lateness.ticks % TOLD_TICKS == 0:
                say(**_report(runner, lateness))

        run_loop(tick, clock, 1.0 / runner.period_s, lambda: not stopped, lateness)
        say(lateness=str(lateness))


def _report(runner: RobotRunner, lateness: Lateness) -> dict:
    estimate = runner.estimate
    return {
        "ticks": lateness.ticks,
        "skipped": lateness.skipped,
        "worst_late_ms": 1e3 * lateness.worst_late_s,
        "worst_took_ms": 1e3 * lateness.worst_took_s,
        "pose": "not known yet" if estimate is None else estimate.pose_verdict,
        "box": "not known yet" if estimate is None else estimate.box_verdict,
        "goal_m": runner.goal_m,
    }


if __name__ == "__main__":
    sys.exit(ended(lambda: main(RunnerOptions.of(sys.argv[1]))))
