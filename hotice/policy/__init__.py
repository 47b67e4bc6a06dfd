"""Shipped policies, and what is needed to run one without PyTorch: its file, its observation, its constants.

Between `hotice.fields` and everything that acts: diagrams and the robot read policies from here, and so does
`hotice.learn`, which writes them. `tests/policy` hold the observation equal to the batched environment's.
"""

from hotice.policy.percept import Percept, PerceptModel
from hotice.policy.policy_file import PolicySession, check_layout, open_policy, read_onnx_meta, shipped_policies
from hotice.task.policy_task import PolicyTask

__all__ = [
    "Percept",
    "PerceptModel",
    "PolicySession",
    "PolicyTask",
    "check_layout",
    "open_policy",
    "read_onnx_meta",
    "shipped_policies",
]
