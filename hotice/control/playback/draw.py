"""Random picks, as a person would put robot and object before each other."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hotice import checks
from hotice.control.pick_plan import Support
from hotice.errors import CarryInfeasible, PickInfeasible
from hotice.model.object_range import ObjectRange
from hotice.model.picks.book import PickBook

if TYPE_CHECKING:
    from hotice.control.playback.course import Pick


@dataclass(frozen=True, kw_only=True)
class PickRange:
    """Uniform ranges of objects and places; all ours."""

    objects: ObjectRange = field(default_factory=ObjectRange)
    """What is picked (20 to 40 cm, 0.5 to 3.5 kg)."""
    top_m: tuple[float, float] = (0.45, 0.80)
    """Height of the support."""
    near_m: tuple[float, float] = (0.20, 0.28)
    """From the middle of the feet to the support's edge."""
    inset_m: tuple[float, float] = (0.01, 0.03)
    """From the support's edge to the object."""
    aside_m: float = 0.05
    """Object to the left or right of the robot's middle, at most."""
    turn_rad: float = 0.2618
    """Turn of the object before the robot, at most (15 degrees)."""

    def __post_init__(self) -> None:
        for name in ("top_m", "near_m", "inset_m"):
            object.__setattr__(self, name, checks.interval(name, getattr(self, name), checks.POSITIVE))
        checks.numbers(self, checks.NOT_NEGATIVE, "aside_m", "turn_rad")

    def sample(self, rng: np.random.Generator) -> Pick:
        """One pick, which the planner may yet refuse. Raises `PickInfeasible` for a support that nobody reaches."""
        # The planner's packages, which options of commands do without.
        from hotice.control.playback.course import Pick

        carried = self.objects.sample(rng)
        top, near, inset = (float(rng.uniform(*span)) for span in (self.top_m, self.near_m, self.inset_m))
        aside, turn = (float(rng.uniform(-half, half)) for half in (self.aside_m, self.turn_rad))
        half = carried.half_extents_m
        turn = turn if carried.shape == "box" else 0.0
        depth = half[0] * np.cos(turn) + half[1] * abs(np.sin(turn))
        support = Support(top_m=top, near_m=near)
        return Pick(carried=carried, support=support, x_m=near + inset + float(depth), y_m=aside, yaw_rad=turn)


def draw_books(draws: PickRange, count: int, seed: int = 0, tries: int = 0) -> tuple[list[PickBook], Counter[str]]:
    """Books of `count` random picks, one each, and how often the planner refused, by reason.

    `tries`: give up after so many draws; 0: after 20 for each pick. Raises `PickInfeasible` then.
    """
    from hotice.control.playback.course import plan_book

    rng, books, refused = np.random.default_rng(seed), [], Counter()
    for _ in range(tries or 20 * count):
        if len(books) == count:
            break
        try:
            books.append(plan_book(draws.sample(rng)))
        except (CarryInfeasible, PickInfeasible) as error:
            refused[_kind(str(error))] += 1
    if len(books) < count:
        raise PickInfeasible(
            f"only {len(books)} of {count} picks could be planned, refused were {dict(refused)}: give nearer or lower "
            "supports"
        )
    return books, refused


def _kind(reason: str) -> str:
    """A reason without its numbers, so that like ones are counted together."""
    return re.sub(r"[-+]?[0-9][0-9.]*", "#", reason.split(":")[0].split(";")[0])
