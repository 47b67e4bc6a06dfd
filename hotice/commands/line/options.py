"""Options of each command by its name; a type is imported when it is asked for, so that one command pays for itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, get_type_hints

from hotice.lazy import lazy_face

if TYPE_CHECKING:
    from hotice.commands.configs import ExportConfig, MergeConfig, PipelineConfig, PlayConfig
    from hotice.commands.deploy.check_config import RobotCheckConfig
    from hotice.commands.deploy.config import DeployConfig
    from hotice.commands.line.benchmark_config import BenchmarkConfig
    from hotice.commands.line.scene_config import CheckConfig, GenerateConfig, ImportConfig, ScanConfig, ShowConfig
    from hotice.commands.live.watch_config import WatchConfig
    from hotice.commands.picks.config import PlanConfig
    from hotice.commands.recipes import ReproduceConfig
    from hotice.commands.robot_sim_config import RobotSimConfig
    from hotice.commands.tags_config import TagCameraConfig, TagsConfig
    from hotice.evaluate.config import EvaluateConfig
    from hotice.evaluate.pick_config import PickEvaluateConfig
    from hotice.learn.distill.config import DistillConfig, FinetuneConfig
    from hotice.learn.distill.pick_config import PickDistillConfig
    from hotice.learn.train.config import TrainConfig
    from hotice.learn.train.pick_config import PickTrainConfig
    from hotice.model.importers.options import Front3dConfig
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "BenchmarkConfig",
    "CheckConfig",
    "DeployConfig",
    "DistillConfig",
    "EvaluateConfig",
    "ExportConfig",
    "field_names",
    "FinetuneConfig",
    "Front3dConfig",
    "GenerateConfig",
    "ImportConfig",
    "MergeConfig",
    "OPTIONS",
    "PICKUP_OPTIONS",
    "PickDistillConfig",
    "PickEvaluateConfig",
    "PickTrainConfig",
    "PipelineConfig",
    "PlanConfig",
    "PlayConfig",
    "ReproduceConfig",
    "RobotCheckConfig",
    "RobotSimConfig",
    "ScanConfig",
    "SCENE_OPTIONS",
    "ShowConfig",
    "TagCameraConfig",
    "TagsConfig",
    "TrainConfig",
    "WatchConfig",
]


class LazyTypes(Mapping[str, type]):
    """Types of options by command, each the name of one that this module imports."""

    def __init__(self, names: Mapping[str, str]) -> None:
        self._names = names

    def __getitem__(self, command: str) -> type:
        return getattr(sys.modules[__name__], self._names[command])

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


OPTIONS = LazyTypes(
    {
        "train": "TrainConfig",
        "distill": "DistillConfig",
        "finetune": "FinetuneConfig",
        "pipeline": "PipelineConfig",
        "evaluate": "EvaluateConfig",
        "reproduce": "ReproduceConfig",
        "merge": "MergeConfig",
        "export": "ExportConfig",
        "play": "PlayConfig",
        "watch": "WatchConfig",
        "benchmark": "BenchmarkConfig",
        "robot-sim": "RobotSimConfig",
        "robot-check": "RobotCheckConfig",
        "deploy": "DeployConfig",
        "tags": "TagsConfig",
        "tag-camera": "TagCameraConfig",
    }
)
"""Types of the options of each command that has any; `hotice scene` is a group of its own."""
SCENE_OPTIONS = LazyTypes(
    {
        "import": "ImportConfig",
        "import-front3d": "Front3dConfig",
        "scan": "ScanConfig",
        "show": "ShowConfig",
        "check": "CheckConfig",
        "generate": "GenerateConfig",
    }
)
"""The same of `hotice scene`."""
PICKUP_OPTIONS = LazyTypes(
    {
        "plan": "PlanConfig",
        "distill": "PickDistillConfig",
        "train": "PickTrainConfig",
        "evaluate": "PickEvaluateConfig",
    }
)
"""The same of `hotice pickup`."""


def field_names(config: type) -> set[str]:
    """Names of all options of a type, those of its groups included."""
    hints, names = get_type_hints(config), set()
    for each in fields(config):
        kind = hints[each.name]
        names |= field_names(kind) if is_dataclass(kind) and isinstance(kind, type) else {each.name}
    return names
