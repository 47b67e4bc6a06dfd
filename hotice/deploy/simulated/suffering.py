"""Mishaps at work: what befalls a simulated robot, its battery, gamepad, motors and sensors at a time."""

from __future__ import annotations

import math

import numpy as np

from hotice.deploy.command import DAMPING_KD, CheckedCommand
from hotice.deploy.link.protocol import RobotEnd
from hotice.deploy.simulated.mishaps import Mishaps
from hotice.deploy.simulated.remote import SimulatedRemote
from hotice.deploy.simulated.senses.localization import Localization
from hotice.deploy.simulated.senses.mover_sight import MoverSight
from hotice.deploy.simulated.senses.states import StateWriter
from hotice.deploy.simulated.senses.tag_sight import TagSight
from hotice.deploy.simulated.world import World

PUSH_M_S, JUMP_M, TURN_RAD = 1.0, 0.2, math.radians(30.0)
LOW_PERCENT, EXTRA_HEAT_C, ENCODER_BIT, ENCODER_RAD = 5.0, 120.0, 0x400, 1.0


class Suffering:
    """Lets mishaps happen to the parts of one robot."""

    def __init__(self, mishaps: Mishaps, seed: int, machine: int) -> None:
        self._mishaps = mishaps
        self._rng = np.random.default_rng([seed, 6])
        zero = np.zeros(29)
        damping = CheckedCommand(
            q=zero, dq=zero, tau=zero, kp=zero, kd=np.full(29, DAMPING_KD), enabled=np.ones(29, bool)
        )
        self._other = damping.message(machine)

    def of_body(self, time_s: float, world: World, end: RobotEnd) -> None:
        """A push; somebody else's command. Raises `LinkError`."""
        if self._mishaps.begins("push", time_s):
            angle = self._rng.uniform(-np.pi, np.pi)
            world.push(PUSH_M_S * np.array([np.cos(angle), np.sin(angle)]))
        if self._mishaps.now("second-publisher", time_s):
            end.disturb(self._other)

    def of_states(self, time_s: float, states: StateWriter, remote: SimulatedRemote) -> None:
        """Battery, heat, an error, an encoder, the gamepad."""
        now = self._mishaps.now
        if self._mishaps.begins("battery-low", time_s):
            states.set_charge(LOW_PERCENT)
        states.extra_heat = EXTRA_HEAT_C if now("motor-hot", time_s) else 0.0
        states.knee_error = ENCODER_BIT if now("motor-error", time_s) else 0
        states.knee_offset_rad = ENCODER_RAD if now("encoder-jump", time_s) else 0.0
        states.swapped = now("joints-swapped", time_s)
        remote.lost = now("remote-loss", time_s)

    def of_sources(
        self, time_s: float, localization: Localization | None, sight: TagSight | None, movers: MoverSight | None
    ) -> None:
        """Localization, tags, and who sees what moves."""
        now = self._mishaps.now
        if localization is not None:
            localization.lost, localization.frozen = now("pose-loss", time_s), now("pose-frozen", time_s)
            localization.nan = now("pose-nan", time_s)
            localization.offset_m = JUMP_M if now("pose-jump", time_s) else 0.0
            localization.turn_rad = TURN_RAD if now("pose-turn", time_s) else 0.0
        if sight is not None:
            sight.lost, sight.foreign = now("tag-loss", time_s), now("tag-foreign", time_s)
        if movers is not None:
            movers.lost, movers.nan = now("movers-loss", time_s), now("movers-nan", time_s)
