"""The record of one rollout: where every visible solid was at every frame, what guided it and how it ended."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.archives import read_arrays
from hotice.documents import parse_json
from hotice.errors import HoticeError, InputError
from hotice.files import write_bytes
from hotice.model.geometry.shapes import MeshShape
from hotice.model.objects import CarriedObject, object_from_dict
from hotice.model.scene import Scene
from hotice.replay.events import RolloutEvent
from hotice.replay.shown import GROUPS, InvalidRollout, ShownSolids
from hotice.replay.solids import SOLIDS
from hotice.replay.touch import Touched, find_touches
from hotice.task.rules import OUTCOMES

FORMAT = "hotice-rollout/1"
MAX_FILE_BYTES = 512 * 2**20
MAX_UNPACKED_BYTES = 4 * MAX_FILE_BYTES
_unpacked: list[tempfile.TemporaryDirectory] = []  # meshes of loaded records, kept until the program ends


@dataclass(frozen=True, kw_only=True)
class RolloutRecord:
    """One rollout of T frames with G solids (robot and carried object) and K guidance arrows, all in W, m and s.

    Raises `InvalidRollout` when shapes disagree, numbers are not finite, time does not grow or a name is unknown.
    """

    scene: Scene
    carried: CarriedObject
    time_s: NDArray[np.floating]
    """(T,) [s], strictly growing."""
    geom_names: list[str]
    geom_types: list[str]
    """box, capsule, cylinder, ellipsoid or sphere."""
    geom_sizes: NDArray[np.floating]
    """(G, 3) [m], MuJoCo's convention."""
    geom_rgba: NDArray[np.floating]
    """(G, 4), 0 to 1."""
    geom_pos_W: NDArray[np.floating]
    """(T, G, 3) [m]."""
    geom_quat_W: NDArray[np.floating]
    """(T, G, 4) wxyz."""
    geom_is_object: NDArray[np.bool_]
    """(G,) True for solids of the carried object."""
    root_pos_W: NDArray[np.floating]
    """(T, 3) pelvis [m]."""
    object_pos_W: NDArray[np.floating]
    """(T, 3) centre of the carried object [m]."""
    arrow_pos_W: NDArray[np.floating] = field(default_factory=lambda: np.zeros((0, 0, 3)))
    """(T, K, 3) keypoints [m]; leave the three arrow fields out for a record without arrows."""
    arrow_force_W: NDArray[np.floating] = field(default_factory=lambda: np.zeros((0, 0, 3)))
    """(T, K, 3) field vectors F = -grad U."""
    arrow_is_ogf: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """(K,) True where the vector is of the Object-Centric Guidance Field, False for the Standard one."""
    clearance_m: NDArray[np.floating] = field(default_factory=lambda: np.zeros(0))
    """(T,) [m] nearest that robot or object is to an obstacle, below 0 inside, cut at 1 m; (0,): not known."""
    outcome: str
    policy: str
    events: tuple[RolloutEvent, ...] = ()
    """In the order of time."""

    def __post_init__(self) -> None:
        frames, solids, arrows = len(self.time_s), len(self.geom_names), len(self.arrow_is_ogf)
        if arrows == 0:
            for name in ("arrow_pos_W", "arrow_force_W"):
                object.__setattr__(self, name, np.zeros((frames, 0, 3)))
        wanted = {
            "time_s": (frames,),
            "geom_sizes": (solids, 3),
            "geom_rgba": (solids, 4),
            "geom_pos_W": (frames, solids, 3),
            "geom_quat_W": (frames, solids, 4),
            "geom_is_object": (solids,),
            "root_pos_W": (frames, 3),
            "object_pos_W": (frames, 3),
            "arrow_pos_W": (frames, arrows, 3),
            "arrow_force_W": (frames, arrows, 3),
            "arrow_is_ogf": (arrows,),
            "clearance_m": (frames if np.size(self.clearance_m) else 0,),
        }
        for name, shape in wanted.items():
            kind = bool if name in ("geom_is_object", "arrow_is_ogf") else float
            value = np.asarray(getattr(self, name), dtype=kind)
            if value.shape != shape:
                raise InvalidRollout(f"{name} has shape {value.shape}: {shape} is needed")
            if not np.isfinite(value).all():
                raise InvalidRollout(f"{name} holds numbers that are not finite")
            object.__setattr__(self, name, value)
        if frames < 1 or solids < 1:
            raise InvalidRollout(f"a record of {frames} frames and {solids} solids: at least one of each is needed")
        if (np.diff(self.time_s) <= 0).any():
            raise InvalidRollout("time_s must grow from frame to frame")
        if any(b.time_s < a.time_s for a, b in pairwise(self.events)):
            raise InvalidRollout("events must be in the order of time")
        if len(self.geom_types) != solids:
            raise InvalidRollout(f"{len(self.geom_types)} geom_types for {solids} geom_names")
        for kind, known in ((self.outcome, OUTCOMES), *((t, SOLIDS) for t in self.geom_types)):
            if kind not in known:
                raise InvalidRollout(f"unknown {kind!r}: known are {', '.join(known)}")

    @property
    def distance_m(self) -> float:
        """Root to goal at the last frame, horizontally [m]."""
        return float(np.linalg.norm(self.root_pos_W[-1, :2] - self.scene.goal))

    @property
    def display_rgba(self) -> NDArray[np.floating]:
        """(G, 4) colours to draw: `geom_rgba` with the robot's left side lighter, to tell its legs apart."""
        left = np.array([name.startswith("left_") for name in self.geom_names]) & ~self.geom_is_object
        rgba = self.geom_rgba.copy()
        rgba[left, :3] += 0.45 * (np.array([0.62, 0.74, 0.86]) - rgba[left, :3])
        return rgba

    def every(self, period_s: float) -> RolloutRecord:
        """The same rollout with frames at least `period_s` apart (within 1 %); the last frame stays."""
        keep = [0]
        for i in range(1, len(self.time_s)):
            if self.time_s[i] - self.time_s[keep[-1]] >= 0.99 * period_s:
                keep.append(i)
        if keep[-1] != len(self.time_s) - 1:
            keep.append(len(self.time_s) - 1)
        return self._at(np.array(keep))

    def _at(self, frames: NDArray[np.int64]) -> RolloutRecord:
        per_frame = (
            "time_s",
            "geom_pos_W",
            "geom_quat_W",
            "root_pos_W",
            "object_pos_W",
            "arrow_pos_W",
            "arrow_force_W",
        )
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        if len(self.clearance_m):
            per_frame = (*per_frame, "clearance_m")
        return RolloutRecord(**values | {name: values[name][frames] for name in per_frame})

    @classmethod
    def from_states(
        cls,
        model: mujoco.MjModel,
        qpos: ArrayLike,
        *,
        scene: Scene,
        carried: CarriedObject,
        time_s: ArrayLike,
        outcome: str,
        policy: str,
        arrow_pos_W: ArrayLike | None = None,
        arrow_force_W: ArrayLike | None = None,
        arrow_is_ogf: ArrayLike | None = None,
        events: Iterable[RolloutEvent] = (),
        groups: Collection[int] = GROUPS,
        root_body: str = "pelvis",
        object_body: str = "object",
    ) -> RolloutRecord:
        """Places the solids of a model at every state.

        Solids fixed to the world (floor, obstacles), of a hidden group or fully transparent are left out.

        Args:
            model: robot and carried object.
            qpos: (T, nq) states.
            scene: drawn around them.
            carried: what is carried.
            time_s: (T,) [s].
            outcome: one of `hotice.task.rules.OUTCOMES`; running: the record stops before the rollout did.
            policy: name of what acted.
            arrow_pos_W: (T, K, 3) or None for a record without arrows.
            arrow_force_W: (T, K, 3).
            arrow_is_ogf: (K,).
            events: on the time line, beside first touches of obstacles, which are found where the model has any.
            groups: MuJoCo geom groups that are shown.
            root_body: body whose position is the root's.
            object_body: body of the carried object.

        Raises:
            InvalidRollout: as the constructor; also for a missing body or a moving solid that is not a primitive.
        """
        qpos = np.atleast_2d(np.asarray(qpos, dtype=float))
        if qpos.shape[1:] != (model.nq,):
            raise InvalidRollout(f"qpos has shape {qpos.shape}: (T, {model.nq}) is needed for this model")
        if not len(qpos):
            raise InvalidRollout("a record of 0 frames: at least one is needed")
        solids = ShownSolids(model, groups, root_body, object_body)
        placed = [solids.place(state) for state in qpos]
        pos, quat, root_pos, object_pos = (np.array(part) for part in zip(*placed, strict=True))
        time = np.asarray(time_s, dtype=float)
        touched = (
            find_touches(model, qpos, time, scene if model.nmocap else None)
            if len(time) == len(qpos)
            else Touched([], np.zeros(0))
        )
        arrows: dict[str, Any] = {}
        if arrow_pos_W is not None:
            if arrow_force_W is None or arrow_is_ogf is None:
                raise InvalidRollout("arrows need arrow_pos_W, arrow_force_W and arrow_is_ogf together")
            arrows = dict(arrow_pos_W=arrow_pos_W, arrow_force_W=arrow_force_W, arrow_is_ogf=arrow_is_ogf)
        return cls(
            scene=scene,
            carried=carried,
            time_s=time,
            geom_pos_W=pos,
            geom_quat_W=quat,
            root_pos_W=root_pos,
            object_pos_W=object_pos,
            outcome=outcome,
            policy=policy,
            events=tuple(sorted([*events, *touched.events], key=lambda event: event.time_s)),
            clearance_m=touched.clearance_m,
            **solids.described(),
            **arrows,
        )

    def save(self, path: str | Path) -> Path:
        """Writes an .npz file that needs no other file: meshes of obstacles are inside. Raises `OutputError`."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        text = {
            "format": FORMAT,
            "scene": self.scene.to_dict(),
            "carried": self.carried.to_dict(),
            "geom_names": self.geom_names,
            "geom_types": self.geom_types,
            "outcome": self.outcome,
            "policy": self.policy,
            "events": [asdict(event) for event in self.events],
        }
        arrays = {k: v.astype(np.float32) if v.dtype == float else v for k, v in arrays.items() if k not in text}
        arrays["time_s"] = self.time_s
        # readers of before there were events, or clearance, read what has none
        if not self.events:
            del text["events"]
        if not len(self.clearance_m):
            del arrays["clearance_m"]
        shapes = [o.shape for o in self.scene.obstacles]
        meshes = {shape.file: shape.path for shape in shapes if isinstance(shape, MeshShape)}
        text["meshes"] = list(meshes)
        for i, file in enumerate(meshes.values()):
            arrays[f"mesh_{i}"] = np.frombuffer(file.read_bytes(), dtype=np.uint8)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, json=np.frombuffer(json.dumps(text).encode(), dtype=np.uint8), **arrays)
        return write_bytes(path, buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> RolloutRecord:
        """Reads what `save` wrote; nothing in the file is executed. Raises `InvalidRollout` naming the file."""
        try:
            arrays = read_arrays(path, MAX_FILE_BYTES, MAX_UNPACKED_BYTES)
            text = parse_json("its description", arrays.pop("json").tobytes(), InvalidRollout)
            if text.pop("format") != FORMAT:
                raise InvalidRollout(f"is not of format {FORMAT}")
            folder = _unpack_meshes(text.pop("meshes"), arrays)
            text["scene"] = Scene.from_dict(text["scene"], folder=folder)
            text["carried"] = object_from_dict(text["carried"])
            text["events"] = tuple(RolloutEvent(**event) for event in text.get("events", ()))
            return cls(**text, **arrays)
        except InputError as error:
            raise InvalidRollout(str(error)) from None
        except OSError as error:
            raise InvalidRollout(f"{path}: cannot be read: {error.strerror or error}") from None
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InvalidRollout(f"{path}: is not a rollout record: {error}") from None
        except HoticeError as error:
            raise InvalidRollout(f"{path}: {error}") from None


def _unpack_meshes(names: Sequence[str], arrays: dict[str, np.ndarray]) -> Path | None:
    """Writes embedded mesh files below a new temporary folder, never outside it."""
    if not names:
        return None
    holder = tempfile.TemporaryDirectory(prefix="hotice-rollout-")
    _unpacked.append(holder)
    folder = Path(holder.name).resolve()
    for i, name in enumerate(names):
        target = (folder / name).resolve()
        if not target.is_relative_to(folder) or target == folder:
            raise InvalidRollout(f"mesh file {name!r} lies outside the record")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(arrays.pop(f"mesh_{i}").tobytes())
    return folder
