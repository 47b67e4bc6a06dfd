"""Data-parallel training: several processes, each with environments of its own, that learn as one.

    torchrun --nproc-per-node 4 -m hotice.learn train --physics warp --num-envs 8192 ...

starts four ranks (on GPUs: one each). Every rank fills its own rollout; gradients are averaged, the moments that
normalise observations and advantages are taken over all ranks, and so is the KL divergence that leads the learning
rates: a step is that of one process whose minibatch is the ranks' minibatches joined, up to rounding. Each rank
shuffles its own rows, so a minibatch holds as many of every rank, where one process would mix all; and each estimates
the mirror loss from `MIRROR_ROWS` of its own rows or a few more. Networks stay equal, and rank 0 alone shows progress
and writes checkpoints, which hold the environments of all. Without torchrun there is one rank and every function here
returns what it was given.
"""

from __future__ import annotations

import atexit
import importlib
import os
from collections.abc import Iterable

import safetensors.torch
import torch
import torch.distributed as dist
from torch import Tensor, nn

SEED_STRIDE = 1_000_003
"""Between the seeds of two ranks."""


def start(device: str) -> str:
    """Joins the other ranks if torchrun has started several; returns this rank's device ("cuda": its own GPU)."""
    if wanted() == 1 or not dist.is_available():
        return device
    if device == "cuda":
        device = f"cuda:{os.environ['LOCAL_RANK']}"
        torch.cuda.set_device(device)
    if not dist.is_initialized():
        # Functions of this module keep, as a default, the group that they find when it is imported, and with it gloo's
        # threads; those may abort a process whose interpreter ends. Torch imports it at the first update: too late.
        importlib.import_module("torch.distributed.nn")
        dist.init_process_group("cpu:gloo,cuda:nccl" if device.startswith("cuda") else "gloo")
        atexit.register(dist.destroy_process_group)
    return device


def leads() -> bool:
    """Whether this process is, or will be once it joins the others, the first rank."""
    return int(os.environ.get("RANK", "0")) == 0


def wanted() -> int:
    """Number of processes that torchrun has started, whether they have joined or not."""
    return int(os.environ.get("WORLD_SIZE", "1"))


def rank() -> int:
    """Number of this process, from 0."""
    return dist.get_rank() if _several() else 0


def size() -> int:
    """Number of processes that learn together."""
    return dist.get_world_size() if _several() else 1


def concatenate(x: Tensor) -> Tensor:
    """The rows of all ranks (R N, ...) from the rows (N, ...) of each, in the order of the ranks."""
    if not _several():
        return x
    parts = [torch.empty_like(x) for _ in range(size())]
    dist.all_gather(parts, x.contiguous())
    return torch.cat(parts)


def mean(x: Tensor) -> Tensor:
    """Mean over the ranks."""
    return concatenate(x[None]).mean(dim=0) if _several() else x


def add_up(counters: Iterable[Tensor]) -> None:
    """Replaces counters by their sums over all ranks."""
    if _several():
        for counter in counters:
            dist.all_reduce(counter)


def any_rank(*flags: bool) -> list[bool]:
    """Each flag as true if it is so on any rank: what all of them decide by."""
    if not _several():
        return list(flags)
    votes = torch.tensor(flags, dtype=torch.int32)
    dist.all_reduce(votes, dist.ReduceOp.MAX)
    return [bool(v) for v in votes]


def average_gradients(parameters: Iterable[nn.Parameter]) -> None:
    """Replaces gradients by their means over the ranks, in one exchange. Frozen parameters have none, on every rank."""
    if not _several():
        return
    gradients = [p.grad for p in parameters if p.grad is not None]
    flat = torch.cat([g.flatten() for g in gradients])
    dist.all_reduce(flat)
    for gradient, part in zip(gradients, (flat / size()).split([g.numel() for g in gradients]), strict=True):
        gradient.copy_(part.view_as(gradient))


def share(module: nn.Module) -> None:
    """Gives every rank the weights and buffers of rank 0."""
    if _several():
        for tensor in module.state_dict().values():
            dist.broadcast(tensor, src=0)


def collect(tensors: dict[str, Tensor]) -> list[dict[str, Tensor]]:
    """The tensors of all ranks, in their order, on the CPU; they travel as safetensors."""
    if not _several():
        return [tensors]
    content = bytearray(safetensors.torch.save({k: v.detach().cpu().contiguous() for k, v in tensors.items()}))
    lengths = concatenate(torch.tensor([len(content)]))
    padded = torch.zeros(1, int(lengths.max()), dtype=torch.uint8)
    padded[0, : len(content)] = torch.frombuffer(content, dtype=torch.uint8)
    rows = concatenate(padded)
    return [safetensors.torch.load(row[:n].numpy().tobytes()) for row, n in zip(rows, lengths.tolist(), strict=True)]


def _several() -> bool:
    return dist.is_available() and dist.is_initialized() and dist.get_world_size() > 1
