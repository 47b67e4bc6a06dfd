"""The rows of the paper's Table I: agents, and the field that hands and object read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from hotice.errors import UnknownName
from hotice.model import g1

LOW, UP = "low", "up"


@dataclass(frozen=True, kw_only=True)
class Agent:
    """One learner: which part of the action it emits and which reward columns it receives."""

    name: str
    actions: slice
    receives: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of joints it commands."""
        return self.actions.stop - self.actions.start


DUAL = (
    Agent(name=LOW, actions=g1.LOWER, receives=(LOW,)),
    Agent(name=UP, actions=g1.UPPER, receives=(UP,)),
)
SINGLE = (Agent(name="whole", actions=slice(0, len(g1.ACTION_JOINTS)), receives=(LOW, UP)),)


@dataclass(frozen=True, kw_only=True)
class Preset:
    """One row of the paper's Table I: how many agents, and which field hands and object read."""

    agents: tuple[Agent, ...]
    object_field: str


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "dual_hodpf": Preset(agents=DUAL, object_field="ogf"),
        "dual_sgf": Preset(agents=DUAL, object_field="sgf"),
        "single_hodpf": Preset(agents=SINGLE, object_field="ogf"),
        "single_sgf": Preset(agents=SINGLE, object_field="sgf"),
    }
)


def get_preset(name: str) -> Preset:
    """The named row of Table I. Raises `UnknownName`."""
    if not isinstance(name, str) or name not in PRESETS:
        raise UnknownName("preset", name, PRESETS)
    return PRESETS[name]
