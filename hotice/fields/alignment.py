"""How well motion follows a field, and how the field enters the observation (IV-A). Any device, any leading axes."""

from __future__ import annotations

import torch
from torch import Tensor

from hotice.fields.defaults import ETA

ENCODE_SCALE = ETA
"""|F| at which the encoded magnitude is tanh(1) = 0.76: eta, the size of the attractive force alone (ours)."""


def cosine(a: Tensor, b: Tensor, eps: float = 1e-3) -> Tensor:
    """Cosine of the angle between vectors, (..., 3), (..., 3) -> (...), in [-1, 1].

    a.b / ((|a| + eps) (|b| + eps)): zero, with finite gradient, where a vector vanishes, and fading smoothly to it, so
    that the noise of a body at rest scores nothing. `eps` is in the vectors' unit (m/s).
    """
    return (a * b).sum(dim=-1) / ((_length(a) + eps) * (_length(b) + eps))


def residual_cosine(field_W: Tensor, v_W: Tensor, c_W: Tensor, eps: float = 1e-3) -> Tensor:
    """Cosine between F_object(x) - c and v - c, (..., K, 3), (..., K, 3), (..., 3) -> (..., K) (IV-A)."""
    c_W = c_W.unsqueeze(-2)
    return cosine(field_W - c_W, v_W - c_W, eps)


def encode(force: Tensor, scale: float = ENCODE_SCALE, eps: float = 1e-6) -> Tensor:
    """Unit direction and squashed size tanh(|F| / scale) of forces, (..., 3) -> (..., 4); zeros for a zero force."""
    size = _length(force)[..., None]
    return torch.cat([force / (size + eps), torch.tanh(size / scale)], dim=-1)


def _length(v: Tensor) -> Tensor:
    """Norm over the last axis with zero (not NaN) gradient at zero."""
    return (v.square().sum(dim=-1) + 1e-20).sqrt()
