"""Ways of the moment: the fields of everything, movers included, built beside the runner, or again from its log."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from hotice.fields.hod_pf import HodPf, hod_pf_of
from hotice.fields.live import LiveField
from hotice.fields.moving.momentary import moved
from hotice.fields.rebuild import Rebuilder
from hotice.model.scene import MomentaryScene, Obstacle
from hotice.task.moving import MovingConfig

Array = NDArray[np.float64]
PERIOD_S = 1.0 / MovingConfig().ways_hz
HAIR_S = 1e-3


class Built(NamedTuple):
    """Fields of everything, as it was at poses (M, 7) of what moves, seen at `measured_s` [s]."""

    fields: HodPf
    poses: Array
    measured_s: float


class Ways(Protocol):
    """Who builds them."""

    def show(self, poses: Array, measured_s: float) -> None:
        """Takes poses (M, 7) as they were seen at `measured_s` [s]; they need not all be built."""
        ...

    def newest(self) -> Built | None:
        """What was built last; None before the first."""
        ...


class LiveWays:
    """Builds in a process of its own, 5 times a second at most, as fields of `live` movers are trained with.

    Use `with`, or `close` it. Args: still: fields of what never moves; moving: what does.
    """

    def __init__(self, still: HodPf, moving: Sequence[Obstacle]) -> None:
        self._moving = tuple(moving)
        self._live = LiveField(
            MomentaryScene.of(still.scene, still.scene.obstacles), still.grid.resolution_m, still.margin_m, still.params
        )
        self._given: dict[int, tuple[Array, float]] = {}
        self._shown_s = -np.inf
        self._still = still.scene.obstacles

    def show(self, poses: Array, measured_s: float) -> None:
        """See `Ways.show`. Raises `FieldsNotBuilt` when the process that builds has ended."""
        if 0.0 <= measured_s - self._shown_s < PERIOD_S - HAIR_S:
            return
        self._shown_s = measured_s
        version = self._live.show((*self._still, *moved(self._moving, poses)))
        self._given[version] = poses, measured_s

    def newest(self) -> Built | None:
        """See `Ways.newest`."""
        built = self._live.newest
        for version in [v for v in self._given if v < built.version]:
            del self._given[version]
        return Built(built.fields, *self._given[built.version]) if built.version in self._given else None

    def wait(self) -> None:
        """Until what was shown last is built. Raises `FieldsNotBuilt`."""
        self._live.wait()

    def close(self) -> None:
        """Ends the process."""
        self._live.close()

    def __enter__(self) -> LiveWays:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class ToldWays:
    """Builds what a log says was built, when it says so: bit for bit the same fields."""

    def __init__(self, still: HodPf, moving: Sequence[Obstacle]) -> None:
        self._still, self._moving = still, tuple(moving)
        self._rebuilder = Rebuilder(still.grid.resolution_m, (0.0, still.margin_m))
        self._newest: Built | None = None

    def tell(self, poses: Array, measured_s: float) -> None:
        """From now on the newest ways are of these poses (M, 7), seen at `measured_s` [s]."""
        scene = MomentaryScene.of(self._still.scene, (*self._still.scene.obstacles, *moved(self._moving, poses)))
        fields = hod_pf_of(scene, self._rebuilder.solve(scene), self._still.margin_m, self._still.params)
        self._newest = Built(fields, poses, measured_s)

    def show(self, poses: Array, measured_s: float) -> None:
        """See `Ways.show`: a log knows which were built."""

    def newest(self) -> Built | None:
        """See `Ways.newest`."""
        return self._newest
