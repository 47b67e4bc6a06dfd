"""Teachers of a student: trained policies, each for the scenes that it was trained on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hotice.errors import CheckpointError
from hotice.learn.checkpoints.checkpoint import read_meta, resolve
from hotice.learn.checkpoints.widen import columns_within
from hotice.learn.policy import TorchPolicy, check_layout, torch_policy
from hotice.learn.ppo.networks import ActorCritic
from hotice.sim.env import TransportEnv
from hotice.task.contract import STEP, UNITS


def contract(task: Mapping[str, Any]) -> dict[str, Any]:
    """Fields that policies must share, of a `TaskConfig` as JSON-ready values: `UNITS` and the control period.

    The physics step in between is free: most of a run may be simulated in coarse steps and its end in fine ones.
    """
    steps = tuple(task.get(name) for name in STEP)
    period = None if None in steps else round(steps[0] * steps[1], 9)  # type: ignore[operator]
    return {"control period": period, **{name: task.get(name) for name in UNITS}}


@dataclass(frozen=True, kw_only=True)
class Teachers:
    """K frozen policies and who teaches where.

    nets: their networks. columns: what each reads of the student's observation, (O_k,). std (K, 20): their standard
    deviations. of_scene (S,): the teacher of each scene of the student's task. sources: checkpoint folder of each and
    the SHA-256 of its tensors.
    """

    nets: tuple[ActorCritic, ...]
    columns: tuple[Tensor, ...]
    std: Tensor
    of_scene: Tensor
    sources: dict[str, str]

    @classmethod
    def load(
        cls, specialists: Sequence[Path], generalist: Path | None, env: TransportEnv, task: dict[str, Any], preset: str
    ) -> Teachers:
        """Reads checkpoints (or the newest of runs) and gives every scene of `env` its teacher.

        A teacher may read fewer rows than the student, which may have a history, say, that the teacher does not need.

        Of the specialists that were trained on a scene, the one with the fewest scenes teaches there (of equals the
        first); scenes that none of them knows are the generalist's. Only those that teach somewhere are kept.

        Args:
            specialists, generalist: checkpoint folders or runs.
            env: the student's. task: its `TaskConfig` as JSON-ready values. preset: of the student.

        Raises:
            CheckpointError: no checkpoint there; another preset, observation or meaning of the action; scenes without
                teacher.
        """
        folders = [resolve(path) for path in specialists]
        known = [read_meta(folder).get("scenes", []) for folder in folders]
        chosen = [
            min((k for k in range(len(folders)) if name in known[k]), key=lambda k: len(known[k]), default=-1)
            for name in env.bank.names
        ]
        orphans = [name for name, k in zip(env.bank.names, chosen, strict=True) if k < 0]
        if orphans and generalist is None:
            raise CheckpointError(
                f"no teacher was trained on {', '.join(orphans[:8])}{', …' if len(orphans) > 8 else ''} "
                f"({len(orphans)} of {len(chosen)} scenes): give its run among the teachers, or a generalist's for "
                "all the rest"
            )
        if orphans and generalist is not None:
            folders.append(resolve(generalist))
            chosen = [k if k >= 0 else len(folders) - 1 for k in chosen]
        used = sorted(set(chosen))
        policies = [torch_policy(folders[k]) for k in used]
        for policy in policies:
            check_contract(policy, task, preset)
        columns = tuple(columns_in(policy, env.policy_table.layout()).to(env.device) for policy in policies)
        nets = tuple(policy.net.to(env.device) for policy in policies)
        return cls(
            nets=nets,
            columns=columns,
            std=torch.stack([net.std().detach() for net in nets]),
            of_scene=torch.tensor([used.index(k) for k in chosen], device=env.device),
            sources={str(folders[k]): read_meta(folders[k])["sha256"] for k in used},
        )

    @torch.no_grad()
    def label(self, obs: Tensor, scene: Tensor) -> tuple[Tensor, Tensor]:
        """Means (B, 20) of true, raw observations (B, O) in scenes (B,), and which teacher (B,) they are of."""
        teacher = self.of_scene[scene]
        mean = torch.empty(len(obs), self.std.shape[1], device=obs.device)
        for k, (net, columns) in enumerate(zip(self.nets, self.columns, strict=True)):
            rows = torch.nonzero(teacher == k).squeeze(1)
            mean[rows] = net.act(obs[rows][:, columns])
        return mean, teacher


def columns_in(policy: TorchPolicy, layout: list[tuple[str, int]]) -> Tensor:
    """Where the rows of a teacher are in the student's `layout`. Raises `CheckpointError` where one is missing."""
    columns = columns_within(policy.meta["layout"], layout)
    if columns is None:  # then this raises, about what the teacher misses alone
        read = dict(policy.meta["layout"])
        check_layout(policy, [row for row in layout if row[0] in read])
    assert columns is not None
    return columns


def check_contract(policy: TorchPolicy, task: dict[str, Any], preset: str) -> None:
    """Raises `CheckpointError` unless a teacher has the student's preset, action and observation units."""
    if policy.meta["preset"] != preset:
        raise CheckpointError(f"{policy.name}: teaches {policy.meta['preset']!r}, the student is {preset!r}")
    theirs = contract(policy.meta["task"])
    for name, value in contract(task).items():
        if theirs[name] != value:
            raise CheckpointError(f"{policy.name}: was trained with {name} {theirs[name]!r}, the student has {value!r}")
