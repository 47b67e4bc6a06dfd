"""Whether the networks of a checkpoint fit a run, and taking them over where they do."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from torch import Tensor

from hotice.errors import CheckpointError
from hotice.failures import ran_out_of_memory
from hotice.learn.checkpoints.health import check_weights
from hotice.learn.checkpoints.widen import columns_within, widen
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.train.run import Run
from hotice.policy.policy_file import check_layout


def load_networks(run: Run, path: Path, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
    """Takes over networks and normalisers. Raises `CheckpointError` when they do not fit or are not finite."""
    _check_fit(run, path, meta)
    check_weights(path, tensors)
    try:
        run.net.load_state_dict({k.removeprefix("net."): v for k, v in tensors.items() if k.startswith("net.")})
    except RuntimeError as error:
        raise CheckpointError(f"{path}: networks of another shape: {str(error).splitlines()[-1].strip()}") from None


def _check_fit(run: Run, path: Path, meta: dict[str, Any]) -> None:
    check_layout(str(path), meta["layout"], run.env.policy_table.layout())
    theirs, ours = meta["config"]["preset"], run.config.preset
    if theirs != ours:
        raise CheckpointError(f"{path}: was trained as {theirs!r}, not {ours!r}: give --preset {theirs}")
    spread = [float(std) for std in meta["config"]["init_std"]]
    if list(run.config.init_std) != spread:
        raise CheckpointError(
            f"{path}: init_std is {' '.join(map(str, run.config.init_std))}, but its networks have learnt theirs, from "
            f"{' '.join(map(str, spread))} on: give --init-std {' '.join(map(str, spread))}"
        )
    sizes = {name: [int(n) for n in meta["config"][name]] for name in ("hidden", "critic_hidden")}
    if any(list(getattr(run.config, name)) != given for name, given in sizes.items()):
        mend = " ".join(f"--{name.replace('_', '-')} {' '.join(map(str, given))}" for name, given in sizes.items())
        raise CheckpointError(f"{path}: its networks have hidden layers of other sizes: give {mend}")


def widened(run: Run, tensors: dict[str, Tensor], meta: dict[str, Any]) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """A checkpoint for this environment's observation, where that only adds rows to the checkpoint's."""
    env = run.env
    for key, table, norm, net in (
        ("layout", env.policy_table, "obs_norm", "actor"),
        ("critic_layout", env.critic_table, "critic_norm", "critic"),
    ):
        old, new = [(name, width) for name, width in meta[key]], table.layout()
        if columns_within(old, new) is not None:
            tensors, meta = widen(tensors, old, new, norm, net), {**meta, key: new}
    return tensors, meta


def kind_of(meta: dict[str, Any]) -> str:
    """Way a checkpoint was trained; before distillation there was only one."""
    return meta.get("learner", DualPpo.kind)


def check_kind(path: Path, meta: dict[str, Any], kind: str) -> None:
    """Raises `CheckpointError` where a run of another kind would go on from a checkpoint."""
    if kind_of(meta) != kind:
        raise CheckpointError(
            f"{path}: was trained by {kind_of(meta)!r}, not {kind!r}: give another folder as out, or it as init"
        )


@contextlib.contextmanager
def same_version(path: Path) -> Iterator[None]:
    """What a checkpoint of another version lacks, or has in another shape, becomes a `CheckpointError`."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        if ran_out_of_memory(error):
            raise
        reason = f"{type(error).__name__} {error}".splitlines()[-1].strip()
        raise CheckpointError(f"{path}: is no checkpoint of this version: {reason}") from error
