"""The robot as a Drake plant, with its wrists locked, and configurations in Drake's order."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.errors import MissingExtra
from hotice.model import builder, g1

Array = NDArray[np.float64]


class DrakeRobot:
    """The robot as a Drake plant, wrists locked at `wrist_pos` (6,) [rad]. Raises `MissingExtra` without Drake."""

    def __init__(self, wrist_pos: ArrayLike) -> None:
        try:
            from pydrake.multibody.plant import MultibodyPlant
        except ModuleNotFoundError:
            raise MissingExtra("planning a pick-up", "Drake", "drake") from None
        self.plant = plant = MultibodyPlant(0.0)
        builder.add_to_plant(plant, 20, wrist_pos)
        plant.Finalize()
        self.joints = np.array([plant.GetJointByName(j).position_start() for j in g1.ACTION_JOINTS])
        self.mass_kg = float(plant.CalcTotalMass(plant.CreateDefaultContext()))
        self.limits = np.stack(
            [plant.GetPositionLowerLimits()[self.joints], plant.GetPositionUpperLimits()[self.joints]]
        )

    @cached_property
    def hand_m(self) -> Array:
        """Origins of the hand frames in those of the wrist links, (2, 3)."""
        import mujoco

        model = mujoco.MjModel.from_xml_path(g1.xml_path())
        return np.array([model.site(f"{side}_hand").pos for side in g1.SIDES])

    def positions(self, q: Array) -> Array:
        """Configuration in Drake's order, from Pinocchio's (27,)."""
        out = np.empty(27)
        out[:4], out[4:7], out[self.joints] = np.roll(q[g1.ROOT_QUAT], 1), q[g1.ROOT_POS], q[g1.JOINT_POS]
        return out

    def configuration(self, positions: Array) -> Array:
        """Configuration in Pinocchio's order."""
        quat = np.roll(positions[:4], -1)
        return np.concatenate([positions[4:7], quat / np.linalg.norm(quat), positions[self.joints]])
