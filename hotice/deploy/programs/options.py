"""Options of guard and runner: what `hotice deploy` tells each, as one argument."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class GuardOptions:
    """A guard: where its robot is, and what it does. Checked by who asks for it."""

    slot: str
    """Name of the slot between guard and runner."""
    domain: int
    interface: str
    dry_run: bool
    """All but send."""
    log: str
    """Folder of its log."""
    has_controller: bool = False
    """Whether the robot has a controller of its own, which must not be active."""
    release_held: bool = False
    """Whether that one is released: somebody holds the robot."""
    keep_s: float | None = None
    """Length of the log's ring [s]; None: everything stays."""

    def text(self) -> str:
        """As an argument."""
        return json.dumps(asdict(self))

    @classmethod
    def of(cls, text: str) -> GuardOptions:
        return cls(**json.loads(text))


@dataclass(frozen=True, kw_only=True)
class RunnerOptions:
    """A runner: its scene, policy, object and sources. Checked by who asks for it."""

    slot: str
    scene: str
    """Name or file."""
    policy: str
    """Name or file."""
    box: tuple[float, float, float, float]
    """Size along x, y and z [m], mass [kg]."""
    pose_port: int
    tags_port: int
    log: str
    movers_port: int = 0
    """Of what moves, in a scene in which something does; 0: any free one."""
    moving: str = "near"
    """What is known of what moves: "near" or "live", see `hotice.task.moving.MovingConfig`."""
    pose_latency_s: float = 0.0
    tags_latency_s: float = 0.0
    keep_s: float | None = None
    view_port: int | None = None
    """Port of the live page, 0: any free one; None: no page."""

    def text(self) -> str:
        """As an argument."""
        return json.dumps(asdict(self))

    @classmethod
    def of(cls, text: str) -> RunnerOptions:
        said: dict[str, Any] = json.loads(text)
        return cls(**{**said, "box": tuple(said["box"])})
