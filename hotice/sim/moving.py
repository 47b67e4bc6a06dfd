"""Obstacles that move, in a batch of environments: where they are, and where each robot believes them to be.

All of it is a function of scene and time, so nothing has to be remembered from step to step. A robot whose sensing is
exact knows movers as they are; others see them late and now and then, see `hotice.task.moving`.
"""

from __future__ import annotations

from functools import cached_property

from torch import Tensor

from hotice.fields.bank import FieldBank
from hotice.fields.moving.course import Courses, Movers
from hotice.fields.moving.moments import Moments
from hotice.fields.moving.world import MovingWorld
from hotice.task.moving import MovingConfig
from hotice.task.rules import MOVES_M_S


class MovingObstacles:
    """What moves in the scenes of a bank. Make it with `of`.

    `until_s`: length of an episode.
    """

    def __init__(self, bank: FieldBank, courses: Courses, config: MovingConfig, until_s: float) -> None:
        self.bank, self.courses, self.config, self.until_s = bank, courses, config, until_s

    @classmethod
    def of(cls, bank: FieldBank, config: MovingConfig, until_s: float) -> MovingObstacles | None:
        """None where nothing moves in any of the scenes."""
        courses = Courses.of(bank.scenes, bank.device)
        return None if courses is None else cls(bank, courses, config, until_s)

    @cached_property
    def moments(self) -> Moments:
        """Fields of the moments, built when first needed."""
        return Moments.of(self.bank, self.config.ways_hz, self.until_s)

    def movers(self, scene: Tensor, time_s: Tensor) -> Movers:
        """Movers of environments in scenes (N,) at times (N,) [s], as they are."""
        return self.courses.at(scene, time_s)

    def world(self, scene: Tensor, time_s: Tensor) -> MovingWorld:
        """All obstacles as they are, for distances."""
        return MovingWorld(still=self.bank, movers=self.movers(scene, time_s))

    def guiding(self, scene: Tensor, time_s: Tensor, *, exact: bool) -> FieldBank | MovingWorld:
        """Fields that guide robots in scenes (N,) at times (N,) [s]; `exact`: as if they saw without delay."""
        cfg = self.config
        if cfg.known == "still":
            return self.bank
        if exact:
            movers, seen_s = self.movers(scene, time_s), time_s
        else:
            movers = self.courses.seen(scene, time_s, cfg.sensor_hz, cfg.sensor_delay_s)
            seen_s = time_s - cfg.sensor_delay_s
        newest = None if cfg.known == "near" else (self.moments.bank, self.moments.index(scene, seen_s))
        return MovingWorld(still=self.bank, movers=movers, newest=newest)

    def met(self, scene: Tensor, time_s: Tensor, touched: Tensor) -> Tensor:
        """Whether one of the movers that touch robot or object, `touched` (N, M) bool, moves just then, (N,)."""
        movers = self.movers(scene, time_s)
        moves = (movers.v_W.norm(dim=-1) > MOVES_M_S) | (movers.rate.abs() > MOVES_M_S)
        return (touched & moves & movers.there).any(dim=1)

    def poses(self, scene: Tensor, time_s: Tensor) -> tuple[Tensor, Tensor]:
        """Positions (N, M, 3) [m] and quaternions (N, M, 4) wxyz in W, for exact geometry."""
        return self.courses.poses(scene, time_s)
