"""Cyclone DDS where it is installed, and a clear word where it is not."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import NamedTuple

from hotice.errors import MissingExtra


class Cyclone(NamedTuple):
    """The modules of cyclonedds that the link uses."""

    core: ModuleType
    domain: ModuleType
    idl: ModuleType
    types: ModuleType
    pub: ModuleType
    sub: ModuleType
    topic: ModuleType
    qos: ModuleType


def cyclone() -> Cyclone:
    """Raises `MissingExtra` without the package."""
    try:
        return Cyclone(
            core=import_module("cyclonedds.core"),
            domain=import_module("cyclonedds.domain"),
            idl=import_module("cyclonedds.idl"),
            types=import_module("cyclonedds.idl.types"),
            pub=import_module("cyclonedds.pub"),
            sub=import_module("cyclonedds.sub"),
            topic=import_module("cyclonedds.topic"),
            qos=import_module("cyclonedds.qos"),
        )
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "cyclonedds":
            raise
        raise MissingExtra("the link to a robot", "cyclonedds", "deploy") from None
