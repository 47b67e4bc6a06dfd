"""Learning: dual-agent PPO, distillation, fine-tuning, checkpoints."""

from typing import TYPE_CHECKING

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.learn.branches.config import BranchConfig
    from hotice.learn.branches.run import BranchedRun
    from hotice.learn.checkpoints.checkpoint import load_checkpoint, read_meta
    from hotice.learn.checkpoints.merge import merge
    from hotice.learn.checkpoints.trained_on import TrainedOn
    from hotice.learn.distill.config import DistillConfig, FinetuneConfig
    from hotice.learn.distill.dagger import DistillRunner
    from hotice.learn.export import check_export, export_onnx
    from hotice.learn.policy import Policy, load_policy, torch_policy
    from hotice.learn.ppo.config import PpoConfig
    from hotice.learn.train.config import TrainConfig
    from hotice.learn.train.runner import Runner
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "BranchConfig",
    "BranchedRun",
    "DistillConfig",
    "DistillRunner",
    "FinetuneConfig",
    "Policy",
    "PpoConfig",
    "Runner",
    "TrainConfig",
    "TrainedOn",
    "check_export",
    "export_onnx",
    "load_checkpoint",
    "load_policy",
    "merge",
    "read_meta",
    "torch_policy",
]
