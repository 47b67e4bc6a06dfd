"""One policy from several branches: runs that went on from the same networks, averaged weight by weight.

Branches of one ancestor lie in one basin, so the point between them acts like them, and the noise of each one's last
updates cancels, as within a run (`hotice.learn.checkpoints.average`), but over steps that know nothing of each other
(Wortsman et al. 2022, "model soups"). Networks that were trained apart from nothing have no such common ground: their
average does not walk.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from hotice.errors import CheckpointError, InvalidConfig, OutputError
from hotice.files import check_folder
from hotice.learn.checkpoints.average import COUNT, PREFIX, averaged
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint, read_meta, resolve, save_checkpoint
from hotice.learn.checkpoints.health import check_weights
from hotice.learn.checkpoints.lineage import ANCESTORS, MERGED, line_of
from hotice.learn.checkpoints.trained_on import TRAINED_ON, TrainedOn
from hotice.learn.distill.teachers import contract
from hotice.owner import sole_owner

EPISODES = r"(rank\d+\.)?(env\.|reached$|touched$|whole$)"
"""Names of episodes under way, which belong to no average."""
LEFT_OUT = re.compile(EPISODES + r"|optimizer\.")
"""Names of what a merged checkpoint lacks: three quarters of its size."""
SAME_CONFIG = ("preset", "hidden", "critic_hidden")


def merge(parts: Sequence[Path], out: Path) -> Path:
    """Writes a checkpoint into the new run `out` whose actors and normaliser are the mean over `parts`.

    Of each part, a checkpoint or a run (its newest), the running average counts where it has one. Critics are the first
    part's, so are the counters but for steps, all of which are its parts'. Episodes under way and the optimiser's
    moments belong to no average and are left out: what goes on from it (`--init`, `--resume`) begins both anew. It is
    evaluated and exported like any other.

    Raises:
        InvalidConfig: fewer than two different parts.
        CheckpointError: a part cannot be read, or differs from the first in preset, networks, observation or task.
        OutputError: `out` holds a run, is another process's or not writable; an earlier average there is replaced.
    """
    folders = [resolve(Path(part)) for part in parts]
    if len({folder.resolve() for folder in folders}) != len(folders) or len(folders) < 2:
        raise InvalidConfig(
            f"parts are {', '.join(map(str, parts)) or 'none'}: two different checkpoints or runs, or more, are needed"
        )
    (first, meta), *others = [_read(folder) for folder in folders]
    for folder, (tensors, other) in zip(folders[1:], others, strict=True):
        _check_alike(folders[0], (first, meta), folder, (tensors, other))
    check_folder(out)
    _check_free(out, meta["update"])
    names = [name for name in first if _acts(name, first)]
    weights = [averaged(first), *(averaged(tensors) for tensors, _ in others)]
    merged = {name: tensor for name, tensor in first.items() if not LEFT_OUT.match(name)}
    for name in names:
        merged[name] = mean_of([w[name] for w in weights])
        if (kept := PREFIX + name.removeprefix("net.")) in first:
            merged[kept] = merged[name].clone()
    own = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    behind: dict[str, int] = {}
    trained_on = TrainedOn()
    for folder, each in zip(folders, (meta, *(m for _, m in others)), strict=True):
        behind |= line_of(each)
        trained_on |= TrainedOn.of_meta(each, str(folder))
    own[ANCESTORS], own[TRAINED_ON] = behind, trained_on.to_json()
    own[MERGED] = [{"steps": m["steps"], "sha256": m["sha256"]} for m in (meta, *(m for _, m in others))]
    with sole_owner(out):
        _check_free(out, meta["update"])
        return save_checkpoint(out, int(meta["update"]), merged, own)


def mean_of(tensors: Sequence[Tensor]) -> Tensor:
    """Mean of tensors of floats, taken in double precision; that of one is itself."""
    total = torch.zeros_like(tensors[0], dtype=torch.float64)
    for tensor in tensors:
        total += tensor.double()
    return (total / len(tensors)).to(tensors[0].dtype)


def _read(folder: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    tensors, meta = load_checkpoint(folder)
    check_weights(folder, tensors)
    missing = [key for key in ("config", "layout", "critic_layout", "steps") if key not in meta]
    if missing:
        raise CheckpointError(f"{folder}: is no checkpoint of this version: {', '.join(missing)} missing in meta.json")
    return tensors, meta


def _check_free(out: Path, update: int) -> None:
    """Raises `OutputError` where `out` holds anything but an earlier average, which is then replaced."""
    for there in list_checkpoints(out):
        meta = read_meta(there)
        if MERGED not in meta or meta["update"] != update:
            raise OutputError(f"{out}: holds {there.name} of an earlier run: give another folder as --out")


def _check_alike(
    first: Path,
    one: tuple[dict[str, Tensor], dict[str, Any]],
    second: Path,
    other: tuple[dict[str, Tensor], dict[str, Any]],
) -> None:
    """Raises `CheckpointError` for parts between which there is no mean, or one that nobody was trained for."""
    (tensors, meta), (theirs, their_meta) = one, other
    pairs: dict[str, tuple[Any, Any]] = {
        name: (meta["config"].get(name), their_meta["config"].get(name)) for name in SAME_CONFIG
    }
    pairs["observation"] = meta["layout"], their_meta["layout"]
    mine, yours = (contract(m["config"].get("task", {})) for m in (meta, their_meta))
    pairs |= {name: (value, yours[name]) for name, value in mine.items()}
    for name, (a, b) in pairs.items():
        if a != b:
            raise CheckpointError(
                f"{second}: its {name} is {b!r}, that of {first} {a!r}: only branches of one run can be merged"
            )
    for name in (n for n in tensors if _acts(n, tensors)):
        if name not in theirs or theirs[name].shape != tensors[name].shape:
            raise CheckpointError(f"{second}: has no {name} of the shape that {first} has")


def _acts(name: str, tensors: dict[str, Tensor]) -> bool:
    """Whether a tensor of a checkpoint is a weight or a statistic that the policy acts by."""
    acting = ".actor." in name or name.endswith((".log_std", "obs_norm.mean", "obs_norm.var"))
    return name.startswith("net.") and acting and name != COUNT and tensors[name].is_floating_point()
