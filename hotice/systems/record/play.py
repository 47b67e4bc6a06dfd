"""One run of a station until the object is at the goal, the robot fails or time is over, as a record to look at."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportIndexIssue=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from pydrake.systems.analysis import Simulator

from hotice.model import builder
from hotice.replay import RolloutRecord
from hotice.systems.job.run import JobResult, run_job
from hotice.systems.logs import read_logs
from hotice.systems.record.hand_over import HandOverReport, report_hand_over
from hotice.systems.record.rollout import to_record
from hotice.systems.signals import NQ, OBJECT_POS
from hotice.systems.station.make import Station
from hotice.task.judge import Judge
from hotice.task.rules import OUTCOMES, arrived

PICK_S = 40.0
"""Longest pick-up, steps away from the table included."""
HELD_S = 2.0
"""Time that a pick-up that hands nothing over is shown holding the object [s]."""
AFTER_S = 0.6
"""Time shown after the end [s]."""
CHECK_S = 0.1
"""Period of looking whether the run is over [s]."""


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run: the record, and what is told of the hand-over, or of the whole job, where there is one."""

    record: RolloutRecord
    hand_over: HandOverReport | None
    job: JobResult | None = None


def play_station(station: Station, seconds: float) -> Run:
    """Run of a logging station: `seconds` at most after its pick-up, ends shortly after success, fall or drop."""
    if station.controller_name == "job":
        return _play_job(station)
    simulator = Simulator(station)
    context = simulator.get_context()
    adaptor = station.GetSubsystemByName("state_adaptor")
    referee = Referee(station)
    state, of_adaptor = adaptor.GetOutputPort("robot_state"), adaptor.GetMyContextFromRoot(context)
    goal, end = np.array(station.scene.goal), np.inf
    begun = None if station.pick is not None else 0.0
    while context.get_time() < end:
        simulator.AdvanceTo(context.get_time() + CHECK_S)
        now, x = context.get_time(), np.asarray(state.Eval(of_adaptor))
        if begun is None and _held(station, simulator):
            begun = now
        limit = PICK_S if begun is None else begun + (HELD_S if station.controller_name == "pickup" else seconds)
        failed = referee(x)
        if begun is None:
            over = failed == "fall" or x[OBJECT_POS][2] < station.config.support_height_m
        else:
            over = bool(failed) or arrived(np.linalg.norm(x[:2] - goal))
        end = min(end, limit, now + AFTER_S if over else np.inf)
    hands_over = station.controller_name == "pickup_then_policy"
    report = report_hand_over(station, read_logs(station, context)) if hands_over else None
    who = f"{station.controller_name}: {report.who}" if report else station.controller_name
    return Run(record=to_record(station, context, policy=who), hand_over=report)


def _play_job(station: Station) -> Run:
    """Run of a whole job, and a moment after it; its outcome is the referee's."""
    simulator = Simulator(station)
    result = run_job(station, simulator)
    simulator.clear_monitor()
    simulator.AdvanceTo(simulator.get_context().get_time() + AFTER_S)
    outcome = result.outcome if result.outcome in OUTCOMES else "timeout"
    record = to_record(station, simulator.get_context(), outcome=outcome, policy=f"job: {result}")
    return Run(record=record, hand_over=None, job=result)


class Referee:
    """Says what is wrong with a robot state (84,), as `Judge.failure`."""

    def __init__(self, station: Station) -> None:
        self._model = builder.build_model(station.carry.carried, joints=29, floor=False)
        self._data, self._judge = mujoco.MjData(self._model), Judge(self._model)

    def __call__(self, state: np.ndarray) -> str:
        self._data.qpos[:], self._data.qvel[:] = state[:NQ], state[NQ:]
        mujoco.mj_kinematics(self._model, self._data)
        return self._judge.failure(self._data)


def _held(station: Station, simulator: Simulator) -> bool:
    """Whether the pick-up is over: handed over, or holding."""
    from hotice.control.pickup import PHASES

    hands_over = station.controller_name == "pickup_then_policy"
    system = station.GetSubsystemByName("mode_selector" if hands_over else "pickup")
    port = system.GetOutputPort("mode" if hands_over else "phase")
    value = port.Eval(system.GetMyContextFromRoot(simulator.get_context()))[0]
    return bool(value > 0 if hands_over else value == PHASES.index("hold"))
