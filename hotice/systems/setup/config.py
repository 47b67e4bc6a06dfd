"""A station in numbers, from Python or from a YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hotice import checks
from hotice.checks import Range
from hotice.documents import read_yaml
from hotice.errors import HoticeError, InputError, InvalidConfig
from hotice.model.dynamics import (
    PAPER_DYNAMICS,
    ROBOT_DYNAMICS,
    ROBOT_NOMINAL,
    STUDENT_DYNAMICS,
    DynamicsConfig,
)
from hotice.model.objects import Box, CarriedObject, object_from_dict
from hotice.model.scene import Scene
from hotice.systems.safety_monitor import SafetyLimits
from hotice.systems.setup.rehearsal_config import RehearsalConfig
from hotice.task.config import TaskConfig
from hotice.task.contract import SHORTEST_S
from hotice.task.moving import KNOWN, MovingConfig
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

MAX_FILE_BYTES = 2**20
MOST_HZ = 1000.0
SERVOS = ("pd", "motor")
SENSING = {"exact": SensingConfig(), "student": STUDENT_SENSING}
DYNAMICS = {
    "nominal": DynamicsConfig(),
    "student": STUDENT_DYNAMICS,
    "robot": ROBOT_DYNAMICS,
    "robot_nominal": ROBOT_NOMINAL,
    "paper": PAPER_DYNAMICS,
}
PARTS = {"sensing": SensingConfig, "dynamics": DynamicsConfig, "moving": MovingConfig, "safety": SafetyLimits}


@dataclass(frozen=True, kw_only=True)
class StationConfig:
    """Robot, object, scene and simulation of a station. Raises `InvalidConfig` for impossible values."""

    scene: str | Scene = "open_floor"
    """Name of a shipped scene, the path of a scene file, or a scene."""
    carried: CarriedObject = field(default_factory=lambda: Box((0.30, 0.30, 0.30), 1.5))
    """The object; in a file a mapping with shape, sizes and mass_kg."""
    policy: str = "student"
    """Shipped policy by name, or an .onnx file."""
    pelvis_height_m: float = 0.74
    """Height at which the robot starts to carry."""
    servo: str = "motor"
    """motor: joint targets go to the motors' own servos, which the plant integrates implicitly, as in training. pd: a
    servo commands torques every physics step: the MuJoCo plant's own, for the Drake plant `joint_pd` in the diagram.
    Controllers that command torques need neither."""
    physics_dt_s: float | None = None
    """Step of either plant, and of the torque loop; the control period must be a multiple. Default: as in training
    where the policy drives the MuJoCo plant's own servos, else 0.002 s."""
    sensing: SensingConfig = field(default_factory=SensingConfig)
    """Noise and delay of what the policy reads; in a file exact, student or a mapping."""
    dynamics: DynamicsConfig = field(default_factory=DynamicsConfig)
    """Spread of gains, friction, masses and motors; the robot is drawn once, by the seed (MuJoCo plant). In a file
    nominal, student, robot, robot_nominal or paper (see docs/contacts.md), or a mapping."""
    push_m_s: float = 0.0
    """Largest push, a sudden change of the pelvis' velocity (MuJoCo plant; students: 1.0); 0: none."""
    push_interval_s: float = TaskConfig.push_interval_s
    """Mean time between pushes (the evaluation's)."""
    seed: int = 0
    """Seed of the sensors' noise and delays, of dynamics and pushes."""
    elliptic: bool = False
    """Elliptic friction cones, solved to convergence (MuJoCo plant)."""
    moving: MovingConfig | Literal["still", "near", "live"] = field(default_factory=MovingConfig)
    """What the policy's fields know of obstacles that move, in scenes that have some, by name or in numbers; exact
    sensing knows them without delay."""
    safety: SafetyLimits = field(default_factory=SafetyLimits)
    """Limits beyond which commands no longer pass."""
    support_height_m: float = 0.6
    """Top of the table from which the object is picked up."""
    rehearsal: RehearsalConfig = field(default_factory=RehearsalConfig)
    """Rehearsal of the policy before it takes over from a pick-up; if it fails, of the walking baseline; if both fail,
    the pick-up holds on."""
    support_near_m: float = 0.25
    """Distance from between the feet to the table's near edge."""
    pick_bearing_rad: float = np.pi / 2
    """Direction of the table from the scene's heading at the start, left positive; ahead (0) it is in the way."""
    put_height_m: float = 0.6
    """Top of the support at the goal, on which a `job` ends."""
    put_ahead_m: float = 0.35
    """Distance from the goal to where the robot stands before that support; it steps there from where it arrives."""
    put_near_m: float = 0.25
    """Distance from there to the support's near edge."""
    put_bearing_rad: float = 0.0
    """Direction of that support from the goal, from that of the way from start to goal, left positive."""
    log_hz: float = 0.0
    """Rate at which every signal is logged; 0: not at all."""
    meshcat_hz: float = 30.0
    """Rate at which the visualizer publishes."""

    def __post_init__(self) -> None:
        if isinstance(self.moving, str):
            object.__setattr__(self, "moving", MovingConfig(known=checks.one_of("moving", self.moving, KNOWN)))
        checks.number("meshcat_hz", self.meshcat_hz, Range(above=0, most=MOST_HZ))
        checks.number("log_hz", self.log_hz, Range(least=0, most=MOST_HZ))
        checks.numbers(self, checks.POSITIVE, "pelvis_height_m", "support_height_m", "support_near_m")
        checks.numbers(self, checks.NOT_NEGATIVE, "push_m_s")
        checks.number("push_interval_s", self.push_interval_s, Range(least=0.1))
        checks.numbers(self, checks.POSITIVE, "put_height_m", "put_near_m")
        checks.number(
            "put_ahead_m", self.put_ahead_m, Range(least=0.0, most=0.8, unit="m", note="the robot steps there")
        )
        checks.number("put_bearing_rad", self.put_bearing_rad, Range(least=-np.pi, most=np.pi))
        checks.number("pick_bearing_rad", self.pick_bearing_rad, Range(least=-np.pi))
        if self.physics_dt_s is not None:
            note = "contacts come apart at longer steps"
            checks.number("physics_dt_s", self.physics_dt_s, Range(least=SHORTEST_S, most=0.01, unit="s", note=note))
        checks.one_of("servo", self.servo, SERVOS)
        checks.whole("seed", self.seed, Range(least=0, most=2**31 - 1))
        for name in ("policy",) if isinstance(self.scene, Scene) else ("scene", "policy"):
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: a name or a path is needed")
        checks.flag("elliptic", self.elliptic)
        for name, kind in {"carried": CarriedObject, "rehearsal": RehearsalConfig, **PARTS}.items():
            if not isinstance(getattr(self, name), kind):
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: see `StationConfig`")

    @classmethod
    def from_dict(cls, data: Any) -> StationConfig:
        """From plain values, as a YAML file holds them. Raises `InvalidConfig` or `InvalidObject`."""
        values = dict(_mapping("station", data, cls))
        if "carried" in values:
            values["carried"] = object_from_dict(values["carried"])
        for part, known in (("sensing", SENSING), ("dynamics", DYNAMICS)):
            if isinstance(values.get(part), str):
                values[part] = known[checks.one_of(part, values[part], known, otherwise="a mapping")]
        for name, kind in {**PARTS, "rehearsal": RehearsalConfig}.items():
            if (
                name in values
                and not isinstance(values[name], kind)
                and not (name == "moving" and values[name] in KNOWN)
            ):
                values[name] = _part(name, values[name], kind)
        return cls(**values)

    @classmethod
    def load(cls, path: str | Path) -> StationConfig:
        """From a YAML file; nothing in it is executed. Raises `InvalidConfig` naming the file and what is wrong."""
        try:
            data = read_yaml(path, MAX_FILE_BYTES)
        except InputError as error:
            raise InvalidConfig(str(error)) from None
        try:
            return cls.from_dict(data)
        except HoticeError as error:
            raise InvalidConfig(f"{path}: {error}") from None


def _mapping(where: str, data: Any, kind: type) -> Mapping[str, Any]:
    return checks.mapping(where, data, optional=[f.name for f in fields(kind)])


def _part(name: str, data: Any, kind: type) -> Any:
    values = _mapping(name, data, kind)
    try:
        return kind(**values)
    except InvalidConfig as error:
        raise InvalidConfig(f"{name}.{error}") from None
