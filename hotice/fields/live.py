"""Fields of a scene that changes while it is walked through: the newest complete pair, built beside the queries."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
import weakref
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from hotice import checks
from hotice.errors import FieldsNotBuilt, UnknownName
from hotice.fields.defaults import MARGIN_M, RESOLUTION_M
from hotice.fields.grid import Grid
from hotice.fields.hod_pf import GuidanceField, HodPf, check_margin, hod_pf_of
from hotice.fields.live_worker import Refused, Solved, serve
from hotice.fields.potential import FieldParams
from hotice.fields.reachability import joins_start
from hotice.fields.volumes import solve_scene
from hotice.model.scene import MomentaryScene, Obstacle, Quat, Scene, Vec3

END_S = 5.0
"""Time that the worker has to end by itself."""
MEMORY = Path("/dev/shm")
"""Where files are memory, on Linux; elsewhere the folder of temporary files is used."""


@dataclass(frozen=True, kw_only=True)
class _Asked:
    """A scene to build, when it was given, and since when the world has differed from the fields for its sake [s]."""

    version: int
    scene: Scene
    given_s: float
    since_s: float


@dataclass(frozen=True, kw_only=True)
class Built:
    """A complete pair of fields.

    Attributes:
        fields: of the obstacles as they were when version `version` of the scene was given.
        given_s, ready_s: when that was and when the fields were ready, both by `time.monotonic` [s].
        cost_s: CPU time of building them [s].
        joined: whether free paths join start and goal, in the standard and in the object-centric field.
    """

    fields: HodPf
    version: int
    given_s: float
    ready_s: float
    cost_s: float
    joined: tuple[bool, ...]


class LiveField:
    """Both fields of a scene whose obstacles move, come and go. Use `with`, or `close` it.

    A process of its own builds the fields of the newest scene, again and again; what it has not begun when a newer one
    comes is skipped. Queries are never blocked: they read the newest complete pair, which is exactly what
    `build_hod_pf` makes of the same obstacles. It has the attributes of a `HodPf`; what belongs together is read from
    one `fields`, since the next attribute may be of a newer pair. Obstacles may cover start and goal: `MomentaryScene`.
    Programs start it below `if __name__ == "__main__":`, as all that starts processes.
    """

    def __init__(
        self,
        scene: Scene,
        resolution_m: float = RESOLUTION_M,
        margin_m: float = MARGIN_M,
        params: FieldParams | None = None,
        threads: int = 1,
    ) -> None:
        """Builds the first pair at once; `threads` of the process that builds the others: two fields keep two busy.

        Raises `InvalidConfig` for numbers outside the allowed range.
        """
        self.margin_m, self.params = check_margin(margin_m), params or FieldParams()
        margins, threads = (0.0, self.margin_m), checks.whole("threads", threads, checks.COUNT)
        self._obstacles = {obstacle.name: obstacle for obstacle in scene.obstacles}
        self._empty = MomentaryScene.of(scene, ())
        self._given, self._ended = 0, False
        self._building: _Asked | None = None
        self._waiting: _Asked | None = None
        self._refused: tuple[_Asked, str] | None = None
        self._changed = threading.Condition()
        begin = time.monotonic(), time.process_time()
        nodes = solve_scene(scene, resolution_m, margins, threads)
        self._built = Built(
            fields=hod_pf_of(scene, nodes, self.margin_m, self.params),
            version=0,
            given_s=begin[0],
            ready_s=time.monotonic(),
            cost_s=time.process_time() - begin[1],
            joined=tuple(joins_start(scene, nodes.grid, reached) for reached in nodes.reached),
        )
        folder = tempfile.mkdtemp(prefix=f"hotice-{os.getpid()}-", dir=MEMORY if MEMORY.is_dir() else None)
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        arguments = (theirs, folder, resolution_m, margins, threads)
        self._worker = context.Process(target=serve, args=arguments, daemon=True)
        self._close = weakref.finalize(self, _end, os.getpid(), self._pipe, self._worker, folder)
        self._worker.start()
        theirs.close()
        threading.Thread(target=_receive, args=(weakref.ref(self), self._pipe), daemon=True).start()

    def __enter__(self) -> LiveField:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the worker; the newest fields can be read on, and no change is taken any more."""
        self._lose()
        self._close()

    @property
    def newest(self) -> Built:
        """The newest complete pair of fields, and what is known of it."""
        return self._built

    @property
    def fields(self) -> HodPf:
        """The newest complete pair of fields."""
        return self._built.fields

    @property
    def scene(self) -> Scene:
        """The scene that `fields` show."""
        return self._built.fields.scene

    @property
    def grid(self) -> Grid:
        """The grid of `fields`."""
        return self._built.fields.grid

    @property
    def sgf(self) -> GuidanceField:
        """The newest Standard Guidance Field."""
        return self._built.fields.sgf

    @property
    def ogf(self) -> GuidanceField:
        """The newest Object-Centric Guidance Field."""
        return self._built.fields.ogf

    @property
    def age_s(self) -> float:
        """How long ago the scene that `fields` show was given [s]."""
        return time.monotonic() - self._built.given_s

    @property
    def behind_s(self) -> float:
        """How long the oldest change that `fields` do not show has been waiting [s]; 0 when they show all."""
        with self._changed:
            asked = [self._building, self._waiting, self._refused[0] if self._refused else None]
        since_s = [each.since_s for each in asked if each]
        return time.monotonic() - min(since_s) if since_s else 0.0

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Obstacles as they were given last, which `fields` may not show yet."""
        return tuple(self._obstacles.values())

    def show(self, obstacles: Iterable[Obstacle]) -> int:
        """Takes obstacles as all there are now; the version of this scene.

        Raises `InvalidScene` for two of one name, `FieldsNotBuilt` when the worker has ended.
        """
        scene, now_s = MomentaryScene.of(self._empty, obstacles), time.monotonic()
        with self._changed:
            self._check_worker()
            self._obstacles = {obstacle.name: obstacle for obstacle in scene.obstacles}
            self._given += 1
            since_s = self._waiting.since_s if self._waiting else now_s
            self._waiting = _Asked(version=self._given, scene=scene, given_s=now_s, since_s=since_s)
            if not self._building:
                self._ask(self._waiting)
            return self._given

    def move(self, poses: Mapping[str, tuple[Vec3, Quat]]) -> int:
        """Places obstacles, by name: position [m] and quaternion (w, x, y, z) in W. Raises also `UnknownName`."""
        with self._changed:
            now = dict(self._obstacles)
            for name, (position_m, quaternion_wxyz) in poses.items():
                if name not in now:
                    raise UnknownName("obstacle", name, now)
                now[name] = replace(now[name], position_m=position_m, quaternion_wxyz=quaternion_wxyz, motion=None)
            return self.show(now.values())

    def add(self, *obstacles: Obstacle) -> int:
        """Adds obstacles. Raises as `show`."""
        with self._changed:
            return self.show((*self._obstacles.values(), *obstacles))

    def remove(self, *names: str) -> int:
        """Takes obstacles away. Raises also `UnknownName`."""
        with self._changed:
            for name in names:
                if name not in self._obstacles:
                    raise UnknownName("obstacle", name, self._obstacles)
            return self.show([obstacle for name, obstacle in self._obstacles.items() if name not in names])

    def wait(self, version: int | None = None, timeout_s: float = 60.0) -> Built:
        """The newest pair as soon as it shows this version, by default the last one given.

        Raises `FieldsNotBuilt` after `timeout_s`, when the worker has ended, or with the reason of a refused scene.
        """
        wanted = self._given if version is None else version
        with self._changed:
            self._changed.wait_for(lambda: self._answered() >= wanted or self._ended, timeout_s)
            if self._built.version >= wanted:
                return self._built
            if self._refused and self._refused[0].version >= wanted:
                raise FieldsNotBuilt(self._refused[1])
            self._check_worker()
        raise FieldsNotBuilt(f"fields of version {wanted} were not ready after {timeout_s:g} s: allow more time")

    def _answered(self) -> int:
        return max(self._built.version, self._refused[0].version if self._refused else 0)

    def _check_worker(self) -> None:
        if self._ended:
            raise FieldsNotBuilt("the process that builds fields has ended: make a new LiveField")

    def _ask(self, waiting: _Asked) -> None:
        """Gives the waiting scene to the worker, which has none."""
        try:
            self._pipe.send(waiting.scene)
        except OSError:
            self._lose()
            self._check_worker()
        self._building, self._waiting = waiting, None

    def _take(self, answer: Solved | Refused) -> None:
        """What the worker says of the scene that it was given; nothing is taken any more once all has ended."""
        with self._changed:
            asked = self._building
            if self._ended or not asked:
                return
            if isinstance(answer, Refused):
                earlier_s = self._refused[0].since_s if self._refused else asked.since_s
                self._refused = replace(asked, since_s=earlier_s), answer.reason
            else:
                self._built = Built(
                    fields=hod_pf_of(asked.scene, answer.take(), self.margin_m, self.params),
                    version=asked.version,
                    given_s=asked.given_s,
                    ready_s=time.monotonic(),
                    cost_s=answer.cost_s,
                    joined=answer.joined,
                )
                self._refused = None
            self._building = None
            self._changed.notify_all()
            if self._waiting:
                self._ask(self._waiting)

    def _lose(self) -> None:
        """The worker has ended, or nobody hears it any more."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()


def _receive(field: weakref.ref[LiveField], pipe: Connection) -> None:
    """Hands answers on, for as long as there are a field and a worker; however it ends, nobody waits in vain."""
    try:
        # EOFError, OSError: the worker, or its pipe, is gone; FieldsNotBuilt: so it is when the next scene is given
        with contextlib.suppress(EOFError, OSError, FieldsNotBuilt):
            while True:
                answer = pipe.recv()
                here = field()
                if here is None:
                    return
                here._take(answer)
                del here
    finally:
        here = field()
        if here is not None:
            here._lose()


def _end(owner: int, pipe: Connection, worker: BaseProcess, folder: str) -> None:
    """Ends the worker and removes its files; a fork of the process that made them leaves both alone."""
    if os.getpid() != owner:
        return
    with contextlib.suppress(OSError):
        pipe.send(None)
    if worker.pid is not None:
        worker.join(END_S)
        if worker.is_alive():
            worker.kill()
            worker.join()
    shutil.rmtree(folder, ignore_errors=True)
