"""What a station knows of obstacles that move: where they are taken to be, and the fields with them."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportIndexIssue=false

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from hotice.fields.hod_pf import HodPf, hod_pf_of
from hotice.fields.moving.momentary import momentary_pf, moved, poses_of
from hotice.fields.rebuild import Rebuilder
from hotice.model.moving.sight import newest_s, seen_moving
from hotice.model.scene import MomentaryScene, Obstacle
from hotice.policy.guidance import read_fields
from hotice.policy.percept import Percept
from hotice.systems.signals import GUIDANCE, PERCEPT
from hotice.task.moving import MovingConfig
from hotice.task.policy_task import PolicyTask

Array = NDArray[np.float64]
POSE = 7
"""Numbers of a mover: position [m] and quaternion wxyz in W."""


class MoverPoses(LeafSystem):
    """Poses of a scene's moving obstacles as they are known, from their motions and the diagram's time.

    Outputs `movers` (7 M,): where they are taken to be now, see `POSE`; `ways` (1 + 7 M,): the time of the newest
    moment whose ways are known [s], a multiple of 1 / `ways_hz`, and the poses then.

    Args:
        moving: obstacles with a motion.
        config: rate and delay of what is seen.
        exact: all is known as it is, without delay.
    """

    def __init__(self, moving: Sequence[Obstacle], config: MovingConfig, exact: bool) -> None:
        super().__init__()
        self._moving, self._config, self._exact = tuple(moving), config, exact
        size, time = POSE * len(self._moving), {self.time_ticket()}
        self.DeclareVectorOutputPort("movers", size, self._output_movers, time)
        self.DeclareVectorOutputPort("ways", 1 + size, self._output_ways, time)

    def _output_movers(self, context: Context, output: BasicVector) -> None:
        now_s, config = context.get_time(), self._config
        if self._exact:
            known = tuple(o.at(now_s) for o in self._moving)
        else:
            known = seen_moving(self._moving, now_s, config.sensor_hz, config.sensor_delay_s)
        output.SetFromVector(poses_of(known).ravel())

    def _output_ways(self, context: Context, output: BasicVector) -> None:
        seen_s = context.get_time() - (0.0 if self._exact else self._config.sensor_delay_s)
        then_s = newest_s(max(seen_s, 0.0), self._config.ways_hz)
        output.SetFromVector([then_s, *poses_of([o.at(then_s) for o in self._moving]).ravel()])


class MovingGuidance(LeafSystem):
    """Fields of a scene in which something moves, at the keypoints of a percept.

    Inputs `percept` (119,), `movers` (7 M,), `ways` (1 + 7 M,), see `MoverPoses`; of a robot, from its own sensors.
    Outputs `guidance` (122,): `FieldReading`, in W [m/s, m, rad]; `age` (1,): how old the ways are [s], NaN where they
    are those of what stands still.

    With `live` ways, the geodesic distance is that of everything at the newest moment; those fields are built when
    they are first asked for (some 0.1 s), and depend on the ports alone: a run that is repeated is the same.

    Args:
        still: both fields of what never moves.
        moving: obstacles with a motion, whose shapes count.
        task: constants of the command, and which field hands and object read.
        live: ways are those of the moment.
    """

    def __init__(self, still: HodPf, moving: Sequence[Obstacle], task: PolicyTask, live: bool) -> None:
        super().__init__()
        self.pf, self.task, self._moving, self._live = still, task, tuple(moving), live
        self._rebuilder = Rebuilder(still.grid.resolution_m, (0.0, still.margin_m), threads=2)
        self._newest: tuple[bytes, HodPf] | None = None
        size = POSE * len(self._moving)
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._movers = self.DeclareVectorInputPort("movers", size)
        self._ways = self.DeclareVectorInputPort("ways", 1 + size)
        reads = {self._percept.ticket(), self._movers.ticket()} | ({self._ways.ticket()} if live else set())
        self.DeclareVectorOutputPort("guidance", GUIDANCE, self._output, reads)
        self.DeclareVectorOutputPort("age", 1, self._output_age, {self._ways.ticket(), self.time_ticket()})

    def _output(self, context: Context, output: BasicVector) -> None:
        movers = moved(self._moving, self._movers.Eval(context).reshape(-1, POSE))
        newest = self._fields(self._ways.Eval(context)[1:]) if self._live else None
        percept = Percept(self._percept.Eval(context))
        output.SetFromVector(read_fields(momentary_pf(self.pf, movers, newest), percept, self.task).vector)

    def _output_age(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([context.get_time() - self._ways.Eval(context)[0] if self._live else np.nan])

    def _fields(self, poses: Array) -> HodPf:
        """Fields of everything, movers at `poses` (7 M,); the newest are kept."""
        which = poses.tobytes()
        if self._newest is None or self._newest[0] != which:
            scene, movers = self.pf.scene, moved(self._moving, poses.reshape(-1, POSE))
            all_ = MomentaryScene.of(scene, (*scene.obstacles, *movers))
            nodes = self._rebuilder.solve(all_)
            self._newest = which, hod_pf_of(all_, nodes, self.pf.margin_m, self.pf.params)
        return self._newest[1]
