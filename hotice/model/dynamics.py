"""Domain randomisation: robots whose gains, friction, inertia, masses and motors differ from the description.

A model is perturbed once, when the bank of carry states is compiled: environments that share a model share its robot,
and a bank of many states is a population of robots. Nothing here knows which simulator runs.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.model import g1

if TYPE_CHECKING:
    import mujoco

FRICTIONS = ("sole_friction", "palm_friction", "object_friction")
FRICTION = Range(above=0, most=10)
SHARES = ("gain", "mass", "motor_strength", "payload")


@dataclass(frozen=True, kw_only=True)
class DynamicsConfig:
    """Uniform spread of parameters: share around the nominal value or range in the unit named; 0 or None: nominal.

    What is drawn is what forces, weights and contacts are made of: `tests/sim/test_dynamics_felt.py`,
    `test_friction.py`. Frictions are what contacts feel: the geom of higher priority decides alone
    (`hotice.model.builder`), so nothing is combined.
    """

    gain: float = 0.0
    """Proportional and derivative gains, each joint and gain on its own (CAT: ± 0.25)."""
    friction_loss_nm: float = 0.0
    """Largest dry friction of a joint [N m], drawn from 0 on (ours: 0.2; CAT scales one that our description lacks by ±
    0.1)."""
    armature: float = 0.0
    """Armature of each joint, only upwards (CAT: + 0.05)."""
    mass: float = 0.0
    """Masses and inertias of the links, each on its own (CAT: ± 0.1)."""
    torso_mass_kg: float = 0.0
    """Further mass of the torso (CAT: ± 1)."""
    torso_com_m: float = 0.0
    """Centre of mass of the torso along each axis (CAT: ± 0.1)."""
    motor_strength: float = 0.0
    """Torque limits and the torque that a command gives, each motor on its own (ours: ± 0.1)."""
    joint_offset_rad: float = 0.0
    """Error of the joints' zero positions, in what encoders read and servos hold (ours: ± 0.01; CAT: ± 0.05)."""
    sole_friction: tuple[float, float] | None = None
    """Range of the friction between a foot and the floor, one draw for each foot (None: 1.0)."""
    palm_friction: tuple[float, float] | None = None
    """Range of the friction between palms and object, one draw for both palms (None: 2.0; the first author's fork:
    2.0)."""
    object_friction: tuple[float, float] | None = None
    """Range of the friction between the object and everything but palms: trunk, thighs, floor, obstacles (None:
    0.8)."""
    payload: float = 0.0
    """Mass and inertia of the carried object beside what the carry state assumes, as a share of it (ours: ± 0.1)."""

    def __post_init__(self) -> None:
        checks.numbers(self, checks.NOT_NEGATIVE, but=(*FRICTIONS, *SHARES))
        checks.numbers(self, Range(least=0, below=1), *SHARES)
        for name in FRICTIONS:
            if getattr(self, name) is not None:
                # of a file: a list
                object.__setattr__(self, name, checks.interval(name, getattr(self, name), FRICTION))

    @property
    def nominal(self) -> bool:
        """Whether every robot is as described."""
        return not any(vars(self).values())


ROBOT_DYNAMICS = DynamicsConfig(
    gain=0.25,
    friction_loss_nm=0.2,
    armature=0.05,
    mass=0.1,
    torso_mass_kg=1.0,
    torso_com_m=0.1,
    motor_strength=0.1,
    joint_offset_rad=0.01,
    sole_friction=(0.5, 1.2),
    palm_friction=(0.6, 1.2),
    object_friction=(0.64, 0.96),
    payload=0.1,
)
"""Dynamics of the protocol `robot`, for physics that does not creep: rubber palms on cardboard or plastic, shoes on any
floor."""

ROBOT_NOMINAL = DynamicsConfig(sole_friction=(0.85, 0.85), palm_friction=(0.9, 0.9))
"""The middle of `ROBOT_DYNAMICS`."""

PAPER_DYNAMICS = replace(ROBOT_DYNAMICS, torso_com_m=0.05, sole_friction=(0.8, 1.2), palm_friction=(2.0, 2.0))
"""Dynamics of the protocol `paper`: palms as in the first author's public fork."""

TRAINING_PALMS = {0.005: (1.7, 2.4), 0.010: (2.3, 3.0)}
"""By physics step [s], the friction with which pyramids creep as much as elliptic cones at 2 ms do with 0.6 and
upwards: from some 0.75 on no friction makes the coarse physics creep as little. Measured by `benchmarks.friction`, see
docs/contacts.md."""


