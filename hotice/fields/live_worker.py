"""The process that builds the fields of a `LiveField`, and how a pair of fields comes back from it.

Scenes come through a pipe, one at a time. Node values go back through a file in memory that nobody copies: who asked
maps it, removes its name at once, and it lasts as long as fields read it.
"""

from __future__ import annotations

import math
import mmap
import shutil
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from hotice.errors import HoticeError
from hotice.fields.grid import Grid
from hotice.fields.reachability import joins_start
from hotice.fields.rebuild import Rebuilder
from hotice.fields.volumes import SceneNodes
from hotice.model.scene import Scene


@dataclass(frozen=True, kw_only=True)
class Solved:
    """What was built: where its node values are, and what that took.

    `step`: see `SceneNodes`; `joined`: whether paths join start and goal, for each margin;
    `cost_s`: CPU time of the worker [s].
    """

    file: str
    grid: Grid
    step: tuple[float, ...]
    joined: tuple[bool, ...]
    cost_s: float

    def take(self) -> SceneNodes:
        """The node values; their file loses its name."""
        path = Path(self.file)
        with path.open("r+b") as file:
            values = mmap.mmap(file.fileno(), 0, flags=mmap.MAP_SHARED | getattr(mmap, "MAP_POPULATE", 0))
        path.unlink()
        parts, begin = [], 0
        for kind, shape in _parts(self.grid, len(self.step)):
            count = math.prod(shape)
            parts.append(np.frombuffer(values, kind, count, begin).reshape(shape))
            begin += parts[-1].nbytes
        sdf, *rest = parts
        return SceneNodes(self.grid, sdf, tuple(rest[0::2]), self.step, tuple(rest[1::2]))


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A scene of which there are no fields, and why."""

    reason: str


def serve(pipe: Connection, folder: str, resolution_m: float, margins_m: tuple[float, ...], threads: int) -> None:
    """Builds each scene that comes, until `None` does or the other end is gone.

    Where it is gone without a `None`, killed, nobody else removes the folder.
    """
    # Ctrl-C is for whoever started this process; it ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    number, rebuilder = 0, Rebuilder(resolution_m, margins_m, threads)
    try:
        while (scene := pipe.recv()) is not None:
            number += 1
            path = Path(folder) / f"{number}"
            try:
                answer: Solved | Refused = _solve(rebuilder, scene, path)
            except HoticeError as error:
                answer = Refused(reason=str(error))
            except OSError as error:
                path.unlink(missing_ok=True)
                answer = Refused(reason=f"fields cannot be kept in {path}: {error.strerror or error}: make room there")
            pipe.send(answer)
    except (EOFError, OSError):
        shutil.rmtree(folder, ignore_errors=True)


def _solve(rebuilder: Rebuilder, scene: Scene, path: Path) -> Solved:
    begin = time.process_time()
    nodes = rebuilder.solve(scene)
    with path.open("wb") as file:
        for values in (nodes.sdf, *(v for pair in zip(nodes.geo, nodes.reached, strict=True) for v in pair)):
            file.write(np.ascontiguousarray(values).data)
    return Solved(
        file=str(path),
        grid=nodes.grid,
        step=nodes.step,
        joined=tuple(joins_start(scene, nodes.grid, reached) for reached in nodes.reached),
        cost_s=time.process_time() - begin,
    )


def _parts(grid: Grid, margins: int) -> Iterator[tuple[Any, tuple[int, ...]]]:
    yield np.float32, (grid.size,)
    for _ in range(margins):
        yield np.int16, (grid.size, 4)
        yield np.bool_, (grid.size,)
