"""The guidance fields as the robot reads them: vectors at its keypoints and the command they make."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false

from __future__ import annotations

from pydrake.systems.framework import BasicVector, Context, LeafSystem

from hotice.fields.hod_pf import HodPf
from hotice.policy.guidance import read_fields
from hotice.policy.percept import Percept
from hotice.systems.signals import GUIDANCE, PERCEPT
from hotice.task.policy_task import PolicyTask


class GuidanceFieldSystem(LeafSystem):
    """Input `percept` (119,). Output `guidance` (122,): `FieldReading`, in W [m/s, m, rad].

    Args:
        pf: both fields of the scene.
        task: constants of the command, and which field hands and object read.
    """

    def __init__(self, pf: HodPf, task: PolicyTask) -> None:
        super().__init__()
        self.pf, self.task = pf, task
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self.DeclareVectorOutputPort("guidance", GUIDANCE, self._output, {self._percept.ticket()})

    def _output(self, context: Context, output: BasicVector) -> None:
        percept = Percept(self._percept.Eval(context))
        output.SetFromVector(read_fields(self.pf, percept, self.task).vector)