def student_dynamics(physics_dt_s: float) -> DynamicsConfig:
    """Dynamics that students are trained under in physics steps of `physics_dt_s` [s]."""
    step = min((s for s in TRAINING_PALMS if s >= physics_dt_s - 1e-9), default=max(TRAINING_PALMS))
    return replace(ROBOT_DYNAMICS, palm_friction=TRAINING_PALMS[step])


STUDENT_DYNAMICS = student_dynamics(0.005)
"""Dynamics that students are trained under in the default physics step."""

LEAST_PUSH = 0.1
"""Least push, as a share of the largest (CAT: 0.1 of 1.0 m/s)."""


def perturb(model: mujoco.MjModel, config: DynamicsConfig, rng: np.random.Generator) -> mujoco.MjModel:
    """A copy of a model of `build_model` with parameters drawn from `config`; the copy's layout is the same."""
    import mujoco

    from hotice.model import builder
    from hotice.model.joint_friction import set_friction_reference

    out = copy.copy(model)

    def around(half: float, *size: int) -> np.ndarray:
        return 1.0 + half * rng.uniform(-1.0, 1.0, size)

    robot = np.flatnonzero(model.body_rootid == model.body(g1.ROOT_BODY).id)
    torso, carried = model.body(g1.TORSO_BODY).id, model.body(builder.OBJECT_BODY).id
    scale = np.ones(model.nbody)
    scale[robot] = around(config.mass, len(robot))
    _check_torso(config, float(model.body_mass[torso]))
    scale[torso] += config.torso_mass_kg * rng.uniform(-1.0, 1.0) / model.body_mass[torso]
    scale[carried] = around(config.payload)[()]
    out.body_mass[:] = model.body_mass * scale
    out.body_inertia[:] = model.body_inertia * scale[:, None]
    out.body_ipos[torso] += config.torso_com_m * rng.uniform(-1.0, 1.0, 3)
    strength = around(config.motor_strength, model.nu)
    kp, kd = (strength * around(config.gain, model.nu) for _ in range(2))
    out.actuator_gainprm[:, 0] *= kp
    out.actuator_biasprm[:, 1] *= kp
    out.actuator_biasprm[:, 2] *= kd
    out.actuator_forcerange[:] *= strength[:, None]
    offset = config.joint_offset_rad * rng.uniform(-1.0, 1.0, model.nu)
    out.actuator_biasprm[:, 0] -= out.actuator_gainprm[:, 0] * offset
    driven = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    out.dof_frictionloss[driven] += config.friction_loss_nm * rng.uniform(0.0, 1.0, model.nu)
    out.dof_armature[:] *= 1.0 + config.armature * rng.uniform(0.0, 1.0, model.nv)
    for name, geoms in friction_groups(model):
        span = getattr(config, name)
        if span is not None:
            out.geom_friction[geoms, 0] = rng.uniform(*span)
    mujoco.mj_setConst(out, mujoco.MjData(out))
    set_friction_reference(out)
    return out


def friction_groups(model: mujoco.MjModel) -> list[tuple[str, list[int]]]:
    """Geoms that share one draw of friction, each group with the field of `DynamicsConfig` it is drawn from.

    Each foot's soles, the palms of both hands, and the object (of which there may be none).
    """
    from hotice.model import builder

    names = [model.geom(i).name for i in range(model.ngeom)]
    soles = [[i for i, n in enumerate(names) if n.startswith(f"{side}_sole_")] for side in g1.SIDES]
    palms = [i for i, n in enumerate(names) if "_palm_" in n]
    carried = [i for i, n in enumerate(names) if n.split("_")[0] == builder.OBJECT_BODY]
    return [*(("sole_friction", geoms) for geoms in soles), ("palm_friction", palms), ("object_friction", carried)]


def joint_offset(model: mujoco.MjModel) -> np.ndarray:
    """Excess of each actuated joint's encoder over the truth, (nu,) [rad]; the servo believes it too."""
    return -model.actuator_biasprm[:, 0] / model.actuator_gainprm[:, 0]


def _check_torso(config: DynamicsConfig, nominal_kg: float) -> None:
    """Raises `InvalidConfig` where a draw could leave the torso without mass."""
    limit = (1.0 - config.mass) * nominal_kg
    if config.torso_mass_kg >= limit:
        raise InvalidConfig(
            f"torso_mass_kg is {config.torso_mass_kg!r}: less than {limit:.3g} is needed, what a torso of "
            f"{nominal_kg:.3g} kg keeps with mass {config.mass!r}"
        )
