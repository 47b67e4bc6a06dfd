"""A policy as a thing that acts on tensors: from a checkpoint, or from an ONNX file (`hotice.policy.policy_file`)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor

from hotice.errors import CheckpointError, UnknownName
from hotice.files import is_file, is_folder
from hotice.learn.checkpoints.average import averaged
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.checkpoints.health import check_weights
from hotice.learn.checkpoints.lineage import total_steps
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn
from hotice.learn.ppo.networks import ActorCritic
from hotice.policy import policy_file
from hotice.policy.policy_file import (
    FORMAT,
    POLICIES,
    PolicySession,
    shipped_policies,
)
from hotice.task.policy_task import PolicyTask
from hotice.task.presets import get_preset


class Policy(Protocol):
    """Deterministic policy. `meta` has preset, layout (names and widths of the observation) and task constants."""

    name: str
    meta: dict[str, Any]

    def act(self, obs: Tensor) -> Tensor:
        """Actions (N, 20) of raw observations (N, O)."""
        ...


@dataclass
class TorchPolicy:
    """Networks of a checkpoint."""

    name: str
    meta: dict[str, Any]
    net: ActorCritic

    @torch.no_grad()
    def act(self, obs: Tensor) -> Tensor:
        return self.net.act(obs)


class OnnxPolicy:
    """Exported policy, run by onnxruntime on the CPU; `content`: the file's bytes, read from `path` if not given."""

    def __init__(self, path: Path, name: str | None = None, threads: int = 0, content: bytes | None = None) -> None:
        self._session = PolicySession(path, name, threads, content)
        self.name, self.meta = self._session.name, self._session.meta
        PolicyTask.from_meta(self.meta, self.name)

    def act(self, obs: Tensor) -> Tensor:
        return torch.from_numpy(self._session.run(obs.detach().cpu().float().numpy())).to(obs.device)


def load_policy(name_or_path: str | Path, threads: int = 0) -> Policy:
    """A shipped policy by name, an ONNX file (run by `threads` threads, 0: all cores), a checkpoint folder or a run.

    Raises `CheckpointError` or `UnknownName`.
    """
    text = str(name_or_path)
    if text in shipped_policies():
        return OnnxPolicy(POLICIES / f"{text}.onnx", text, threads)
    path = Path(text)
    if is_folder(text):
        return torch_policy(path)
    if path.suffix == ".onnx" or is_file(path):
        return OnnxPolicy(path, threads=threads)
    if len(path.parts) > 1:
        raise CheckpointError(f"{path}: no such policy file or checkpoint folder")
    raise UnknownName("policy", text, shipped_policies(), "the path of an .onnx file or a checkpoint folder")


def torch_policy(path: Path) -> TorchPolicy:
    """The policy of a checkpoint: the average of its weights, where it has one.

    Raises `CheckpointError`, also for constants of its task that are missing or impossible.
    """
    tensors, meta = load_checkpoint(path)
    try:
        config = meta["config"]
        obs = sum(width for _, width in meta["layout"])
        critic = sum(width for _, width in meta["critic_layout"])
        net = ActorCritic(
            get_preset(config["preset"]).agents,
            obs,
            critic,
            config["hidden"],
            config["critic_hidden"],
            tuple(config["init_std"]),
        )
        check_weights(path, tensors)
        weights = {k.removeprefix("net."): v for k, v in averaged(tensors).items() if k.startswith("net.")}
        net.load_state_dict(weights)
        described = policy_meta(meta)
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(
            f"{path}: is no checkpoint of this version: {str(error).splitlines()[-1].strip()}"
        ) from None
    PolicyTask.from_meta(described, str(path))
    net.eval()
    return TorchPolicy(str(path), described, net)


def policy_meta(meta: dict[str, Any]) -> dict[str, Any]:
    """Metadata of a policy file, from a checkpoint's meta."""
    config = meta["config"]
    known = TrainedOn.of_meta(meta, str(meta.get("sha256", "")))
    return {
        "format": FORMAT,
        "preset": config["preset"],
        "layout": [list(row) for row in meta["layout"]],
        "task": config["task"],
        "trained": {
            "steps": meta["steps"],
            "total_steps": total_steps(meta),
            "updates": meta["update"],
            "minutes": round(meta["minutes"], 1),
            "seed": config["seed"],
            "scenes": config["scenes"],
            "source": meta["source"],
            "on": known.summary(),
        },
        **({TRAINED_ON: meta[TRAINED_ON]} if TRAINED_ON in meta else {}),
    }


def check_layout(policy: Policy, layout: list[tuple[str, int]]) -> None:
    """Raises `CheckpointError` unless the policy reads exactly this observation."""
    policy_file.check_layout(policy.name, policy.meta["layout"], layout)
