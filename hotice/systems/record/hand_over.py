"""Report of a station's hand-over from its logs: when, to whom and why, and whether the hands kept the object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from hotice.errors import NotAvailable
from hotice.model import builder
from hotice.systems.hand_over.mode_selector import MODES
from hotice.systems.hand_over.stage import VERDICTS
from hotice.systems.logs import SignalLog
from hotice.systems.signals import NQ
from hotice.task.judge import Judge

if TYPE_CHECKING:
    from hotice.systems.station.make import Station


@dataclass(frozen=True, kw_only=True)
class HandOverReport:
    """A hand-over, or the decision against one.

    Attributes:
        who: of `MODES`, who commands at the end. time_s: of the decision, None where there was none.
        verdict: of `VERDICTS`, why the policy was not let, "fit" where it was, empty without a decision.
        failure: empty, or what happened: no hand-over, or a fall, a drop or a diverged state.
        failed_s: after the decision, where it failed.
        walk_verdict: of `VERDICTS`, how the walk's rehearsal ended, empty where there was none.
    """

    who: str
    time_s: float | None
    verdict: str
    failure: str
    failed_s: float | None = None
    walk_verdict: str = ""

    @property
    def fell_back(self) -> bool:
        """Whether the walking baseline carried on instead of the policy."""
        return self.who == "walk"

    @property
    def held(self) -> bool:
        """Whether neither was fit, so that the pick-up kept holding the object."""
        return self.who == "hold"

    def __str__(self) -> str:
        if self.time_s is None:
            return self.failure
        end = f"{self.failure} {self.failed_s:.1f} s later" if self.failure else "kept the object"
        why = f"policy rehearsal: {_words(self.verdict)}"
        if self.held:
            walk = f"walk: {'no path' if self.walk_verdict == 'no_way' else _words(self.walk_verdict)}"
            return f"{self.time_s:.1f} s: no hand-over, the pick-up keeps holding ({why}; {walk}), {end}"
        return f"{self.time_s:.1f} s: handed over to the {self.who}{f' ({why})' if self.fell_back else ''}, {end}"


def _words(verdict: str) -> str:
    return verdict.replace("_", " ")


def report_hand_over(station: Station, logs: Mapping[str, SignalLog]) -> HandOverReport:
    """Report of a station's logs. Raises `NotAvailable` where its controller hands nothing over."""
    if "mode_selector.mode" not in logs:
        raise NotAvailable(f"controller {station.controller_name!r} hands nothing over: use pickup_then_policy")
    mode, state = logs["mode_selector.mode"], logs["state_adaptor.robot_state"].value
    after = np.flatnonzero(mode.value[:, 0] > 0)
    if not len(after):
        return HandOverReport(who=MODES[0], time_s=None, verdict="", failure=_why_not(station, logs))
    first, tried = int(after[0]), int(logs["mode_selector.walk_verdict"].value[-1, 0])
    failure, row = _failure(station, state[first:, :NQ])
    return HandOverReport(
        who=MODES[int(mode.value[-1, 0])],
        time_s=float(mode.time_s[first]),
        verdict=VERDICTS[max(int(logs["mode_selector.verdict"].value[-1, 0]), 0)],
        failure=failure,
        failed_s=float(mode.time_s[first + row] - mode.time_s[first]) if failure else None,
        walk_verdict=VERDICTS[tried] if tried >= 0 else "",
    )


def _failure(station: Station, qpos: np.ndarray) -> tuple[str, int]:
    """First fault in states (T, 43), and its state; empty for none."""
    model = builder.build_model(station.carry.carried, joints=29, floor=False)
    data, referee = mujoco.MjData(model), Judge(model)
    for row, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        if failed := referee.failure(data):
            return failed, row
    return "", 0


def _why_not(station: Station, logs: Mapping[str, SignalLog]) -> str:
    from hotice.control.pickup import PHASES

    phase = int(logs["pickup.phase"].value[-1, 0])
    if _failure(station, logs["state_adaptor.robot_state"].value[-1:, :NQ])[0] == "fall":
        return "the robot fell while picking up"
    return f"no hand-over: the pick-up ended in phase {PHASES[phase] if phase >= 0 else 'none'}"
