"""Attractive and repulsive potential (eqs. 1-3): the constants and the formulas that every sampler uses.

Below `s_min` the repulsive potential continues along its tangent, so it stays finite and F = -grad U holds there too,
inside obstacles included: the force keeps its size at `s_min` and points along grad sdf, the way out.
"""

from __future__ import annotations

from dataclasses import dataclass

from hotice import checks
from hotice.checks import Range
from hotice.compiled import compiled
from hotice.fields.defaults import ETA


@dataclass(frozen=True, kw_only=True)
class FieldParams:
    """Constants of the fields. Raises `InvalidConfig` unless all are finite, positive and s_min < d0."""

    influence_distance_m: float = 0.2
    """d0: obstacles farther away do not repel [m] (paper, IV-A)."""
    attraction: float = ETA
    """eta: size of the attractive force, a speed in m/s when read as a command (paper)."""
    repulsion: float = 1e-3
    """xi (paper)."""
    nearest_distance_m: float = 0.02
    """s_min: distances below count as this one in the repulsive force [m] (ours)."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.POSITIVE)
        nearest = Range(above=0, below=self.influence_distance_m, unit="m", note="influence_distance_m")
        checks.number("nearest_distance_m", self.nearest_distance_m, nearest)

    def letters(self) -> tuple[float, float, float, float]:
        """(d0, eta, xi, s_min), the paper's symbols in the order that the kernels take them."""
        return self.influence_distance_m, self.attraction, self.repulsion, self.nearest_distance_m


def u_rep(s, params: FieldParams):
    """Repulsive potential at signed distances s [m] (eq. 2); numpy array or torch tensor in, same out."""
    d0, _, xi, s_min = params.letters()
    gap = 1.0 / s.clip(s_min, d0) - 1.0 / d0
    return 0.5 * xi * gap**2 + xi * gap / s_min**2 * (s_min - s).clip(0.0, None)


def f_rep(s, params: FieldParams):
    """-dU_rep/ds >= 0, the repulsive force along grad sdf (eq. 3); numpy array or torch tensor in, same out."""
    d0, _, xi, s_min = params.letters()
    s = s.clip(s_min, d0)
    return xi * (1.0 / s - 1.0 / d0) / s**2


@compiled(inline="always")
def f_rep_scalar(s, d0, xi, s_min):
    """`f_rep` of one number, for compiled code."""
    s = min(max(s, s_min), d0)
    return xi * (1.0 / s - 1.0 / d0) / (s * s)
