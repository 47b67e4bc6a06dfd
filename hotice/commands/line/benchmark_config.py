"""Options of `hotice benchmark`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.learn.train.config import TrainConfig
from hotice.task.config import TaskConfig

BENCHMARK_BLOCK = 10
"""Control steps that environment and bare physics are timed for in turn."""


@dataclass(frozen=True, kw_only=True)
class BenchmarkConfig:
    """One benchmark."""

    num_envs: tuple[int, ...] = (1024,)
    """Parallel environments, one measurement each; on a GPU for example 1024 2048 4096 8192 16384."""
    updates: int = 2
    """Updates of training that are timed, after one that is not."""
    steps: int = 50
    """Control steps that are timed, in blocks of ten that alternate between environment and bare physics."""
    threads: int = 2
    """Threads of physics, fields and torch."""
    scenes: tuple[str, ...] = ("pipe", "gap", "pillars", "table_edge", "beam")
    """Scenes."""
    preset: str = "dual_hodpf"
    """Row of Table I."""
    physics: str = "mujoco"
    """Physics backend: "mujoco" on the CPU, "warp" on an NVIDIA GPU (or, slowly, the CPU)."""
    device: str = "auto"
    """Device of physics "warp" and of learning; "auto": the GPU for "warp" where there is one, else the CPU."""
    scan: bool = TaskConfig.scan
    """Whether the actors also read the local obstacle scan, distances ahead of feet and body (ours; the paper: fields
    only)."""
    history: int = TaskConfig.history
    """Past control steps of which the actors also read joints, IMU and actions (ours)."""
    perturbed: bool = TrainConfig.perturbed
    """Noise, delays, pushes and uncertain dynamics as for students (zero otherwise, or as given one by one)."""
    out: Path | None = None
    """Report file (JSON)."""

    def __post_init__(self) -> None:
        checks.whole("steps", self.steps, Range(least=BENCHMARK_BLOCK))
        checks.wholes(self, checks.COUNT, "updates", "threads")
        if not self.num_envs:
            raise InvalidConfig("num_envs is empty: at least one number of environments is needed")
        for num_envs in self.num_envs:
            self.training(num_envs)

    def training(self, num_envs: int) -> TrainConfig:
        """Training that is timed; raises `InvalidConfig` or `UnknownName`."""
        return TrainConfig(
            num_envs=num_envs,
            preset=self.preset,
            scenes=self.scenes,
            physics=self.physics,
            device=self.device,
            threads=self.threads,
            seed=0,
            perturbed=self.perturbed,
            task=replace(TrainConfig().task, scan=self.scan, history=self.history),
        )
