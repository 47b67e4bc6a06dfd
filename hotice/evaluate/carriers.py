"""Carriers in an evaluation: a policy, or the walking baseline, which is planned from a model."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from importlib.util import find_spec
from typing import Any

import torch

from hotice.control.walk.config import WalkConfig
from hotice.errors import MissingExtra
from hotice.evaluate.config import EvaluateConfig
from hotice.learn.policy import Policy, load_policy
from hotice.sim.physics.threads import one_thread

Carrier = Policy | WalkConfig
"""Whoever carries in a trial."""
WALK_NEEDS = ("pinocchio", "proxsuite")


def load_carrier(config: EvaluateConfig) -> Carrier:
    """The carrier that is scored. Raises `CheckpointError` or `UnknownName`; `MissingExtra` if the walk cannot run."""
    if config.policy is not None:
        return load_policy(config.policy, threads=1)
    for package in WALK_NEEDS:
        if find_spec(package) is None:
            raise MissingExtra("the walking baseline", package, "drake")
    return WalkConfig()


def digest(carrier: Carrier) -> str:
    """SHA-256 of whatever decides what a carrier does in a trial."""
    if isinstance(carrier, WalkConfig):
        return hashlib.sha256(json.dumps(asdict(carrier), sort_keys=True).encode()).hexdigest()
    return policy_digest(carrier)


def policy_digest(policy: Policy) -> str:
    """SHA-256 of what a policy says of itself and of what it does at 64 random observations."""
    size = sum(width for _, width in policy.meta["layout"])
    generator = torch.Generator().manual_seed(0)
    with one_thread():
        actions = policy.act(torch.randn(64, size, generator=generator))
    said = json.dumps(policy.meta, sort_keys=True, default=str)
    return hashlib.sha256(said.encode() + actions.contiguous().numpy().tobytes()).hexdigest()


def described(carrier: Carrier) -> dict[str, Any]:
    """Description of a carrier for a report, JSON-ready.

    For the walk `policy` and `preset` are None and its numbers stand under `walk`.
    """
    if isinstance(carrier, WalkConfig):
        return {"controller": "walk", "policy": None, "trained": {}, "preset": None, "walk": asdict(carrier)}
    meta = carrier.meta
    return {
        "controller": "policy",
        "policy": carrier.name,
        "trained": meta.get("trained", {}),
        "preset": meta["preset"],
    }
