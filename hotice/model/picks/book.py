"""Picks as position targets over time: what a planner makes ahead, and teachers, a playback and students follow.

A pick is a course of joint angles and of the servo targets that would hold each of them at rest, in steps of `DT_S`. A
stiff robot that is told only these falls: its ankles are softer than gravity. `balance` adds what keeps it up, from how
far the pelvis is from where it should be over the feet. No force is read anywhere.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.archives import read_arrays
from hotice.errors import InputError, InvalidObject, InvalidState
from hotice.files import write_bytes
from hotice.model import g1
from hotice.model.frames import quat_from_yaw
from hotice.model.objects import Box, CarriedObject, Cylinder, Sphere

Array = NDArray[Any]
DT_S = 0.02
BOOK_PHASES = ("settle", "crouch", "reach", "close", "squeeze", "lift", "retreat", "hold")
"""Parts of a pick in their order; `hold` goes on after the last step."""
STIFF_N_M, DAMP_NS_M = 770.0, 150.0
"""Force on the body for each metre and metre per second that the pelvis is off: 2.2 times what gravity tips it with."""
HEIGHT_M = 0.7
OFF_M, OFF_M_S = 0.08, 0.8
"""Farther off counts as this."""
FELT_M = 0.2
"""Farther off counts as this where the offset is from the carry state's place and no plan is known."""
STIFFER = 0.5
"""Legs are held by so much stiffer servos, as a share of themselves: against gains that are not as described."""
LEAN_HZ, LEAN_M_S = 0.5, 0.03
"""Slow balance, against a centre of mass that is elsewhere than described: share of the offset's sum over time, and the
sum's limit."""
TRACK_PLACE, TRACK_RATE = 0.3, 0.05
"""Gains of the alpha-beta filter of the pelvis' offset as a robot knows it: encoders and IMU are noisy, and a rate of
raw differences would be noise alone."""
MAX_BYTES = 2**30
MOST = 1e3
"""Of any number in a book."""
SHAPES = ("box", "cylinder", "sphere")


