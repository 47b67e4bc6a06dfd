"""Alignment of motion with a field, and the field's place in the observation (IV-A): NumPy or torch, any axes."""

from __future__ import annotations

from typing import Any

from hotice.arrays import clip, namespace

ENCODE_SCALE = 0.6
"""|F| at which the encoded magnitude is tanh(1) = 0.76 [m/s]: a unit of the observation, fixed for all policies; the
size of the attractive force alone at the paper's eta (ours)."""
CLIP_M, DISTANCE_SCALE = (-0.1, 0.5), 2.0
"""Distances to obstacles are read clipped to this range [m], times this (ours)."""


def cosine(a: Any, b: Any, eps: float = 1e-3) -> Any:
    """Cosine of the angle between vectors, (..., 3), (..., 3) -> (...), in [-1, 1].

    a.b / ((|a| + eps) (|b| + eps)): zero, with finite gradient, where a vector vanishes, and fading smoothly to it, so
    that the noise of a body at rest scores nothing. `eps` is in the vectors' unit (m/s).
    """
    return (a * b).sum(-1) / ((_length(a) + eps) * (_length(b) + eps))


def residual_cosine(field_W: Any, v_W: Any, c_W: Any, eps: float = 1e-3) -> Any:
    """Cosine between F_object(x) - c and v - c, (..., K, 3), (..., K, 3), (..., 3) -> (..., K) (IV-A)."""
    c_W = c_W[..., None, :]
    return cosine(field_W - c_W, v_W - c_W, eps)


def encode(force: Any, scale: float = ENCODE_SCALE, eps: float = 1e-6) -> Any:
    """Unit direction and squashed size tanh(|F| / scale) of forces, (..., 3) -> (..., 4); zeros for a zero force."""
    return namespace(force).concat(_encoded(force, scale, eps), -1)


def observed(force_Y: Any, distance_m: Any) -> Any:
    """Rows that a policy reads of a field at points: `encode` and the clipped distance, (..., 3), (...) -> (..., 5)."""
    away = DISTANCE_SCALE * clip(distance_m, *CLIP_M)[..., None]
    return namespace(force_Y).concat([*_encoded(force_Y, ENCODE_SCALE, 1e-6), away], -1)


def _encoded(force: Any, scale: float, eps: float) -> list[Any]:
    size = _length(force)[..., None]
    return [force / (size + eps), namespace(force).tanh(size / scale)]


def _length(v: Any) -> Any:
    """Norm over the last axis with zero (not NaN) gradient at zero."""
    return namespace(v).sqrt((v * v).sum(-1) + 1e-20)
