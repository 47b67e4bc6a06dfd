"""Options of `hotice deploy`."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hotice import checks
from hotice.checks import Range
from hotice.deploy.dds.node import LARGEST_DOMAIN, LOOPBACK
from hotice.deploy.slot.slot import slot_path
from hotice.deploy.sources.udp import MOVERS_PORT, POSE_PORT, TAGS_PORT
from hotice.errors import InvalidConfig
from hotice.files import read_bytes
from hotice.model.scene import Scene
from hotice.model.shipped import load_scene

PORT = Range(least=1, most=65535)
LATENCY = Range(least=0, most=0.5, unit="s")
ROBOT_DOMAIN, SIMULATED_DOMAIN = 0, 1
MOST_MAP_BYTES = 4 * 2**30


@dataclass(frozen=True, kw_only=True)
class DeployConfig:
    """One robot, its scene, its policy and what it carries. Raises `InvalidConfig`."""

    robot: Literal["sim", "g1"] = "sim"
    """- sim: a simulated robot, `hotice robot-sim` in another terminal.
    - g1: a Unitree G1, hanging from its gantry. Nothing of this was ever run on one: read docs/deploy.md first."""
    scene: str = "open_floor"
    """Scene name or file: its obstacles, and the goal."""
    map: Path | None = None
    """The map file in which the robot localizes itself; it must be the one that the scene was imported from. Needed
    for g1."""
    policy: str = "student"
    """Policy name or .onnx file."""
    box: tuple[float, float, float, float] = (0.30, 0.30, 0.25, 1.5)
    """The object: size along x, y and z [m], mass [kg]."""
    interface: str = ""
    """Network interface of the robot's cable; for sim "lo", this machine alone, unless another one is given."""
    domain: int | None = None
    """DDS domain; by default 1 for sim, 0 for g1."""
    dry_run: bool = False
    """Do all but send commands."""
    release_held: bool = False
    """Somebody has made sure that the robot hangs or sits: release its own controller, which makes it limp at once.
    Without this an active one is refused, and nothing is sent. For g1."""
    log: Path | None = None
    """Folder for the log of everything, about 80 MB a minute; without it a ring of the last minute lies in the user's
    own cache."""
    view: bool = False
    """Show the robot live on a page in the browser, for this machine alone; its address is told."""
    view_port: int = 0
    """Port of that page; 0 takes any free one."""
    pose_port: int = POSE_PORT
    """UDP port on this machine to which localization is sent."""
    tags_port: int = TAGS_PORT
    """UDP port on this machine to which corners of tags are sent."""
    movers_port: int = MOVERS_PORT
    """UDP port on this machine to which poses of obstacles that move are sent, for scenes that have some."""
    moving: Literal["near", "live"] = "near"
    """What the policy knows of obstacles that move: `near`, distances and repulsion; `live`, also the ways that are
    open, whose fields another process builds five times a second."""
    pose_latency_s: float = 0.0
    """From a measurement of localization until its pose comes, as far as it is known [s]."""
    tags_latency_s: float = 0.0
    """From a picture's exposure until its tags come, for a camera's program that does not run by this machine's clock,
    as far as it is known [s]."""

    def __post_init__(self) -> None:
        checks.one_of("robot", self.robot, ("sim", "g1"))
        checks.vector("box", self.box, 4, checks.POSITIVE)
        if self.domain is not None:
            checks.whole("domain", self.domain, Range(least=0, most=LARGEST_DOMAIN))
        checks.whole("view_port", self.view_port, Range(least=0, most=65535))
        checks.whole("pose_port", self.pose_port, PORT)
        checks.whole("tags_port", self.tags_port, PORT)
        checks.whole("movers_port", self.movers_port, PORT)
        checks.one_of("moving", self.moving, ("near", "live"))
        checks.number("pose_latency_s", self.pose_latency_s, LATENCY)
        checks.number("tags_latency_s", self.tags_latency_s, LATENCY)
        if self.robot == "g1" and self.interface in ("", LOOPBACK):
            raise InvalidConfig("interface is needed for g1: the network interface that its cable is in")
        if self.robot == "g1" and self.map is None:
            raise InvalidConfig("map is needed for g1: the map file in which it localizes itself")
        if self.release_held and (self.robot != "g1" or self.dry_run):
            raise InvalidConfig(
                "release_held is True: only --robot g1 without --dry-run releases the robot's controller; leave it out"
            )
        # read once for what it raises
        slot_path(self.slot)

    @property
    def network(self) -> tuple[str, int]:
        """Interface and domain."""
        default = SIMULATED_DOMAIN if self.robot == "sim" else ROBOT_DOMAIN
        return self.interface or LOOPBACK, default if self.domain is None else self.domain

    @property
    def slot(self) -> str:
        """Name of the slot between guard and runner: one for each robot that this machine can reach."""
        interface, domain = self.network
        return "".join(c if c.isalnum() else "-" for c in f"{interface.lower()}-{domain}")


def fitting_scene(config: DeployConfig) -> Scene:
    """The scene, which is the given map's. Raises `HoticeError`."""
    scene = load_scene(config.scene)
    if config.map is None:
        return scene
    if scene.source is None:
        raise InvalidConfig(
            f"scene {scene.name!r} says no map that it was made from, so that a pose in {config.map} means nothing in "
            f"it: import the scene from that map with `hotice scene import`"
        )
    digest = hashlib.sha256(read_bytes(config.map, MOST_MAP_BYTES)).hexdigest()
    if digest != scene.source.sha256:
        raise InvalidConfig(
            f"{config.map} is not the map of scene {scene.name!r}, {scene.source.file} (SHA-256 {digest[:12]}…, "
            f"{scene.source.sha256[:12]}… is needed): import the scene from the map in which the robot localizes itself"
        )
    return scene
