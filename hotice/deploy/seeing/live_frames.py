"""Frames of the live page: a moment as JSON, and the newest for whoever reads, at their own pace."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from hotice.deploy.guard.faults import Cause
from hotice.deploy.guard.limits import GuardLimits
from hotice.deploy.guard.modes import Mode
from hotice.deploy.seeing.moments import CALM, arrows_of, complete, is_ogf, named, percept_of, state_of, verdicts_of
from hotice.fields.hod_pf import HodPf, build_hod_pf
from hotice.fields.moving.momentary import MomentaryPf, momentary_pf, moved
from hotice.model.frames import quat_from_yaw
from hotice.model.geometry.shapes import MeshShape
from hotice.model.objects import CarriedObject, object_from_dict
from hotice.model.scene import GOAL_HEIGHT_M, Scene
from hotice.policy import PolicySession, PolicyTask, read_fields
from hotice.policy.guidance import FieldReading
from hotice.policy.percept import PerceptModel
from hotice.replay.rollout import RolloutRecord
from hotice.replay.shown import ShownSolids

Fact = tuple[str, str, bool]
"""Name, text, and whether it is marked."""
SHOWN_EVENTS = 20
LATE_S = 0.010
"""A tick of the runner that began later than this is marked [s] (ours)."""


def about_run(scene: Scene, carried: CarriedObject, policy: PolicySession) -> dict[str, Any]:
    """What a page shows beside moments, as JSON values."""
    folders = [str(o.shape.folder) for o in scene.obstacles if isinstance(o.shape, MeshShape)]
    return {
        "scene": scene.to_dict(),
        "meshes": folders[0] if folders else None,
        "carried": carried.to_dict(),
        "policy": policy.name,
        "task": policy.meta,
    }


class Painter:
    """Moments of one run as frames of a page.

    Args:
        about: what is shown, see `about_run`
        limits: beyond which a number is marked
    """

    def __init__(self, about: Mapping[str, Any], limits: GuardLimits | None = None) -> None:
        self.scene, self.policy = Scene.from_dict(about["scene"], folder=about["meshes"]), str(about["policy"])
        self.carried: CarriedObject = object_from_dict(about["carried"])
        self._task = PolicyTask.from_meta(about["task"], self.policy)
        self._ogf = is_ogf(self._task.object_field)
        self._pf = build_hod_pf(self.scene.still(), self._task.resolution_m, self._task.margin_m)
        self._solids = ShownSolids(PerceptModel(self.carried).model)
        self._limits = limits or GuardLimits()
        self._events: list[dict[str, Any]] = []
        self._before: tuple[int, int] | None = None
        self._began_s = math.nan

    def first(self) -> RolloutRecord:
        """The scene and all solids before anything is known: a record of one frame, without joint angles."""
        x, y, yaw = self.scene.start
        qpos = self._solids.model.qpos0.copy()
        qpos[:7] = x, y, GOAL_HEIGHT_M, *quat_from_yaw(yaw)
        return RolloutRecord.from_states(
            self._solids.model,
            qpos,
            # frames say where what moves is, not its motions
            scene=self.scene.at(0.0),
            carried=self.carried,
            time_s=[0.0],
            outcome="running",
            policy=self.policy,
            arrow_pos_W=np.zeros((1, len(self._ogf), 3)),
            arrow_force_W=np.zeros((1, len(self._ogf), 3)),
            arrow_is_ogf=self._ogf,
        )

    def frame(self, shown: np.ndarray) -> dict[str, Any]:
        """A frame of a moment (), numbers in m and rounded to 0.1 mm.

        `time` counts from the first frame [s]; `facts` are rows of name, text and whether it is marked; `events` are
        the last changes of the mode. Where the robot is not known there are no poses, paths or arrows.
        """
        time_s = float(shown["time_s"])
        self._began_s = time_s if math.isnan(self._began_s) else self._began_s
        since_s = round(time_s - self._began_s, 4)
        mode, cause = named(Mode, int(shown["mode"])), named(Cause, int(shown["cause"]))
        if self._before != (state := (int(shown["mode"]), int(shown["cause"]))):
            self._before = state
            event = {"time": since_s, "kind": "mode" if cause in CALM else "fault", "text": f"{mode}: {cause}"}
            self._events = [*self._events, event][-SHOWN_EVENTS:]
        facts = [("Because of", cause, False), *self._timely(shown)]
        frame = {"time": since_s, "mode": mode, "facts": facts, "events": self._events} | self._moved(shown)
        facts += self._seen(shown)
        if not complete(shown.reshape(1))[0]:
            facts.append(("Robot and box", "not known yet", True))
            return frame
        percept = percept_of(shown)
        reading = read_fields(self._fields(shown), percept, self._task)
        facts += [*self._believed(shown), *_guided(reading, walks=int(shown["mode"]) == Mode.CARRY)]
        placed, (points, forces) = self._solids.place(state_of(shown)), arrows_of(percept, reading)
        return frame | {
            "geom_pos": _rounded(placed.pos_W),
            "geom_quat": _rounded(placed.quat_W),
            "root_pos": _rounded(placed.root_pos_W),
            "object_pos": _rounded(placed.object_pos_W),
            "arrow_pos": _rounded(points),
            "arrow_force": _rounded(forces),
        }

    def _moved(self, shown: np.ndarray) -> dict[str, Any]:
        """Place of each obstacle that moves in the scene's list, and where it is, or that this is not known."""
        at = [i for i, obstacle in enumerate(self.scene.obstacles) if obstacle.motion is not None]
        poses = shown["movers_pose"][: int(shown["movers"])]
        known = [_rounded(pose) for pose in poses] if len(poses) == len(at) else None
        return {"movers": {"at": at, "poses": known}} if at else {}

    def _fields(self, shown: np.ndarray) -> HodPf | MomentaryPf:
        moving, poses = self.scene.moving, shown["movers_pose"][: int(shown["movers"])]
        return momentary_pf(self._pf, moved(moving, poses)) if moving and len(poses) == len(moving) else self._pf

    def _seen(self, shown: np.ndarray) -> Iterator[Fact]:
        if self.scene.moving:
            age_s = float(shown["movers_age_s"]) if shown["movers"] else math.inf
            yield "Movers", _age(age_s), not age_s <= self._limits.pose_s

    def _timely(self, shown: np.ndarray) -> Iterator[Fact]:
        state_s, late_s = float(shown["state_age_s"]), float(shown["late_s"])
        yield "State", _age(state_s), not state_s <= self._limits.state_warn_s
        yield "Runner late", f"{1e3 * late_s:.1f} ms", late_s > LATE_S

    def _believed(self, shown: np.ndarray) -> Iterator[Fact]:
        pose_s, box_s, disputed = float(shown["pose_age_s"]), float(shown["box_age_s"]), bool(shown["disputed"])
        pose, box = verdicts_of(shown)
        bad = disputed or not pose_s <= self._limits.pose_s
        yield "Localization", f"{_age(pose_s)}, {'disputed' if disputed else pose}", bad
        yield "Box", f"{_age(box_s)}, {box}", not box_s <= self._limits.box_s


def _guided(reading: FieldReading, walks: bool) -> Iterator[Fact]:
    yield "To the goal", f"{float(reading.goal_distance[0]):.2f} m", False
    command = "{:.2f}, {:.2f}, {:.2f} m/s".format(*reading.c_W.tolist())
    yield "Command", command if walks else "none", False
    yield "Nearest", f"{float(reading.distance.min()):.2f} m", False


def _age(age_s: float) -> str:
    return f"{1e3 * age_s:.0f} ms" if age_s < 1.0 else f"{age_s:.1f} s" if math.isfinite(age_s) else "never"


def _rounded(values: np.ndarray) -> list[float]:
    return np.round(values, 4).ravel().tolist()
