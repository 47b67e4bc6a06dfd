"""Independence of trials of the same number in different scenes: the spread of success over trial numbers.

If they are, the mean success over S scenes of one trial number has the variance Σ p (1 − p) / S², p being the rates of
scenes. If robots, noise or pushes were shared by scenes, lucky numbers would be lucky in all of them, and a report's
intervals too short.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from hotice.errors import InvalidConfig
from hotice.evaluate.trials import Trials


def spread_ratio(success: ArrayLike) -> float:
    """Spread of the mean over scenes, by trial number, in units of independent trials'; `success` (S, T) bool.

    Both are standard deviations over the trial numbers.

    Raises `InvalidConfig` without two trials, or where every scene has a rate of 0 or 1.
    """
    won = np.asarray(success, dtype=float)
    if won.ndim != 2 or won.shape[0] < 1 or won.shape[1] < 2:
        raise InvalidConfig(f"success has the shape {won.shape}: scenes and trials, at least two, are needed")
    binomial = won.var(axis=1, ddof=1).sum() / len(won) ** 2
    if binomial == 0:
        raise InvalidConfig("every scene has a rate of 0 or 1: no spread to compare")
    return float(np.sqrt(won.mean(axis=0).var(ddof=1) / binomial))


def success_table(evaluations: Sequence[Mapping[str, Trials]], referee: str = "exact") -> np.ndarray:
    """Successes (S, T) of evaluations of the same scenes, trials by scene each; the trials of all seeds side by side.

    Raises `InvalidConfig` where scenes or numbers of trials differ, or the referee `points` was not asked.
    """
    names = list(evaluations[0])
    rows: list[list[bool]] = [[] for _ in names]
    for trials in evaluations:
        counts = {t.rollouts for t in trials.values()}
        if sorted(trials) != sorted(names) or len(counts) != 1:
            raise InvalidConfig(
                f"scenes {', '.join(trials)} of {sorted(counts)} trials: all trials of the same scenes are needed "
                "each time"
            )
        for row, name in zip(rows, names, strict=True):
            outcome = trials[name].points if referee == "points" else trials[name].outcome
            if not outcome:
                raise InvalidConfig(f"{name}: the referee points was not asked")
            row += [o == "success" for o in outcome]
    return np.array(rows)
