"""A station in numbers, from Python or from a YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hotice.errors import HoticeError, InputError, InvalidConfig
from hotice.files import read_bytes
from hotice.model.dynamics import (
    FRICTIONS,
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
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

MAX_FILE_BYTES = 2**20
SERVOS = ("pd", "motor")
SENSING = {"exact": SensingConfig(), "student": STUDENT_SENSING}
DYNAMICS = {
    "nominal": DynamicsConfig(),
    "student": STUDENT_DYNAMICS,
    "robot": ROBOT_DYNAMICS,
    "robot_nominal": ROBOT_NOMINAL,
    "paper": PAPER_DYNAMICS,
}
PARTS = {"sensing": SensingConfig, "dynamics": DynamicsConfig, "safety": SafetyLimits}


@dataclass(frozen=True, kw_only=True)
class StationConfig:
    """What stands where and how it is simulated. Raises `InvalidConfig` for impossible values."""

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
    push_interval_s: float = 7.5
    """Mean time between pushes (the evaluation's)."""
    seed: int = 0
    """Seed of the sensors' noise and delays, of dynamics and pushes."""
    elliptic: bool = False
    """Elliptic friction cones, solved to convergence (MuJoCo plant)."""
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
    log_hz: float = 0.0
    """Rate at which every signal is logged; 0: not at all."""
    meshcat_hz: float = 30.0
    """Rate at which the visualizer publishes."""

    def __post_init__(self) -> None:
        for name in ("meshcat_hz", "pelvis_height_m", "support_height_m", "support_near_m"):
            _number(name, getattr(self, name), above=0.0)
        for name in ("log_hz", "push_m_s"):
            _number(name, getattr(self, name))
        _number("push_interval_s", self.push_interval_s, least=0.1)
        _number("pick_bearing_rad", self.pick_bearing_rad, least=-np.pi)
        if self.physics_dt_s is not None:
            _number("physics_dt_s", self.physics_dt_s, above=0.0)
            if self.physics_dt_s > 0.01:
                raise InvalidConfig(f"physics_dt_s is {self.physics_dt_s!r}: at most 0.01 s, or contacts come apart")
        if self.servo not in SERVOS:
            raise InvalidConfig(f"servo is {self.servo!r}: known are {', '.join(SERVOS)}")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or not 0 <= self.seed < 2**31:
            raise InvalidConfig(f"seed is {self.seed!r}: a whole number from 0 to 2^31 - 1 is needed")
        for name in ("scene", "policy"):
            if name == "scene" and isinstance(self.scene, Scene):
                continue
            if not isinstance(getattr(self, name), str) or not getattr(self, name):
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: a name or a path is needed")
        if not isinstance(self.elliptic, bool):
            raise InvalidConfig(f"elliptic is {self.elliptic!r}: true or false is needed")
        for name, kind in {"carried": CarriedObject, "rehearsal": RehearsalConfig, **PARTS}.items():
            if not isinstance(getattr(self, name), kind):
                raise InvalidConfig(f"{name} is {getattr(self, name)!r}: see `StationConfig`")

    @classmethod
    def from_dict(cls, data: Any) -> StationConfig:
        """From plain values, as a YAML file holds them. Raises `InvalidConfig` or `InvalidObject`."""
        known = [f.name for f in fields(cls)]
        values = dict(_mapping("station", data, known))
        if "carried" in values:
            values["carried"] = object_from_dict(values["carried"])
        for part, known in (("sensing", SENSING), ("dynamics", DYNAMICS)):
            if isinstance(values.get(part), str):
                name = values[part]
                if name not in known:
                    raise InvalidConfig(f"{part} is {name!r}: known are {', '.join(known)}, or a mapping")
                values[part] = known[name]
        for name, kind in PARTS.items():
            if name in values and not isinstance(values[name], kind):
                part = _mapping(name, values[name], [f.name for f in fields(kind)])
                for key, value in part.items():
                    if key not in FRICTIONS:
                        _number(f"{name}.{key}", value)
                values[name] = kind(**part)
        if "rehearsal" in values and not isinstance(values["rehearsal"], RehearsalConfig):
            part = _mapping("rehearsal", values["rehearsal"], [f.name for f in fields(RehearsalConfig)])
            values["rehearsal"] = RehearsalConfig(**part)
        return cls(**values)

    @classmethod
    def load(cls, path: str | Path) -> StationConfig:
        """From a YAML file; nothing in it is executed. Raises `InvalidConfig` naming the file and what is wrong."""
        try:
            return cls.from_dict(yaml.safe_load(read_bytes(path, MAX_FILE_BYTES).decode()))
        except InputError as error:
            raise InvalidConfig(str(error)) from None
        except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
            raise InvalidConfig(f"{path}: is not YAML: {' '.join(str(error).split())}") from None
        except HoticeError as error:
            raise InvalidConfig(f"{path}: {error}") from None


def _mapping(what: str, data: Any, known: list[str]) -> Mapping[str, Any]:
    if not isinstance(data, Mapping):
        raise InvalidConfig(f"{what} is {data!r}: a mapping of {', '.join(known)} is needed")
    unknown = [str(key) for key in data if key not in known]
    if unknown:
        raise InvalidConfig(f"{what} has unknown key {unknown[0]!r}: known are {', '.join(known)}")
    return data


def _number(name: str, value: Any, above: float | None = None, least: float = 0.0) -> None:
    good = not isinstance(value, bool) and isinstance(value, int | float) and bool(np.isfinite(value))
    if not good or value < least or (above is not None and value <= above):
        allowed = f"at least {least:g}" if above is None else f"above {above:g}"
        raise InvalidConfig(f"{name} is {value!r}: a finite number {allowed} is needed")
