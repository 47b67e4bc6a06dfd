"""The runner as a program: `python -m hotice.deploy.programs.runner OPTIONS`, beside a guard that has the slot."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
from typing import Any

from hotice.deploy.clock import MonotonicClock
from hotice.deploy.guard.loop import Lateness, run_loop
from hotice.deploy.guard.scheduling import MAY_WAIT_FOR_DISK, RUNNER_PRIORITY, stay_in_memory
from hotice.deploy.programs.logging import open_log, report
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.programs.prepare import around_of, estimator_of, prepare
from hotice.deploy.programs.saying import Saying, ended
from hotice.deploy.recording.replay import NAME, digests
from hotice.deploy.recording.runner_log import RunnerLog, kinds, width
from hotice.deploy.runner.runner import RobotRunner
from hotice.deploy.runner.ways import LiveWays
from hotice.deploy.seeing.live_view import LiveView
from hotice.deploy.slot.slot import RunnerSlot
from hotice.deploy.sources.records import MoverSample, PoseSample, TagSample
from hotice.deploy.sources.udp import UdpSource

TOLD_TICKS = 25
"""Ticks from one report to the next."""


def main(options: RunnerOptions) -> None:
    """Runs until a signal, or until the program that started it is gone. Raises `HoticeError`."""
    clock, say, stopped, started_by = MonotonicClock(), Saying(), [], os.getppid()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.append(1))
    with contextlib.ExitStack() as stack:
        poses = UdpSource(options.pose_port, PoseSample.decode, clock=clock)
        stack.callback(poses.close)
        tags = UdpSource(options.tags_port, TagSample.decode, clock=clock)
        stack.callback(tags.close)
        made = prepare(options, lambda stage: say(stage=stage))
        movers = None
        if made.moving:
            movers = UdpSource(options.movers_port, MoverSample.decode, clock=clock)
            stack.callback(movers.close)
        slot = RunnerSlot(options.slot)
        stack.callback(slot.close)
        say(stage="everything once, compiled where it is not yet")
        blind = estimator_of(made, poses, tags)
        # all is compiled before this process goes before others, and without the log
        RobotRunner(
            made.policy,
            made.pf,
            made.carry,
            blind,
            lambda: None,
            lambda targets: None,
            clock,
            around_of(made, movers),
        ).warm()
        ways = None
        if made.moving and options.moving == "live":
            say(stage="fields of the moment")
            ways = stack.enter_context(LiveWays(made.pf, made.moving))
        after = []
        if options.view_port is not None:
            say(stage="live page")
            view = stack.enter_context(LiveView(made.scene, made.carry.carried, made.policy, port=options.view_port))
            after.append(view.after)
            say(text=f"live page: {view.url}")
        logs = kinds(width(made.policy), bool(made.moving))
        log = stack.enter_context(open_log(options, NAME, logs, RUNNER_PRIORITY, **digests(made)))
        logged = RunnerLog(log, clock)
        runner = RobotRunner(
            made.policy,
            made.pf,
            made.carry,
            estimator_of(
                made,
                logged.source("pose", poses),
                logged.source("tags", tags),
                options.pose_latency_s,
                options.tags_latency_s,
            ),
            logged.status_of(slot.status),
            logged.put_of(slot.put),
            logged,
            around_of(made, movers and logged.source("movers", movers), ways),
        )
        runner.warm()
        after.append(logged.after)
        gc.collect()
        gc.freeze()
        if not stay_in_memory():
            say(text=MAY_WAIT_FOR_DISK)
        say(warm=True)
        lateness = Lateness()

        def tick() -> None:
            runner.tick()
            for see in after:
                see(runner)
            if lateness.ticks % TOLD_TICKS == 0:
                say(**report(lateness, log), **_known(runner))

        # the guard brakes then, and this one would keep the ports of its sources
        run_loop(tick, clock, 1.0 / runner.period_s, lambda: not stopped and os.getppid() == started_by, lateness)
        say(lateness=str(lateness))


def _known(runner: RobotRunner) -> dict[str, Any]:
    estimate = runner.estimate
    return {
        "pose": "not known yet" if estimate is None else estimate.pose_verdict,
        "box": "not known yet" if estimate is None else estimate.box_verdict,
        "goal_m": runner.goal_m,
    } | ({} if runner.around is None else {"movers": runner.around.verdict})


if __name__ == "__main__":
    sys.exit(ended(lambda: main(RunnerOptions.of(sys.argv[1]))))