def balance_gains() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Change of the 20 joint targets for an offset and a rate of the pelvis, x and y: (2, 20) [rad/m], [rad s/m].

    Ankles push along x, hips aside, both sides alike.
    """
    kp, _ = g1.gains()
    stiff, damp = np.zeros((2, g1.ACTIONS)), np.zeros((2, g1.ACTIONS))
    for axis, joint in ((0, "ankle_pitch"), (1, "hip_roll")):
        for side in g1.SIDES:
            i = g1.ACTION_JOINTS.index(f"{side}_{joint}_joint")
            stiff[axis, i], damp[axis, i] = (0.5 * HEIGHT_M * k / kp[i] for k in (STIFF_N_M, DAMP_NS_M))
    return stiff, damp


def balance(offset: Array, rate: Array) -> NDArray[np.float64]:
    """Change of the joint targets (..., 20) [rad] for the pelvis' offset (..., 2) [m] and its rate (..., 2) [m/s].

    Both from where it should be, seen from the middle of the feet, along their heading and to the left.
    """
    stiff, damp = balance_gains()
    return np.clip(offset, -OFF_M, OFF_M) @ stiff + np.clip(rate, -OFF_M_S, OFF_M_S) @ damp


def hold_up(offset: Array, rate: Array) -> NDArray[np.float64]:
    """Part of the law that turns a student's actions into targets (..., 20) [rad], whatever the action.

    As `balance`, but from where the carry state has the pelvis over the feet: a student has no plan, and says with its
    action where else it should be.
    """
    stiff, damp = balance_gains()
    return np.clip(offset, -FELT_M, FELT_M) @ stiff + np.clip(rate, -OFF_M_S, OFF_M_S) @ damp


@dataclass(frozen=True, kw_only=True)
class PickBook:
    """M picks of K steps each, and what is picked where, seen from G, the middle of the feet (x ahead).

    Attributes:
        joint_pos, target: (M, K, 20) angles and the servo targets that hold them [rad].
        pelvis: (M, K, 3) place in G [m].
        phase: (K,) index into `BOOK_PHASES`.
        shape: (M,) index into `SHAPES`; extents: (M, 3) full [m]; mass: (M,) [kg].
        object: (M, 4) x, y, z of its centre [m] and its turn [rad]. support: (M, 2) height of its top, distance of its
            near edge [m].
        start: (M, 27) configuration at the start, MuJoCo's (quaternion wxyz). end: (M, 3) the object's centre in the
            carry state, from the pelvis [m]; lean: (M,) of the pelvis there [rad].
        wrist: (M, 6) locked wrists [rad]. squeeze: (M,) force of each hand at the end [N].

    Raises `InvalidState` for shapes that do not belong together or numbers that cannot be.
    """

    joint_pos: Array
    target: Array
    pelvis: Array
    phase: Array
    shape: Array
    extents: Array
    mass: Array
    object: Array
    support: Array
    start: Array
    end: Array
    lean: Array
    wrist: Array
    squeeze: Array

    def __post_init__(self) -> None:
        m, k = np.shape(self.joint_pos)[:2] if np.ndim(self.joint_pos) == 3 else (0, 0)
        n = g1.ACTIONS
        shapes = {"joint_pos": (m, k, n), "target": (m, k, n), "pelvis": (m, k, 3), "phase": (k,), "shape": (m,)}
        shapes |= {"extents": (m, 3), "mass": (m,), "object": (m, 4), "support": (m, 2), "start": (m, 7 + n)}
        shapes |= {"end": (m, 3), "lean": (m,), "wrist": (m, 6), "squeeze": (m,)}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name))
            if value.shape != shape or not m or not k:
                raise InvalidState(f"{name} of a book of picks has shape {value.shape}: {shape} is needed, not empty")
            if value.dtype.kind not in "iuf" or not np.isfinite(value).all() or np.abs(value).max() > MOST:
                raise InvalidState(
                    f"{name} of a book of picks is {value.dtype}, not finite or large: numbers up to {MOST:g} needed"
                )
        for name, known in (("shape", SHAPES), ("phase", BOOK_PHASES)):
            value = np.asarray(getattr(self, name))
            if value.dtype.kind == "f" or value.min() < 0 or value.max() >= len(known):
                raise InvalidState(
                    f"{name} of a book of picks is {value.dtype}, up to {value.max():g}: whole numbers from 0 to "
                    f"{len(known) - 1} are needed"
                )
        if (np.diff(np.asarray(self.phase, dtype=np.int64)) < 0).any():
            raise InvalidState("phase of a book of picks goes back: phases in their order are needed")
        if (np.asarray(self.support) <= 0.0).any():
            raise InvalidState("support of a book of picks has a height or distance that is not above 0 m")
        if not np.allclose(np.linalg.norm(np.asarray(self.start)[:, g1.ROOT_QUAT], axis=1), 1.0, atol=1e-3):
            raise InvalidState("start of a book of picks has a quaternion whose length is not 1")

    def __len__(self) -> int:
        return len(self.mass)

    @property
    def steps(self) -> int:
        """Control steps of a pick, K."""
        return len(self.phase)

    def carried(self, row: int) -> CarriedObject:
        """What is picked. Raises `InvalidObject`."""
        x, y, z = (float(v) for v in self.extents[row])
        mass, shape = float(self.mass[row]), SHAPES[int(self.shape[row])]
        if shape == "box":
            return Box((x, y, z), mass)
        return Cylinder(x / 2, z, mass) if shape == "cylinder" else Sphere(x / 2, mass)

    def qpos(self, row: int) -> NDArray[np.float64]:
        """Configuration of robot and object at the start, (34,)."""
        place = np.asarray(self.object[row], dtype=np.float64)
        return np.concatenate([self.start[row], place[:3], quat_from_yaw(place[3])])

    def rows(self, ids: Sequence[int]) -> PickBook:
        """The picks of these rows."""
        chosen = {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}
        return PickBook(**{n: v if n == "phase" else v[list(ids)] for n, v in chosen.items()})

    @classmethod
    def join(cls, books: Sequence[PickBook]) -> PickBook:
        """The picks of several books one after another. Raises `InvalidState` where their steps differ."""
        if not books or any(not np.array_equal(b.phase, books[0].phase) for b in books):
            raise InvalidState("books of picks with other steps cannot be joined: plan them with one set of durations")
        names = [f.name for f in fields(cls)]
        parts = {n: [np.asarray(getattr(b, n)) for b in books] for n in names}
        return cls(**{n: v[0] if n == "phase" else np.concatenate(v) for n, v in parts.items()})

    def save(self, path: Path | str) -> None:
        """Writes a NumPy archive, aside and renamed. Raises `OutputError`."""
        content = io.BytesIO()
        values: dict[str, Any] = {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}
        np.savez_compressed(content, **values)
        write_bytes(Path(path), content.getvalue())

    @classmethod
    def load(cls, path: Path | str) -> PickBook:
        """Reads what `save` wrote. Raises `InvalidState`, saying what is wrong with the file."""
        try:
            arrays = read_arrays(path, MAX_BYTES, MAX_BYTES)
        except InputError as error:
            raise InvalidState(str(error)) from None
        missing = [f.name for f in fields(cls) if f.name not in arrays]
        if missing:
            raise InvalidState(f"{path} is no book of picks: {', '.join(missing)} not in it")
        try:
            book = cls(**{f.name: arrays[f.name] for f in fields(cls)})
            for row in range(len(book)):
                book.carried(row)
        except (InvalidObject, InvalidState) as error:
            raise InvalidState(f"{path} is no book of picks: {error}") from None
        return book
