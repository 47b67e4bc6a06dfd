"""Options of one evaluation."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig, UnknownName
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.referees import REFEREES, check_referees
from hotice.model.object_range import ObjectRange
from hotice.task.moving import MovingConfig

CONTROLLERS = ("policy", "walk")
TASKS = ("carry", "job")
OF_JOBS = ("task", "policy", "scenes", "rollouts", "seed", "out", "perturbed", "shapes", "size_m", "mass_kg")
"""Options of a whole job."""
LONGEST_S = 120.0
PAPER_S = 5.0
"""Time limit of the paper's trials."""


@dataclass(frozen=True, kw_only=True)
class EvaluateConfig:
    """One evaluation."""

    task: Literal["carry", "job"] = "carry"
    """`carry`: from a carry state to the goal. `job`: the whole job, picked up from a support at the start, carried,
    put down on a support at the goal; its trials run one after another in the Drake station (needs the extra `drake`),
    and it refuses what it does not have: see docs/pickup.md."""
    policy: str | None = None
    """Shipped policy by name, .onnx file, checkpoint folder or run; required for --controller policy, refused
    otherwise."""
    controller: Literal["policy", "walk"] = "policy"
    """Who carries: a policy, or the model-based walking baseline, which reads the exact state (needs --no-perturbed,
    and the packages of the extra `drake`)."""
    scenes: tuple[str, ...]
    """Scene names, sets (bench20, unseen50), files, folders, or families as `family:NAME:COUNT`."""
    rollouts: int = 100
    """Trials a scene."""
    seed: int = 0
    """Seed of objects, starts and perturbations."""
    out: Path | None = None
    """Report file (JSON); none: only print. What is done is kept in the folder OUT.trials beside it, and an evaluation
    of the same policy, scenes and settings goes on from there."""
    batch: int = 250
    """Trials that one process takes at a time: a policy's are simulated side by side."""
    threads: int = 0
    """Processes, each on one core; 0: one for each core that this process may use."""
    protocol: Literal["robot", "paper"] = "robot"
    """`robot`: 2 ms physics with converged elliptic cones, palms 0.6 to 1.2, soles 0.5 to 1.2, torso's centre of mass ±
    10 cm; `paper`: 5 ms physics with pyramids, palms 2.0, soles 0.8 to 1.2, ± 5 cm, to compare with the paper's
    tables."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics of the protocol."""
    without: tuple[str, ...] = ()
    """Sources of perturbation to switch off, to see what they cost: sensor-noise, object-noise, delay, root-rate,
    pushes, dynamics."""
    shapes: tuple[str, ...] = ("box",)
    """Shapes of the carried objects."""
    size_m: tuple[float, float] = (0.20, 0.40)
    """Smallest and largest extent of the objects."""
    mass_kg: tuple[float, float] = (0.5, 3.5)
    """Lightest and heaviest object."""
    objects: int = 256
    """Different objects, shared by all scenes; no more than `rollouts`. Each scene has an order of its own."""
    horizon_s: float = PAPER_S
    """Time limit of a trial (paper: 5 s)."""
    moving: Literal["still", "near", "live"] = "near"
    """What fields and scan know of obstacles that move, in scenes that have some: `still`, nothing; `near`, distances
    and repulsion, the ways being those of what stands still; `live`, also the ways that are open."""
    referees: tuple[str, ...] = REFEREES
    """Who judges the same trials: `exact`, contacts of the full geometry, whose verdicts the rates of a report are;
    `points`, eleven points of the body and eight of the object, beside it. `exact` alone is faster: a contact then ends
    a trial."""

    def __post_init__(self) -> None:
        checks.one_of("task", self.task, TASKS)
        if self.task == "job":
            self._check_job()
        self._check_carrier()
        horizon = Range(least=0.02, most=LONGEST_S, unit="s", note="0.02: a control step")
        checks.number("horizon_s", self.horizon_s, horizon)
        checks.wholes(self, checks.COUNT, "rollouts", "batch", "objects")
        checks.wholes(self, checks.INT64, "seed", "threads")
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")
        check_referees(self.referees)
        # read once for what they raise
        _ = self.conditions, self.object_range
        if self.without and not self.perturbed:
            raise InvalidConfig(
                f"without is {', '.join(self.without)}: nothing is left to switch off with --no-perturbed"
            )

    @property
    def conditions(self) -> Conditions:
        """Physics, perturbation and time limit."""
        return Conditions(
            protocol=self.protocol,
            perturbed=self.perturbed,
            without=self.without,
            horizon_s=self.horizon_s,
            moving=MovingConfig(known=self.moving),
        )

    @property
    def object_range(self) -> ObjectRange:
        """Objects that are drawn. Raises `InvalidObject`."""
        return ObjectRange(shapes=self.shapes, size_m=self.size_m, mass_kg=self.mass_kg)

    @property
    def judges(self) -> tuple[str, ...]:
        """The referees, in the order of `REFEREES`."""
        return tuple(name for name in REFEREES if name in self.referees)

    def _check_job(self) -> None:
        """Refuses what a whole job does not have."""
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name not in OF_JOBS and value != each.default:
                raise InvalidConfig(
                    f"{each.name} is {value!r} and task is 'job', which does not have it: leave it out; a job has "
                    f"{', '.join(OF_JOBS)}"
                )

    def _check_carrier(self) -> None:
        if self.controller not in CONTROLLERS:
            raise UnknownName("controller", self.controller, CONTROLLERS)
        if self.controller == "policy" and self.policy is None:
            raise InvalidConfig("no policy: give one as --policy NAME or PATH, or --controller walk")
        if self.controller == "walk" and self.policy is not None:
            raise InvalidConfig(
                f"policy is {self.policy!r} and controller is 'walk', which has no policy: leave out one of the two"
            )
        if self.controller == "walk" and self.perturbed:
            raise InvalidConfig(
                "perturbed is True: the walking baseline reads the exact state, it is not evaluated under noise, "
                "delays and pushes: give --no-perturbed, also to the policies that it is compared with"
            )
