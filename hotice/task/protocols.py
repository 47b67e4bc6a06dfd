"""Under which physics and which perturbations policies are scored: two protocols, named in every report.

`robot`: what is known to be closest to a robot. `paper`: what a reader of the paper would simulate, to compare with its
tables. Training has a third, faster physics of its own, see docs/contacts.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from hotice.errors import UnknownName
from hotice.model.dynamics import PAPER_DYNAMICS, ROBOT_DYNAMICS, ROBOT_NOMINAL, DynamicsConfig
from hotice.task.config import TaskConfig
from hotice.task.perturbations import without as switch_off


@dataclass(frozen=True, kw_only=True)
class Protocol:
    """One way to score.

    physics_dt_s: largest physics step [s]. elliptic: elliptic friction cones, solved to convergence, else pyramids with
    the solver settings of training. dynamics: robots of perturbed trials; nominal: the robot of unperturbed ones.
    """

    name: str
    physics_dt_s: float
    elliptic: bool
    dynamics: DynamicsConfig
    nominal: DynamicsConfig

    @property
    def physics(self) -> str:
        """The physics in words, as reports name it."""
        return f"{1e3 * self.physics_dt_s:g} ms, {'elliptic' if self.elliptic else 'pyramidal'}"

    def task(self, task: TaskConfig, *, perturbed: bool = True, without: Iterable[str] = ()) -> TaskConfig:
        """A task with this protocol's physics and perturbations, in the same control period.

        `without`: sources of perturbation that are switched off. Raises `UnknownName`.
        """
        substeps = math.ceil(task.control_dt_s / self.physics_dt_s - 1e-9)
        known = replace(
            task.perturbed() if perturbed else task,
            dynamics=self.dynamics if perturbed else self.nominal,
            physics_dt_s=task.control_dt_s / substeps,
            substeps=substeps,
        )
        return switch_off(known, without, self.nominal)


PROTOCOLS: Mapping[str, Protocol] = MappingProxyType(
    {
        "robot": Protocol(
            name="robot", physics_dt_s=0.002, elliptic=True, dynamics=ROBOT_DYNAMICS, nominal=ROBOT_NOMINAL
        ),
        "paper": Protocol(
            name="paper", physics_dt_s=0.005, elliptic=False, dynamics=PAPER_DYNAMICS, nominal=DynamicsConfig()
        ),
    }
)


def get_protocol(name: str | Protocol) -> Protocol:
    """The named protocol; one that is given is returned as it is. Raises `UnknownName`."""
    if isinstance(name, Protocol):
        return name
    if not isinstance(name, str) or name not in PROTOCOLS:
        raise UnknownName("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
