"""One formula for NumPy and torch: what lets a function take the arrays of one robot and the tensors of a batch.

Such a function uses operators, methods that both kinds have (`clip`, `mean`, `sum`, axes by position) and, for the
rest, the names of the Array API standard from `namespace`: `concat`, `stack`, `atan2`, `tanh`, `linalg.vector_norm`.
"""

from __future__ import annotations

from typing import Any

import numpy as np


def namespace(array: Any) -> Any:
    """`numpy` for an array or scalar of NumPy, else `torch`, which is imported only then."""
    if isinstance(array, np.ndarray | np.generic):
        return np
    import torch

    return torch


def length(v: Any) -> Any:
    """Norm over the last axis, (..., D) -> (...); NumPy or torch."""
    # of torch its own norm: it rounds once, and is what training has always used
    return np.sqrt(np.vecdot(v, v)) if isinstance(v, np.ndarray) else namespace(v).linalg.vector_norm(v, axis=-1)
