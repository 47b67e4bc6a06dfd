"""Rollouts to look at: a replay page and a picture, failures first, and a film, success first."""

from __future__ import annotations

import torch

from hotice.commands.configs import PlayConfig
from hotice.errors import InvalidConfig
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.record import failures_first, record_rollouts
from hotice.files import check_writable
from hotice.learn.policy import load_policy
from hotice.model.object_range import ObjectRange
from hotice.model.shipped import resolve_scenes
from hotice.progress import counted, counting
from hotice.replay import RolloutRecord, write_html, write_overview
from hotice.replay.video import check_film, film_frames, write_video
from hotice.sim.carry_bank import CarryBank
from hotice.task.moving import MovingConfig


def play(config: PlayConfig) -> list[RolloutRecord]:
    """Records rollouts, prints how they ended and writes what is asked for. Raises `HoticeError`."""
    # first of all: what is a folder has no ending to change
    check_writable(config.out)
    for path in filter(None, (config.out.with_suffix(".png"), config.video)):
        check_writable(path)
    if config.video is not None and (said := check_film()):
        print(said, flush=True)
    scenes = resolve_scenes(config.scenes)
    if config.video is not None and config.video_of > len(scenes) * config.rollouts:
        raise InvalidConfig(f"video_of is {config.video_of}: there are {len(scenes) * config.rollouts} rollouts")
    watched = counted(scenes, "scenes", len(scenes))
    if config.controller == "policy":
        policy = load_policy(config.policy)
        states = CarryBank.sample(ObjectRange(), config.rollouts, config.seed, 0.005, torch.device("cpu")).states
        asked = Conditions(
            protocol=config.protocol or "robot", perturbed=config.perturbed, moving=MovingConfig(known=config.moving)
        )
        records = [r for scene in watched for r in record_rollouts(policy, scene, states, asked, seed=config.seed)]
    else:
        from hotice.commands.play_station import record_stations

        records = record_stations(config, watched)
    if config.failures_first:
        records = failures_first(records)
    for number, record in enumerate(records, 1):
        ending = f"{record.outcome.replace('_', ' ')} after {record.time_s[-1]:.1f} s"
        print(f"{number:3d}  {record.scene.name}: {ending}, {record.distance_m:.2f} m from the goal")
    print(write_html(records, config.out))
    print(write_overview(records, config.out.with_suffix(".png")))
    if config.video is not None:
        shown = _filmed(records, config.video_of)
        with counting("frames of the film", len(film_frames(shown, config.video_s))) as told:
            write_video(shown, config.video, lambda n, _: told(n), most_s=config.video_s)
        print(config.video)
    return records


def _filmed(records: list[RolloutRecord], number: int) -> RolloutRecord:
    """The record of a number, from 1; 0: the first success, or the first."""
    if number:
        return records[number - 1]
    return next((record for record in records if record.outcome == "success"), records[0])
