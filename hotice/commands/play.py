"""Rollouts to look at: a replay page, a picture and a film, failures first."""

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
from hotice.progress import counted, doing
from hotice.replay import RolloutRecord, write_html, write_overview
from hotice.replay.video import write_video
from hotice.sim.carry_bank import CarryBank
from hotice.task.moving import MovingConfig


def play(config: PlayConfig) -> list[RolloutRecord]:
    """Records rollouts, prints how they ended and writes what is asked for. Raises `HoticeError`."""
    # first of all: what is a folder has no ending to change
    check_writable(config.out)
    for path in filter(None, (config.out.with_suffix(".png"), config.video)):
        check_writable(path)
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
        with doing("film") as told:
            shown = records[config.video_of - 1]
            print(write_video(shown, config.video, lambda n, total: told(f"film: frame {n} of {total}")))
    return records
