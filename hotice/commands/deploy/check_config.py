"""Options of `hotice robot-check`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hotice import checks
from hotice.commands.deploy.config import DeployConfig
from hotice.deploy.checkup.joint_order import PATIENCE, check_joints
from hotice.deploy.checkup.watch import LONGEST
from hotice.deploy.sources.udp import POSE_PORT, TAGS_PORT
from hotice.model import g1


@dataclass(frozen=True, kw_only=True)
class RobotCheckConfig:
    """One robot that is looked at. Nothing is sent to it. Raises `InvalidConfig`."""

    robot: Literal["sim", "g1"] = "sim"
    """- sim: a simulated robot, `hotice robot-sim` in another terminal.
    - g1: a Unitree G1, hanging or held still."""
    scene: str = "open_floor"
    """Scene name or file that it shall walk in."""
    map: Path | None = None
    """The map file in which the robot localizes itself; it must be the one that the scene was imported from. Needed
    for g1."""
    policy: str = "student"
    """Policy name or .onnx file, whose steps are timed."""
    interface: str = ""
    """Network interface of the robot's cable; for sim "lo", this machine alone, unless another one is given."""
    domain: int | None = None
    """DDS domain; by default 1 for sim, 0 for g1."""
    seconds: float = 5.0
    """How long it is watched."""
    stands: bool = False
    """The robot stands on the scene's floor: the floor's height is checked, too."""
    joints: tuple[str, ...] = ()
    """Joints that somebody moves by hand, one after another as they are asked for, or `all`: is it these that the
    states say have moved? The robot hangs, its motors limp or braking."""
    joint_s: float = 30.0
    """Time for each."""
    pose_port: int = POSE_PORT
    """UDP port on this machine to which localization is sent."""
    tags_port: int = TAGS_PORT
    """UDP port on this machine to which corners of tags are sent."""

    def __post_init__(self) -> None:
        checks.number("seconds", self.seconds, LONGEST)
        checks.number("joint_s", self.joint_s, PATIENCE)
        # read once for what it raises
        _ = self.asked
        self.deployment  # noqa: B018

    @property
    def asked(self) -> tuple[str, ...]:
        """Joints that are to be moved, by name. Raises `UnknownName`."""
        return g1.ALL_JOINTS if self.joints == ("all",) else check_joints(self.joints)

    @property
    def deployment(self) -> DeployConfig:
        """The deployment that this robot would have."""
        return DeployConfig(
            robot=self.robot,
            scene=self.scene,
            map=self.map,
            policy=self.policy,
            interface=self.interface,
            domain=self.domain,
            pose_port=self.pose_port,
            tags_port=self.tags_port,
        )
