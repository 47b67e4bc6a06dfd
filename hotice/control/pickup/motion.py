"""Motion of a pick-up in one step, beside the configuration of its reference."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hotice.control.pickup.footwork import Feet

Array = NDArray[np.float64]


@dataclass
class Motion:
    """What the reference of one step does beside being at a configuration, in G.

    Attributes:
        rate: (26,) velocity of the reference. com_acc: (3,) of the centre of mass.
        feet: where the ankles go while a foot is in the air.
    """

    rate: Array = field(default_factory=lambda: np.zeros(26))
    com_acc: Array = field(default_factory=lambda: np.zeros(3))
    feet: Feet | None = None
