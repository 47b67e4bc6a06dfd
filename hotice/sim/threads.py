"""How many cores to use, said once to every library that starts threads of its own."""

from __future__ import annotations

import torch


def use_threads(count: int) -> None:
    """Limits torch and the compiled field queries to `count` threads; 0 leaves them at all cores."""
    if count <= 0:
        return
    import numba
    from numba.core import config

    torch.set_num_threads(count)
    numba.set_num_threads(min(count, config.NUMBA_NUM_THREADS))
