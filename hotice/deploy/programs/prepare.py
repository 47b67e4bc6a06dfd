"""Preparation of a runner: policy, carry state and fields, all held against each other before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hotice.deploy.estimate import LidarPelvis, TaggedBox, TrackingEstimator
from hotice.deploy.estimate.movers import MoverTracker
from hotice.deploy.programs.options import RunnerOptions
from hotice.deploy.runner.around import Around
from hotice.deploy.runner.ways import Ways
from hotice.deploy.sources.protocol import Source
from hotice.deploy.sources.records import MoverSample, PoseSample, TagSample
from hotice.deploy.tags import BoxPoser, box_bundle
from hotice.errors import InvalidConfig
from hotice.fields.hod_pf import HodPf, build_hod_pf
from hotice.model.carry import CarryState, solve_carry
from hotice.model.objects import Box
from hotice.model.scene import Obstacle, Scene
from hotice.model.shipped import load_scene
from hotice.policy import PolicySession, PolicyTask, check_layout, open_policy
from hotice.policy.observation import layout_of


class Prepared(NamedTuple):
    """What a runner needs beside its sources; `pf`: fields of what never moves in the scene."""

    policy: PolicySession
    pf: HodPf
    carry: CarryState
    whole: Scene | None = None
    """The scene with what moves; None: nothing does."""

    @property
    def scene(self) -> Scene:
        """The scene as its file has it."""
        return self.whole or self.pf.scene

    @property
    def moving(self) -> tuple[Obstacle, ...]:
        """What moves: its shapes count, not its motions, which a robot does not know."""
        return self.scene.moving


def prepare(options: RunnerOptions, say: Callable[[str], None]) -> Prepared:
    """Reads and solves all; `say` is told what goes on. Raises `HoticeError`."""
    say(f"policy {options.policy}")
    policy = open_policy(options.policy)
    task = PolicyTask.from_meta(policy.meta, policy.name)
    check_layout(policy.name, policy.layout, layout_of(task))
    scene = load_scene(options.scene)
    say("carry state of the box")
    carry = solve_carry(Box(options.box[:3], options.box[3]))
    say(f"fields of {scene.name}")
    return Prepared(policy, build_hod_pf(scene.still(), task.resolution_m, task.margin_m), carry, scene)


def estimator_of(
    made: Prepared,
    poses: Source[PoseSample],
    tags: Source[TagSample],
    latency_s: float = 0.0,
    tags_latency_s: float = 0.0,
) -> TrackingEstimator:
    """The estimator of localization and tags; `latency_s`, `tags_latency_s`: theirs [s]. Raises `HoticeError`."""
    carried = made.carry.carried
    if not isinstance(carried, Box):
        raise InvalidConfig(f"tags are for boxes, not for a {type(carried).__name__}")
    return TrackingEstimator(
        carried,
        LidarPelvis(poses, made.pf.scene.source, latency_s=latency_s),
        TaggedBox(tags, BoxPoser(box_bundle(carried)), latency_s=tags_latency_s),
        latency_s=latency_s,
    )


def around_of(made: Prepared, samples: Source[MoverSample] | None, ways: Ways | None = None) -> Around | None:
    """What a runner knows of what moves, from its samples; None in a scene in which nothing does.

    `ways`: who builds those of the moment; None: ways are those of what never moves. Raises `InvalidConfig` where
    something moves and nobody says where it is.
    """
    if not made.moving:
        return None
    if samples is None:
        raise InvalidConfig(f"scene {made.scene.name!r}: something moves in it: samples of movers are needed")
    return Around(made.pf, MoverTracker(samples, made.moving, made.scene.source), ways)
