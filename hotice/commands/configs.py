"""Options of commands whose work has no home of its own: export, merge, play, pipeline."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """One export."""

    policy: Path
    """Checkpoint folder, or a run (its newest checkpoint)."""
    out: Path
    """ONNX file to write."""


@dataclass(frozen=True, kw_only=True)
class MergeConfig:
    """One average of branches."""

    parts: tuple[Path, ...]
    """Checkpoint folders, or runs (their newest checkpoints), that went on from the same networks."""
    out: Path
    """Folder of the run to write: one checkpoint."""


VIEWED = ("controller", "perturbed", "policy", "scenes", "seed", "view", "view_port")
"""Options of `PlayConfig` that a live view has a use for."""


@dataclass(frozen=True, kw_only=True)
class PlayConfig:
    """Rollouts to look at."""

    policy: str = "student"
    """Shipped policy by name, .onnx file, checkpoint folder or run; for other controllers than `policy` a name or .onnx
    file."""
    controller: Literal["policy", "walk", "pickup", "pickup_then_policy", "job"] = "policy"
    """Who carries. `policy`: the policy from a carry state; `walk`: the walking baseline; `pickup`: the pick-up from a
    table, alone; `pickup_then_policy`: then hands over to the policy; if the policy fails its rehearsal the walking
    baseline takes over; if that fails too, the pick-up keeps holding; `job`: picked up, carried by the
    policy without a rehearsal, put down on a support at the goal. All but `policy` need Drake."""
    scenes: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["--scene"])] = ("open_floor",)
    """Scene names, files or folders."""
    seconds: float = 10.0
    """Longest run of a controller other than `policy`, after the pick-up where there is one."""
    out: Path = Path("replay.html")
    """Replay page; a picture `.png` of the same name is written beside it."""
    video: Path | None = None
    """Film (.mp4, 1080 lines) of one rollout; needs imageio-ffmpeg, and OpenGL without a screen."""
    video_of: int = 0
    """Rollout that is filmed, by its number in the printed list; 0: the first that succeeds, or of none the first."""
    video_s: float = 60.0
    """Length of the film at most: of a longer rollout its end is shown."""
    rollouts: int = 2
    """Rollouts a scene, each with another object."""
    seed: int = 0
    """Seed of objects and starts."""
    perturbed: bool = True
    """Noise, delays, pushes and uncertain dynamics as in evaluation; under other controllers than `policy` noise and
    delays."""
    protocol: Literal["robot", "paper"] | None = None
    """Physics and perturbations as in `hotice evaluate` (default: robot); of controller `policy` alone."""
    moving: Literal["still", "near", "live"] = "near"
    """What controller `policy` knows of obstacles that move, in scenes that have some, as in `hotice evaluate`:
    `still`, nothing; `near`, distances and repulsion; `live`, also the ways that are open."""
    failures_first: bool = True
    """Lists failures before successes, by cause; otherwise scene by scene."""
    view: bool = False
    """Nothing is recorded: one scene is walked live on a page in the browser, for this machine alone, where obstacles
    are dragged and the robot is pushed; its address is told. Of a run the newest checkpoint walks."""
    view_port: int = 0
    """Port of that page; 0 takes any free one."""

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, Range(above=0, most=120))
        if self.out.suffix == ".png":
            raise InvalidConfig(
                f"out is {str(self.out)!r}: the picture goes there, give the page another ending (.html)"
            )
        if self.video is not None and self.video.suffix != ".mp4":
            raise InvalidConfig(f"video is {str(self.video)!r}: a film is an .mp4 file")
        checks.whole("video_of", self.video_of, Range(least=0, note="a place in the list, or 0"))
        checks.number("video_s", self.video_s, Range(least=1, most=600, unit="s"))
        for name in ("video_of", "video_s"):
            if self.video is None and getattr(self, name) != PlayConfig.__dataclass_fields__[name].default:
                raise InvalidConfig(
                    f"{name} is {getattr(self, name)!r}: nothing is filmed, give the film's file as video"
                )
        if self.protocol is not None and self.controller != "policy":
            raise InvalidConfig(
                f"protocol is {self.protocol!r} and controller {self.controller!r}, which has its own physics: "
                "leave it out"
            )
        if self.moving != "near" and self.controller != "policy":
            raise InvalidConfig(
                f"moving is {self.moving!r} and controller {self.controller!r}, which knows nothing that moves: "
                "leave it out"
            )
        if not self.scenes:
            raise InvalidConfig("no scenes: at least one name, file or folder is needed")
        checks.whole("rollouts", self.rollouts, Range(least=1, most=100))
        checks.whole("seed", self.seed, checks.INT64)
        checks.whole("view_port", self.view_port, Range(least=0, most=65535))
        if self.view:
            self._check_view()
        elif self.view_port:
            raise InvalidConfig(f"view_port is {self.view_port!r}: there is no page without view, give both")

    def _check_view(self) -> None:
        if self.controller != "policy":
            raise InvalidConfig(f"controller is {self.controller!r}: a live view shows a policy, leave it or view out")
        if self.moving != "near":
            raise InvalidConfig(
                f"moving is {self.moving!r}: a live view's fields follow what moves, leave it or view out"
            )
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name not in VIEWED and value != each.default:
                shown = repr(str(value) if isinstance(value, Path) else value)
                raise InvalidConfig(f"{each.name} is {shown}: nothing is recorded with view, leave it or view out")


@dataclass(frozen=True, kw_only=True)
class PipelineConfig:
    """One pipeline."""

    config: tyro.conf.Positional[Path]
    """Pipeline file (YAML)."""
    workers: int = 1
    """Jobs at a time on this machine; a cluster runs as many as it has room for."""
    retries: int = 2
    """Number of times a job is tried again when its process dies."""
    cluster: str | None = None
    """Ray cluster: its address, or "auto" for the one that this machine belongs to; none: processes of this machine."""

    def __post_init__(self) -> None:
        checks.whole("workers", self.workers, Range(least=1, most=1024))
        checks.whole("retries", self.retries, Range(least=0, most=1000))
