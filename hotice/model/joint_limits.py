"""Limits of position and torque by joint name, from the robot's description; NumPy and the standard library only."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from xml.etree import ElementTree

import numpy as np

from hotice.errors import UnknownName
from hotice.model import g1


def position_limits(joints: Sequence[str] = g1.ALL_JOINTS) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest position of the named joints, each (J,) [rad]. Raises `UnknownName`."""
    lower, upper = np.array([_of(_positions(), joint) for joint in joints]).reshape(-1, 2).T
    return lower, upper


def torque_limits(joints: Sequence[str] = g1.ALL_JOINTS) -> np.ndarray:
    """Largest torque of the named joints either way, (J,) [N m]. Raises `UnknownName`."""
    return np.array([min(-low, high) for low, high in (_of(_torques(), joint) for joint in joints)])


def _of(ranges: dict[str, tuple[float, float]], joint: str) -> tuple[float, float]:
    if joint not in ranges:
        raise UnknownName("joint", joint, ranges)
    return ranges[joint]


@cache
def _positions() -> dict[str, tuple[float, float]]:
    joints = ElementTree.parse(g1.xml_path()).getroot().iter("joint")
    return {j.attrib["name"]: _pair(j.attrib["range"]) for j in joints if "name" in j.attrib}


@cache
def _torques() -> dict[str, tuple[float, float]]:
    motors = ElementTree.parse(g1.xml_path()).getroot().iter("motor")
    return {m.attrib["joint"]: _pair(m.attrib["ctrlrange"]) for m in motors if "joint" in m.attrib}


def _pair(text: str) -> tuple[float, float]:
    low, high = map(float, text.split())
    return low, high
