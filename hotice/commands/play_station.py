"""Stations to look at: `hotice play` with another controller than `policy`. Drake is imported only for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hotice.commands.configs import PlayConfig
from hotice.errors import CarryInfeasible, InvalidConfig, PickInfeasible
from hotice.files import is_folder
from hotice.model.object_range import ObjectRange
from hotice.replay import RolloutRecord
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

if TYPE_CHECKING:
    from hotice.model.scene import Scene
    from hotice.systems import StationConfig
    from hotice.systems.record.play import Run

LOG_HZ = 25.0
TABLE_M = (0.5, 0.7)
DRAWS = 20


def record_stations(config: PlayConfig, scenes: Iterable[Scene]) -> list[RolloutRecord]:
    """Records of `config.rollouts` stations per scene, each with another box and table; prints who carried on.

    Raises `HoticeError`: `MissingExtra` without Drake, scenes without room for a table.
    """
    from hotice.systems import StationConfig  # before anything runs, so that a missing Drake is told at once

    if is_folder(config.policy):
        raise InvalidConfig(
            f"policy is {config.policy!r}: a station takes an exported one, make it with `hotice export`"
        )
    sensing = STUDENT_SENSING if config.perturbed else SensingConfig()
    base = StationConfig(policy=config.policy, sensing=sensing, seed=config.seed % 2**31, log_hz=LOG_HZ)
    runs = []
    for scene in scenes:
        for number in range(config.rollouts):
            run = _run(config, base, scene, np.random.default_rng([config.seed, number]))
            runs.append(run)
            if run.hand_over is not None:
                print(f"{scene.name}: {run.hand_over}", flush=True)
            elif run.job is not None:
                print(f"{scene.name}: {run.job}", flush=True)
    told = [run.hand_over for run in runs if run.hand_over is not None]
    if told:
        handed, held = (sum(report.time_s is not None and report.held == h for report in told) for h in (False, True))
        walked = sum(report.fell_back for report in told)
        print(f"hand-overs: {handed} of {len(told)}; fallbacks to walk: {walked}; kept holding: {held}")
    return [run.record for run in runs]


def _run(config: PlayConfig, base: StationConfig, scene: Scene, rng: np.random.Generator) -> Run:
    """A run with the first box drawn that can be carried and picked up."""
    from hotice.systems.record.play import play_station
    from hotice.systems.setup.table import beside_start
    from hotice.systems.station.make import make_station

    why = ""
    for _ in range(DRAWS):
        carried, top = ObjectRange().sample(rng), float(rng.uniform(*TABLE_M))
        station_config = replace(base, scene=scene, carried=carried, support_height_m=top)
        if config.controller != "walk":
            station_config = beside_start(scene, station_config)
        if config.controller == "job":
            from hotice.systems.setup.put import before_goal
            from hotice.systems.setup.rehearsal_config import RehearsalConfig

            top = float(rng.uniform(*TABLE_M))
            station_config = replace(station_config, put_height_m=top, rehearsal=RehearsalConfig(horizon_s=0.0))
            station_config = before_goal(scene, station_config)
        try:
            station = make_station(station_config, controller=config.controller)
        except (CarryInfeasible, PickInfeasible) as error:
            why = str(error)
            continue
        return play_station(station, config.seconds)
    raise InvalidConfig(f"seed is {config.seed!r}: none of {DRAWS} boxes can be picked up ({why}); try another seed")
