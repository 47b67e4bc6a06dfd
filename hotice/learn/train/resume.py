"""Saving a training run, and going on with it or from it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import Tensor

from hotice.errors import CheckpointError
from hotice.learn import distributed
from hotice.learn.checkpoints.average import averaged
from hotice.learn.checkpoints.checkpoint import load_checkpoint, save_checkpoint
from hotice.learn.checkpoints.health import check_weights, first_not_finite
from hotice.learn.checkpoints.lineage import ANCESTORS, BRANCHES, MERGED, line_of, own_steps
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn
from hotice.learn.train.config import TrainConfig, config_to_dict
from hotice.learn.train.fit import check_kind, kind_of, load_networks, same_version, widened
from hotice.learn.train.run import Run
from hotice.version import source_version

Config = TypeVar("Config", bound=TrainConfig)


def save_run(run: Run) -> None:
    """Writes a checkpoint: what all ranks share, and each rank's own (`rankN.` before the names from rank 1 on).

    All ranks call it together. Raises `OutputError`.
    """
    own = {f"env.{k}": v for k, v in run.env.state().items()} | run.algo.own_state()
    own |= {"reached": run.stats.reached, "touched": run.stats.touched, "whole": run.stats.whole}
    first, *others = distributed.collect(own)
    tensors = {f"net.{k}": v for k, v in run.net.state_dict().items()} | run.algo.state() | first
    tensors |= run.average.state()
    tensors |= {f"rank{r}.{k}": v for r, other in enumerate(others, 1) for k, v in other.items()}
    tensors["curriculum"] = run.curriculum.rate
    tensors |= run.stages.state()
    meta: dict[str, Any] = {
        **run.algo.meta(),
        "steps": run.steps,
        "minutes": run.minutes,
        "config": config_to_dict(run.config),
        "layout": run.env.policy_table.layout(),
        "critic_layout": run.env.critic_table.layout(),
        "scenes": run.env.bank.names,
        "source": source_version(),
        ANCESTORS: run.ancestors,
        TRAINED_ON: run.trained_on.to_json(),
        "num_envs": run.env.num_envs,
        "ranks": distributed.size(),
        **run.notes,
    }
    if distributed.rank() == 0:
        save_checkpoint(run.config.out, run.update, tensors, meta)


def load_run(run: Run, path: Path) -> None:
    """Restores a run from its newest checkpoint. Raises `CheckpointError` when it does not fit this one.

    With other ranks, environments, scenes, task or perturbations episodes begin again; `run.notice` holds the message.
    """
    tensors, meta = load_checkpoint(path, run.env.device)
    if (name := first_not_finite(tensors)) is not None:
        raise CheckpointError(f"{path}: {name} is not finite: take an older checkpoint, or begin from it with --init")
    with same_version(path):
        _restore(run, path, tensors, meta)


def _restore(run: Run, path: Path, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
    check_kind(path, meta, run.algo.kind)
    run.config = checked_options(run.config, path, meta)
    load_networks(run, path, tensors, meta)
    run.average.restart(run.net)
    run.average.load_state(tensors)
    run.algo.load_state(tensors, meta)
    run.update, run.steps, run.minutes = int(meta["update"]), own_steps(meta), float(meta["minutes"])
    run.ancestors = dict(meta.get(ANCESTORS, {}))
    run.trained_on = TrainedOn.of_meta(meta, str(path)) | run.trained_on
    run.stages.load_state(tensors)
    keep_rates(run, tensors["curriculum"], meta["scenes"])
    _restore_own(run, path, tensors, meta)


def checked_options(ours: Config, path: Path, meta: dict[str, Any]) -> Config:
    """Options of a run that is restored; its `init` is what it was. Raises `CheckpointError` for what cannot change."""
    theirs = meta["config"]
    if meta.get("ranks", 1) == distributed.size() and MERGED not in meta and theirs["seed"] != ours.seed:
        raise CheckpointError(
            f"{path}: seed is {ours.seed}, but the run goes on with the draws of seed {theirs['seed']}: give --seed "
            f"{theirs['seed']}, or begin another run from it (--init)"
        )
    began = theirs.get("init") and Path(theirs["init"])
    if ours.init is not None and (began is None or ours.init.resolve() != began.resolve()):
        raise CheckpointError(
            f"{path}: init is {str(ours.init)!r}, but the run began from {began or 'nothing'}: leave out "
            "--init, or give another folder as --out"
        )
    return replace(ours, init=began or None)


def _restore_own(run: Run, path: Path, tensors: dict[str, Tensor], meta: dict[str, Any]) -> None:
    """State that each rank has of its own: random numbers, and episodes where nothing differs that they depend on."""
    ranks = meta.get("ranks", 1)
    pairs = {
        "ranks": (ranks, distributed.size()),
        "num_envs": (meta["num_envs"], run.env.num_envs),
        "scenes": (meta["scenes"], run.env.bank.names),
        "task": (meta["config"]["task"], config_to_dict(run.config)["task"]),
        "perturbed": (meta["config"].get("perturbed", False), run.config.perturbed),
    }
    others = [name for name, (theirs, ours) in pairs.items() if theirs != ours]
    average = MERGED in meta or BRANCHES in meta
    if not others and average:
        run.notice = f"{path}: is an average, which has no episodes under way: they start anew"
    elif others:
        kept = sum(name in meta["scenes"] for name in run.env.bank.names)
        run.notice = (
            f"{path}: was saved with other {', '.join(others)}: episodes start anew, {kept} of "
            f"{run.env.bank.num_scenes} scenes keep their success rates"
        )
    if ranks != distributed.size():
        return
    prefix = f"rank{distributed.rank()}."
    tensors = tensors | {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
    run.algo.load_own_state(tensors)
    if not others and not average:
        weight = None if run.config.curriculum else run.env.starter.scene_weight.clone()
        run.obs, run.critic_obs = run.env.load_state(
            {k.removeprefix("env."): v for k, v in tensors.items() if k.startswith("env.")}
        )
        if weight is not None:
            run.env.starter.scene_weight.copy_(weight)
        run.stats.reached.copy_(tensors["reached"])
        run.stats.touched.copy_(tensors["touched"])
        # checkpoints of earlier versions do not say
        run.stats.whole.copy_(tensors.get("whole", torch.ones_like(run.stats.whole)))


def keep_rates(run: Run, rates: Tensor, names: list[str]) -> None:
    """Takes over the success rates of the scenes that this run has too; others begin as in a new run."""
    ours, theirs = run.env.bank.names, dict(zip(names, rates, strict=True))
    known = list(rates) if ours == names else [theirs.get(name) for name in ours]  # a scene may be there twice
    for i, rate in enumerate(known):
        if rate is not None:
            run.curriculum.rate[i] = rate
    if run.config.curriculum:
        run.env.starter.scene_weight.copy_(run.curriculum.weights())


def begin_from(run: Run, path: Path) -> None:
    """Takes networks and normalisers of another run, and its optimiser where that served the same objective.

    The actors begin at their average, where the run kept one.

    Inputs that hardly varied in that run (the distance to obstacles on an open floor) get zero weights and an ordinary
    variance: the old skill stays what it was when they begin to vary. Rows that its observation did not have (scan,
    history) begin with zero weights too. Raises `CheckpointError` when it does not fit this one.
    """
    tensors, meta = load_checkpoint(path, run.env.device)
    with same_version(path):
        check_weights(path, tensors)
        run.ancestors |= line_of(meta)
        run.trained_on = TrainedOn.of_meta(meta, str(path)) | run.trained_on
        tensors, meta = widened(run, averaged(tensors), meta)
        load_networks(run, path, tensors, meta)
        if kind_of(meta) == run.algo.kind:
            run.algo.load_optimizer(tensors, meta)
    for norm, kind in ((run.net.obs_norm, "actor"), (run.net.critic_norm, "critic")):
        constant = norm.var < 1e-5
        norm.var[constant] = 0.1
        for agent in run.net.agents:
            first = getattr(run.net.nets[agent.name], kind)[0]
            with torch.no_grad():
                first.weight[:, constant] = 0.0
    run.average.restart(run.net)
