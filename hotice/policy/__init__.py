"""Shipped policies, and what is needed to run one without PyTorch: its file, its observation, its constants.

Between `hotice.fields` and everything that acts: diagrams and the robot read policies from here, and so does
`hotice.learn`, which writes them. `tests/policy` holds the observation equal to the batched environment's.
"""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.policy.guidance import FieldReading, read_fields
    from hotice.policy.observation import Carrying, observe
    from hotice.policy.percept import Percept, PerceptModel
    from hotice.policy.policy_file import PolicySession, check_layout, open_policy, read_onnx_meta, shipped_policies
    from hotice.task.policy_task import PolicyTask
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "Carrying",
    "FieldReading",
    "Percept",
    "PerceptModel",
    "PolicySession",
    "PolicyTask",
    "check_layout",
    "observe",
    "open_policy",
    "read_fields",
    "read_onnx_meta",
    "shipped_policies",
]
