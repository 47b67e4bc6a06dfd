"""Number of cores to use, told once to every library that starts threads of its own."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch

from hotice.machine import usable_cores


def use_threads(count: int) -> None:
    """Limits torch and the compiled field queries to `count` threads; 0: to all cores that the process may use.

    With 0 neither gets more than it has: a limit that OMP_NUM_THREADS or a caller has set stays.
    """
    import numba
    from numba.core import config

    if count <= 0:
        cores = usable_cores()
        torch.set_num_threads(min(cores, torch.get_num_threads()))
        numba.set_num_threads(min(cores, numba.get_num_threads()))
        return
    torch.set_num_threads(count)
    numba.set_num_threads(min(count, config.NUMBA_NUM_THREADS))


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """`use_threads(1)` for a while: sums then do not depend on the number of cores."""
    import numba

    before = torch.get_num_threads(), numba.get_num_threads()
    use_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before[0])
        numba.set_num_threads(before[1])
