"""Training in numbers. Sources: paper, CAT, FALCON, or ours."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig, UnknownName
from hotice.files import make_folder, write_text
from hotice.learn.branches.config import BranchConfig
from hotice.learn.ppo.config import PpoConfig
from hotice.sim.physics.protocol import BACKENDS
from hotice.sim.starts import NEAREST_M
from hotice.task.config import TaskConfig
from hotice.task.presets import get_preset
from hotice.version import source_version

MOST_TRIALS = 10_000


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """One training run."""

    out: Path = Path("runs/latest")
    """Folder of the run: checkpoints, TensorBoard events, configuration."""
    preset: str = "dual_hodpf"
    """Row of Table I: dual_hodpf, dual_sgf, single_hodpf, single_sgf."""
    scenes: tuple[str, ...] = ("open_floor",)
    """Scene names, files, folders, or families as `family:NAME:COUNT`."""
    num_envs: int = 1024
    """Parallel environments, of each branch where there are several."""
    updates: int = 1_000_000
    """Stop after this many updates in all, of each branch where there are several."""
    max_minutes: float = 0.0
    """Stop after this many minutes of this call; 0: no limit."""
    resume: bool = False
    """Go on from the newest checkpoint in `out`, where there is one: then `init` is not read, `seed` must be the run's,
    and a learning rate other than the run's begins anew."""
    init: Path | None = None
    """Start from networks, normalisers and optimiser (not the counters) of this checkpoint or run; without the
    optimiser where that served another objective (a student's, when PPO goes on from it) or is an average's. A
    learning rate other than that run's begins anew."""
    critic_updates: int = 0
    """First updates that train only the critics: they get to know the task before they lead the actors."""
    curriculum: bool = True
    """Draw scenes that still fail more often than solved ones."""
    curriculum_distance_m: float = 0.0
    """Start within this way of the goal, at least 0.3, and farther away as more episodes reach it; 0: at any
    distance."""
    curriculum_objects: float = 0.0
    """Start with this share of the objects, the smallest, and larger ones as more episodes reach the goal; 0: with
    all."""
    seed: int = 0
    """Seed of every random draw."""
    checkpoint_minutes: float = 3.0
    """Time between checkpoints; of several branches each writes its own, their average is written when it is taken."""
    checkpoint_updates: int = 0
    """Also checkpoint every so many updates; 0: no."""
    trials: int = 0
    """Trials of the averaged policy at each checkpoint, always the same ones: success, distance, and their ways seen
    from above in TensorBoard; 0: none."""
    wandb: str | None = None
    """Project of Weights & Biases that gets what TensorBoard gets (extra `wandb`); without one nothing leaves this
    machine."""
    view: bool = False
    """Shows the run on a page in the browser, for this machine alone, whose address is told: its curves, and walks of
    each new checkpoint. Another process of low priority makes them; what is learned is the same."""
    view_port: int = 0
    """Port of that page; 0 takes any free one."""
    physics: str = "mujoco"
    """Simulator: "mujoco" on the CPU, "warp" on an NVIDIA GPU."""
    device: str = "auto"
    """Device of physics "warp" and of learning: a torch device; "auto": the GPU for "warp" where there is one, else the
    CPU."""
    threads: int = 0
    """Threads of physics and torch, of each branch where there are several; 0: all cores that this process may use,
    which branches share out."""
    hidden: tuple[int, ...] = (256, 128)
    """Hidden layers of each actor."""
    critic_hidden: tuple[int, ...] = (256, 128)
    """Hidden layers of each critic."""
    init_std: tuple[float, float] = (0.6, 0.3)
    """First standard deviation of leg and arm actions."""
    average: float = 0.98
    """Decay of the moving average of the weights, which is evaluated and exported (ours); 0: no averaging."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Optimiser."""
    split: BranchConfig = field(default_factory=BranchConfig)
    """Branches."""
    perturbed: bool = False
    """Noise, delays, pushes and uncertain dynamics as for students (zero otherwise, or as given one by one)."""
    task: TaskConfig = field(default_factory=lambda: TaskConfig(anywhere=0.7, end_at_goal=False))
    """Task."""

    CAN_TRY: ClassVar[bool] = True
    """Whether `trials` may be asked for."""
    CAN_VIEW: ClassVar[bool] = True
    """Whether `view` may be asked for."""
    CAN_BRANCH: ClassVar[bool] = True
    """Whether `branches` may be asked for."""
    NEEDS_INIT: ClassVar[bool] = False
    """Whether a run of this kind begins from another one."""

    def __post_init__(self) -> None:
        checks.wholes(self, checks.COUNT, "num_envs", "updates")
        if (self.num_envs * self.ppo.steps) % self.ppo.minibatches:
            raise InvalidConfig(
                f"{self.num_envs} environments x {self.ppo.steps} steps do not divide into {self.ppo.minibatches} "
                "minibatches: change one of them"
            )
        checks.numbers(self, checks.INT64, "max_minutes", "checkpoint_minutes")
        checks.wholes(self, checks.INT64, "checkpoint_updates", "critic_updates", "threads", "seed")
        checks.whole("trials", self.trials, Range(least=0, most=MOST_TRIALS))
        if self.trials and not self.CAN_TRY:
            raise InvalidConfig(
                f"trials is {self.trials}: pick-ups are scored by `hotice pickup evaluate`, leave it out"
            )
        checks.whole("view_port", self.view_port, Range(least=0, most=65535))
        if self.view and not self.CAN_VIEW:
            raise InvalidConfig("view is true: pick-ups are not shown while they are learned, leave it out")
        if self.view_port and not self.view:
            raise InvalidConfig(f"view_port is {self.view_port!r}: there is no page without view, give both")
        if self.split.several and not self.CAN_BRANCH:
            raise InvalidConfig(
                f"branches is {self.split.branches}, or the step of averages is not plain: a distillation is one "
                "process (or several ranks, by torchrun), leave it out"
            )
        if self.wandb is not None and not self.wandb.strip():
            raise InvalidConfig("wandb is empty: the name of a project is needed, or none")
        if self.curriculum_distance_m != 0:
            far = Range(least=NEAREST_M, unit="m", note="or 0: at any distance")
            checks.number("curriculum_distance_m", self.curriculum_distance_m, far)
        checks.number("curriculum_objects", self.curriculum_objects, checks.SHARE)
        checks.vector("hidden", self.hidden, None, checks.COUNT)
        checks.vector("critic_hidden", self.critic_hidden, None, checks.COUNT)
        checks.vector("init_std", self.init_std, 2, checks.POSITIVE)
        checks.number("average", self.average, Range(least=0, below=1))
        if self.perturbed:
            _check_students(self.task)
        get_preset(self.preset)
        if self.physics not in BACKENDS:
            raise UnknownName("physics backend", self.physics, BACKENDS)
        self.torch_device()
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")

    def begins_from(self) -> tuple[Path, ...]:
        """Checkpoints or runs that are read before the first update."""
        return () if self.init is None else (self.init,)

    def torch_device(self) -> str:
        """The device to use. Raises `InvalidConfig` for one that torch does not know or that is not there."""
        if self.device == "cpu" or (self.device == "auto" and self.physics != "warp"):
            return "cpu"
        # only here: torch takes seconds to import, and what is given wrongly is to be said at once
        import torch

        if self.device == "auto":
            return "cuda" if torch.cuda.is_available() else "cpu"
        try:
            kind = torch.device(self.device).type
        except RuntimeError:
            raise InvalidConfig(f"device is {self.device!r}: auto, cpu, cuda or cuda:N is needed") from None
        if kind not in ("cpu", "cuda"):
            raise InvalidConfig(f"device is {self.device!r}: auto, cpu, cuda or cuda:N is needed")
        if kind == "cuda" and not torch.cuda.is_available():
            raise InvalidConfig(f"device {self.device!r} is not there: torch sees no such GPU on this machine")
        if kind == "cuda" and self.physics == "mujoco":
            raise InvalidConfig("physics 'mujoco' runs on the CPU: give --physics warp with a GPU")
        return self.device


def _check_students(task: TaskConfig) -> None:
    """Raises `InvalidConfig` where a source of perturbation is given by hand that `perturbed` would replace."""
    exact, student = TaskConfig(), TaskConfig().perturbed()
    for name in ("sensing", "dynamics", "push_m_s"):
        if getattr(task, name) not in (getattr(exact, name), getattr(student, name)):
            raise InvalidConfig(
                f"{name} is set explicitly, but --perturbed replaces it by the students' values: use --no-perturbed "
                "and set every source of perturbation yourself"
            )


def config_to_dict(config: Any) -> Any:
    """A configuration as JSON-ready values."""
    return json.loads(json.dumps(dataclasses.asdict(config), default=str))


def write_config(config: TrainConfig) -> None:
    """Writes `config.json` of a run, aside and renamed. Raises `OutputError`."""
    content = {**config_to_dict(config), "source": source_version()}
    write_text(make_folder(config.out) / "config.json", json.dumps(content, indent=1) + "\n")
