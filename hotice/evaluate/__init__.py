"""Scored trials of policies and of the walking baseline, referees, seeds, statistics, reports."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.evaluate.conditions import Conditions
    from hotice.evaluate.config import EvaluateConfig
    from hotice.evaluate.record import record_rollouts
    from hotice.evaluate.referees import REFEREES, Verdict
    from hotice.evaluate.report import make_report, print_report
    from hotice.evaluate.run import evaluate
    from hotice.evaluate.spread import spread_ratio, success_table
    from hotice.evaluate.trials import Trials, read_trials, success_interval
    from hotice.evaluate.walk_trials import run_trial
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "Conditions",
    "EvaluateConfig",
    "REFEREES",
    "Trials",
    "Verdict",
    "evaluate",
    "make_report",
    "print_report",
    "read_trials",
    "record_rollouts",
    "run_trial",
    "spread_ratio",
    "success_interval",
    "success_table",
]
