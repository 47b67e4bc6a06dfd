"""Blocks of an evaluation, shared out to processes of one thread each.

One process a core beats threads inside one process, where every small tensor operation and every physics step waits for
the slowest thread: 2,170 against 700 to 920 control steps per second of CPU time (250 trials, two cores shared with
others).
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import Any

from hotice.errors import SimulationError
from hotice.evaluate.carriers import Carrier, load_carrier
from hotice.evaluate.scorer import Scorer
from hotice.evaluate.trials import Trials
from hotice.learn.train.signals import without_ctrl_c
from hotice.machine import usable_cores

POLL_S = 0.5
Block = tuple[int, int]


def score_blocks(
    scorer: Scorer, carrier: Carrier, blocks: Sequence[Block], processes: int, on_total: Callable[[int], None]
) -> Iterator[tuple[Block, Trials]]:
    """Scores blocks (scene, block) and yields them as they end, in any order.

    With one process, or one block, everything happens in this one; others load the policy anew. `on_total(n)` is
    told now and then how many trials have ended. Raises `SimulationError` when a process dies.
    """
    count = min(len(blocks), processes or usable_cores())
    if count <= 1:
        yield from _score_here(scorer, carrier, blocks, on_total)
        return
    context = multiprocessing.get_context("spawn")
    ended = context.Value("q", 0)
    before = multiprocessing.active_children()
    pool = ProcessPoolExecutor(count, context, initializer=_begin, initargs=(scorer, ended))
    try:
        with without_ctrl_c():
            waiting = {pool.submit(_score, block): block for block in blocks}
        while waiting:
            finished, _ = wait(waiting, timeout=POLL_S, return_when=FIRST_COMPLETED)
            on_total(ended.value)
            for future in finished:
                yield waiting.pop(future), future.result()
    except BrokenProcessPool:
        raise SimulationError(
            "a process of the evaluation died (out of memory, or killed): run the same command again; with --out, "
            "finished blocks are kept; fewer --threads or a smaller --batch need less memory"
        ) from None
    except KeyboardInterrupt:
        for process in multiprocessing.active_children():
            if process not in before:
                process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _score_here(
    scorer: Scorer, carrier: Carrier, blocks: Sequence[Block], on_total: Callable[[int], None]
) -> Iterator[tuple[Block, Trials]]:
    total = 0

    def add(count: int) -> None:
        nonlocal total
        total += count
        on_total(total)

    for scene, block in blocks:
        yield (scene, block), scorer.score(carrier, scene, block, add)


class _Worker:
    """State that a process keeps between blocks."""

    scorer: Scorer
    carrier: Carrier
    ended: Any


def _begin(scorer: Scorer, ended: Any) -> None:
    """Sets a process up; it ends when the one that started it does, also by a kill."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        sentinel = parent.sentinel
        threading.Thread(target=lambda: (wait_for([sentinel]), os._exit(1)), daemon=True).start()
    _Worker.scorer, _Worker.ended = scorer, ended
    _Worker.carrier = load_carrier(scorer.config)


def _score(key: Block) -> Trials:
    def add(count: int) -> None:
        with _Worker.ended.get_lock():
            _Worker.ended.value += count

    return _Worker.scorer.score(_Worker.carrier, *key, add)
