"""Log of trials that run side by side, step by step, until none has anything left to show."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from hotice.evaluate import referees
from hotice.evaluate.referees import STAY_S, Signals
from hotice.evaluate.trials import Trials
from hotice.fields.bank import FieldBank
from hotice.sim.batch_env import Step
from hotice.sim.moving import MovingObstacles
from hotice.sim.snapshot import NUM_SGF
from hotice.task.rules import OUTCOMES, STANDS_S, arrived

BODY_POINTS = NUM_SGF + 2
"""Points of the body that the points rule looks at: the keypoints of the SGF and the hands, the first of
`snapshot.POINTS`."""


class TrialLog:
    """Collects the signals of N trials and says which of them go on.

    A trial goes on to its time limit, and at least `STAY_S` after its arrival, unless it falls, drops or diverges. A
    contact before the arrival ends it where the exact referee is alone.

    Args:
        bank: fields of the one scene. limit: control steps of a trial. control_dt_s: their length. names: referees.
        moving: what moves in the scene, if anything.
    """

    def __init__(
        self,
        bank: FieldBank,
        trials: int,
        limit: int,
        control_dt_s: float,
        names: Sequence[str] = referees.REFEREES,
        moving: MovingObstacles | None = None,
    ) -> None:
        self.moving = moving
        self.bank, self.limit, self.dt_s, self.names = bank, limit, control_dt_s, tuple(names)
        self.stay = round(STAY_S / control_dt_s)
        self.running = np.ones(trials, dtype=bool)
        self.failed = np.zeros(trials, dtype=bool)
        self.arrived_at = np.zeros(trials, dtype=np.int64)
        """Control step of the arrival, 0 before it and of trials that failed first."""
        self.steps: list[Signals] = []
        self.places: deque[np.ndarray] = deque(maxlen=1 + round(STANDS_S / control_dt_s))
        """Where the roots were in the last half second, x, y (N, 2) each."""

    def see(self, signals: Signals) -> int:
        """Adds a control step (N,); returns how many trials are over with it."""
        self.steps.append(signals)
        now = len(self.steps)
        self.failed |= (self.arrived_at == 0) & (signals.over | signals.robot_hit | signals.object_hit)
        arrives = (self.arrived_at == 0) & ~self.failed & arrived(signals.goal_m) & (now <= self.limit)
        self.arrived_at[arrives] = now
        until = np.where(self.arrived_at > 0, np.maximum(self.limit, self.arrived_at + self.stay), self.limit)
        ends = signals.over | (now >= until)
        if "points" not in self.names:
            ends |= self.failed
        ended = int((self.running & ends).sum())
        self.running &= ~ends
        return ended

    def gaps(self, body_W: Tensor, load_W: Tensor) -> tuple[np.ndarray, np.ndarray]:
        """Lowest signed distance [m] of points (N, K, 3) of body and load, (N,) each; inf where not needed.

        They are where they are after the step that is to be added.
        """
        if "points" not in self.names or not any(s.obstacles for s in self.bank.scenes):
            nowhere = np.full(len(body_W), np.inf)
            return nowhere, nowhere
        scene = torch.zeros(len(body_W), dtype=torch.int64)
        world = self.bank
        if self.moving is not None:
            now_s = (len(self.steps) + 1) * self.dt_s
            world = self.moving.world(scene, torch.full((len(body_W),), now_s))
        depth = world.signed_distance(scene, torch.cat([body_W, load_W], dim=1).float().contiguous())
        body, load = depth.split([body_W.shape[1], load_W.shape[1]], dim=1)
        return body.amin(dim=1).numpy(), load.amin(dim=1).numpy()

    def way(self, place_m: np.ndarray) -> np.ndarray:
        """How far roots, now at (N, 2) [m], have come in the last half second, (N,) [m]; to be asked in each step."""
        self.places.append(place_m.copy())
        return np.linalg.norm(place_m - self.places[0], axis=1)

    def see_step(self, step: Step) -> int:
        """Adds a step of an environment that ends nothing at goal or contact; returns how many trials it ended."""
        seen, outcome = step.seen, step.outcome.numpy()
        robot_gap_m, object_gap_m = self.gaps(seen.p_WK[:, :BODY_POINTS], seen.p_WOK)
        return self.see(
            Signals(
                fall=outcome == OUTCOMES.index("fall"),
                drop=outcome == OUTCOMES.index("drop"),
                unstable=outcome == OUTCOMES.index("unstable"),
                robot_hit=seen.robot_hit.numpy(),
                object_hit=seen.object_hit.numpy(),
                robot_gap_m=robot_gap_m,
                object_gap_m=object_gap_m,
                goal_m=step.goal_distance.numpy(),
                self_depth_m=step.self_depth.numpy(),
                met=seen.met.numpy(),
                way_m=self.way(seen.p_WP[:, :2].numpy()),
            )
        )

    @property
    def signals(self) -> Signals:
        """All of it, (T, N)."""
        return Signals.stacked(self.steps)

    def trials(self) -> Trials:
        """Verdicts of the referees on all of it, when no trial goes on."""
        signals = self.signals
        verdict = referees.exact(signals, self.limit)
        at = (verdict.step - 1, np.arange(len(verdict.step)))
        after = referees.afterwards(signals, self.limit, self.stay)
        by_points = referees.points(signals, self.limit).outcome if "points" in self.names else ()
        return Trials(
            outcome=verdict.outcome,
            distance_m=tuple(signals.goal_m[at].tolist()),
            time_s=tuple(round(n * self.dt_s, 6) for n in verdict.step.tolist()),
            distance_at_limit_m=tuple(after.distance_m.tolist()),
            standing=tuple(after.standing.tolist()),
            stayed=tuple(after.stayed.tolist()),
            points=by_points,
            self_depth_m=tuple(referees.deepest(signals, verdict).tolist()),
        )
