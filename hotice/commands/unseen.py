"""Success and distance on unseen scenes against their similarity to the training scenes (paper, V-A, unseen scenes).

Training scenes are those of the policy's own record. A scene can be new and yet of a kind that was trained on: scenes
whose family was trained on and scenes whose family was not are reported apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hotice.errors import InvalidConfig
from hotice.evaluate.trials import success_interval
from hotice.fields.bank import FieldBank
from hotice.fields.similarity import similarity_matrix
from hotice.learn.checkpoints.trained_on import TrainedOn
from hotice.learn.checkpoints.training_scenes import TrainingScenes
from hotice.model.generate.family_names import family_of
from hotice.model.scene import Scene
from hotice.model.scene_digest import scene_digest

AT_A_TIME = 100
"""Training scenes whose fields are held together; a line may have a thousand."""


@dataclass(frozen=True, kw_only=True)
class Group:
    """Unseen scenes that stand alike to what was trained on, and how they are drawn."""

    title: str
    marker: str
    color: str


GROUPS = {
    "family_trained_on": Group(title="family trained on", marker="o", color="#334155"),
    "family_not_trained_on": Group(title="family not trained on", marker="^", color="#d9480f"),
    "family_unknown": Group(title="of no known family", marker="s", color="#7c8798"),
    "scene_trained_on": Group(title="itself trained on: not unseen", marker="x", color="#b91c1c"),
}


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The line y = slope x + intercept of least squares, and the root mean square of what it leaves."""

    slope: float
    intercept: float
    rmse: float

    @classmethod
    def of(cls, x: ArrayLike, y: ArrayLike) -> Fit:
        """Fits (n,) to (n,). Raises `InvalidConfig` for fewer than two different x."""
        x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        if len(np.unique(x)) < 2:
            raise InvalidConfig(f"{len(x)} scenes of {len(np.unique(x))} similarities: a line needs two that differ")
        slope, intercept = np.polyfit(x, y, 1)
        rest = y - (slope * x + intercept)
        return cls(slope=float(slope), intercept=float(intercept), rmse=float(np.sqrt(np.mean(rest**2))))


def group_of(scene: Scene, trained_on: TrainedOn) -> str:
    """Key of `GROUPS` for an unseen scene."""
    if trained_on.holds(scene_digest(scene)):
        return "scene_trained_on"
    family = family_of(scene.name)
    if family is None:
        return "family_unknown"
    return "family_trained_on" if family in trained_on.families else "family_not_trained_on"


def similarities(unseen: Sequence[Scene], training: Sequence[Scene]) -> list[dict[str, Any]]:
    """For each unseen scene its name, largest similarity to the training scenes, and which of them that is."""
    bank = FieldBank.build(unseen)
    parts = [training[i : i + AT_A_TIME] for i in range(0, len(training), AT_A_TIME)]
    matrix = np.concatenate([similarity_matrix(bank, FieldBank.build(part)) for part in parts], axis=1)
    return [
        {"name": scene.name, "similarity": float(matrix[i, j]), "nearest": training[j].name}
        for i, (scene, j) in enumerate(zip(unseen, matrix.argmax(axis=1).tolist(), strict=True))
    ]


def compared(unseen: Sequence[Scene], trained_on: TrainedOn) -> dict[str, Any]:
    """Similarity, family and group of each unseen scene to exactly what was trained on, and what of that is missing.

    Raises `CheckpointError` where not one training scene can be made again.
    """
    training = TrainingScenes.of(trained_on)
    points = [
        row | {"family": family_of(scene.name), "group": group_of(scene, trained_on)}
        for row, scene in zip(similarities(unseen, training.scenes), unseen, strict=True)
    ]
    left_out = [asdict(gone) for gone in training.left_out]
    return {
        "points": points,
        "training": {"compared": len(training.scenes), "left_out": left_out, **trained_on.summary()},
    }


def unseen_points(nearest: dict[str, Any], report: dict[str, Any]) -> dict[str, Any]:
    """Points of the figure, their fits and the rates of each group, JSON-ready.

    `nearest`: of `compared`; `report`: of `evaluate`, on the same scenes in the same order.
    """
    kept = ("success_rate", "success_interval_95", "mean_distance_m", "rollouts")
    points = [row | {k: scene[k] for k in kept} for row, scene in zip(nearest["points"], report["scenes"], strict=True)]
    x = [p["similarity"] for p in points]
    fits = {name: vars(Fit.of(x, [p[name] for p in points])) for name in ("success_rate", "mean_distance_m")}
    groups = {key: _rates([p for p in points if p["group"] == key]) for key in GROUPS}
    return {**nearest, "points": points, "fits": fits, "groups": {k: v for k, v in groups.items() if v["scenes"]}}


def _rates(points: list[dict[str, Any]]) -> dict[str, Any]:
    """Success rate over all trials of some scenes with its 95 % Wilson interval, and means over trials and scenes."""
    trials = sum(p["rollouts"] for p in points)
    successes = sum(round(p["success_rate"] * p["rollouts"]) for p in points)
    low, high = success_interval(successes, trials)
    return {
        "scenes": len(points),
        "rollouts": trials,
        "success_rate": successes / max(1, trials),
        "success_interval_95": [round(low, 4), round(high, 4)],
        "mean_distance_m": sum(p["mean_distance_m"] * p["rollouts"] for p in points) / max(1, trials),
        "mean_similarity": sum(p["similarity"] for p in points) / max(1, len(points)),
        "families": sorted({p["family"] for p in points if p["family"] is not None}),
    }
