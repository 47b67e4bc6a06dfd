"""Proximal policy optimisation in numbers. Sources: paper, CAT, FALCON, or ours."""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimisation."""

    steps: int = 24
    """Control steps per environment and update (FALCON)."""
    epochs: int = 3
    """Passes over a rollout (ours; CAT 4)."""
    minibatches: int = 4
    """Minibatches a pass (ours; CAT 32 of a far larger rollout)."""
    gamma: float = 0.99
    """Discount (FALCON)."""
    lam: float = 0.95
    """Decay of generalised advantages (CAT)."""
    clip: float = 0.2
    """Clipping of the probability ratio (CAT)."""
    value_clip: float = 1.0
    """Clipping of the value, in units of the return (ours)."""
    learning_rate: float = 1e-3
    """First learning rate; each agent's then follows its own KL divergence (FALCON)."""
    max_learning_rate: float = 3e-3
    """Upper limit of the learning rate (ours)."""
    target_kl: float = 0.03
    """Target KL divergence of a minibatch from the rollout policy (ours; FALCON 0.01)."""
    entropy: float = 0.0005
    """Weight of the entropy bonus (ours; CAT 0.01)."""
    value_weight: float = 1.0
    """Weight of the value loss (ours)."""
    mirror_weight: float = 0.5
    """Weight of the mirror loss of the actors; 0 switches it off (ours)."""
    max_grad_norm: float = 1.0
    """Gradient clipping, per agent (FALCON)."""
    min_std: float = 0.12
    """Lower limit of the action's standard deviation (ours)."""

    def __post_init__(self) -> None:
        checks.wholes(self, checks.COUNT, "steps", "epochs", "minibatches")
        checks.numbers(self, checks.SHARE, "gamma", "lam")
        checks.numbers(self, checks.POSITIVE, "clip", "value_clip", "learning_rate", "max_learning_rate")
        checks.numbers(self, checks.POSITIVE, "target_kl", "max_grad_norm", "min_std")
        checks.numbers(self, checks.NOT_NEGATIVE, "entropy", "value_weight", "mirror_weight")
