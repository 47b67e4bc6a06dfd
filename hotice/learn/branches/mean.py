"""One checkpoint from those of several branches of a run, to go on from: all that they share, averaged.

As in `hotice.learn.checkpoints.merge`, weights are averaged one by one, and the running average of what acts is the
mean of the branches' running averages: what is evaluated is what `hotice merge` would make of them. Beside that:

- Weights that go on are the mean of the newest ones, critics included.
- Normalisers of observations are joined by their counts, as one normaliser that has seen what all have seen; its count
  is their mean, so that it forgets as slowly as one branch's does.
- Moments and learning rates of the optimiser stay each branch's own (as in DiLoCo). Their means are kept for what has
  none: a branch that is started again, and a run that begins from this one.
- Success rates of scenes are averaged; of a curriculum in stages the lowest rung counts.
- Episodes under way and random numbers are each branch's own. What others need of them (a run that goes on as one
  process) is the first branch's.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from hotice.learn.checkpoints.merge import EPISODES, mean_of

NORMALISERS = ("net.obs_norm.", "net.critic_norm.")
AVERAGED = ("net.", "average.", "optimizer.", "curriculum", "stages.")
RUNGS = ("stages.distance", "stages.objects")
_EPISODES = re.compile(EPISODES)


def mean_tensors(parts: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Tensors of the average of branches, from those of a checkpoint of each, in their order."""
    first = parts[0]
    merged: dict[str, Tensor] = {}
    for name, value in first.items():
        if _EPISODES.match(name):
            continue
        others = [part[name] for part in parts if name in part]
        if name in RUNGS:
            merged[name] = torch.stack(others).amin(dim=0)
        elif name.startswith(AVERAGED) and value.is_floating_point():
            merged[name] = mean_of(others)
        else:
            merged[name] = value
    for prefix in NORMALISERS:
        merged |= joined_normaliser(prefix, parts)
    return merged


def joined_normaliser(prefix: str, parts: Sequence[Mapping[str, Tensor]]) -> dict[str, Tensor]:
    """Mean, variance and count of the union of what normalisers have seen; `prefix`: of their names."""
    means, variances = ([part[prefix + name].double() for part in parts] for name in ("mean", "var"))
    counts = torch.stack([part[prefix + "count"].double() for part in parts])
    shares = counts / counts.sum()
    mean = (shares[:, None] * torch.stack(means)).sum(dim=0)
    # the means of the parts differ: that adds to the variance of the whole
    within = torch.stack(variances) + (torch.stack(means) - mean).square()
    joined = {"mean": mean, "var": (shares[:, None] * within).sum(dim=0), "count": counts.mean()}
    return {prefix + name: value.to(parts[0][prefix + name].dtype) for name, value in joined.items()}


def mean_meta(metas: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Meta of the average: the first branch's, with the means of what follows learning."""
    own = {k: v for k, v in metas[0].items() if k not in ("format", "sha256", "update", "branch")}
    rates = [meta["learning_rates"] for meta in metas]
    own["learning_rates"] = [sum(each) / len(each) for each in zip(*rates, strict=True)]
    own["skipped"] = sum(int(meta["skipped"]) for meta in metas)
    return own


def spread(before: Mapping[str, Tensor], parts: Sequence[Mapping[str, Tensor]]) -> tuple[float, float]:
    """How far the mean of the branches' weights is from the last average, and the branches from their mean.

    Both as Euclidean lengths over all weights, the second as the root mean square over the branches.
    """
    way = apart = 0.0
    for name in (n for n in before if n.startswith("net.nets.")):
        stacked = torch.stack([part[name].double() for part in parts])
        mean = stacked.mean(dim=0)
        way += float((mean - before[name].double()).square().sum())
        apart += float((stacked - mean).square().sum()) / len(parts)
    return way**0.5, apart**0.5
