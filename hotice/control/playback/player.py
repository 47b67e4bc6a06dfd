"""Playback of one pick: joint angles, tilt and time in, joint targets out, 50 times a second."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidState
from hotice.model import builder, g1
from hotice.model.frames import quat_from_axis_angle, quat_mul
from hotice.model.picks.book import (
    BOOK_PHASES,
    DT_S,
    LEAN_HZ,
    LEAN_M_S,
    STIFFER,
    TRACK_PLACE,
    TRACK_RATE,
    PickBook,
    balance,
)

Array = NDArray[np.float64]


TRACK_TILT = 0.1
"""Share of its difference from the measured direction of gravity that the filtered one takes over at each step."""


@dataclass(frozen=True, kw_only=True)
class PlayerMemory:
    """Steps so far; offset (2,) [m] and rate (2,) [m/s] of the pelvis over the feet, from the plan.

    down_P: direction of gravity in P (3,). leaning: sum of the offset over time (2,), clipped [m s].
    """

    step: int = 0
    offset: Array
    rate: Array
    down_P: Array
    leaning: Array


class Player:
    """Plays row `row` of a book. Feels nothing: neither forces nor where the object is once the pick has begun.

    Raises `InvalidState` for a row that is not there.
    """

    rate_hz = 1.0 / DT_S

    def __init__(self, book: PickBook, row: int = 0) -> None:
        if not 0 <= row < len(book):
            raise InvalidState(f"row {row} of a book of picks: it has rows 0 to {len(book) - 1}")
        self.joint_pos, self.target = np.asarray(book.joint_pos[row], float), np.asarray(book.target[row], float)
        self._pelvis, self._phase = np.asarray(book.pelvis[row], float), book.phase
        self._model = builder.build_model(None, wrist_pos=book.wrist[row], floor=False)
        self._data = mujoco.MjData(self._model)
        self._feet = [self._model.body(f"{side}_ankle_roll_link").id for side in g1.SIDES]
        start = self.offset_of(np.asarray(book.start[row][g1.JOINT_POS]), _down(np.asarray(book.start[row][3:7])))
        self._zero = start - book.start[row][:2]
        """From the middle of the ankles to G."""

    def start(self) -> PlayerMemory:
        """Memory before the first step."""
        return PlayerMemory(
            offset=np.zeros(2), rate=np.zeros(2), down_P=np.array([0.0, 0.0, -1.0]), leaning=np.zeros(2)
        )

    def step(
        self, memory: PlayerMemory, joint_pos: Array, gravity_P: Array, gyro_P: Array
    ) -> tuple[Array, PlayerMemory]:
        """Targets (20,) [rad] for joint angles (20,), gravity's direction and rate of the pelvis, (3,) each [rad/s].

        Gravity is turned on by the gyro and pulled to what is measured now: a filter that does not lag.
        """
        k = min(memory.step, len(self._phase) - 1)
        predicted = memory.down_P + DT_S * np.cross(memory.down_P, gyro_P)
        down = predicted + max(1.0 / (memory.step + 1), TRACK_TILT) * (gravity_P - predicted)
        down /= np.linalg.norm(down)
        offset = self.offset_of(joint_pos, down) - self._zero - self._pelvis[k, :2]
        foreseen = memory.offset + DT_S * memory.rate
        found = foreseen + TRACK_PLACE * (offset - foreseen)
        rate = memory.rate + TRACK_RATE / DT_S * (offset - foreseen)
        leaning = np.clip(memory.leaning + DT_S * found, -LEAN_M_S, LEAN_M_S)
        target = self.target[k] + balance(found + LEAN_HZ * leaning, rate)
        target[g1.LOWER] += STIFFER * (self.joint_pos[k] - joint_pos)[g1.LOWER]
        return target, replace(memory, step=memory.step + 1, offset=found, rate=rate, down_P=down, leaning=leaning)

    def phase(self, memory: PlayerMemory) -> str:
        """Name of what the next step does."""
        return BOOK_PHASES[self._phase[memory.step]] if memory.step < len(self._phase) else BOOK_PHASES[-1]

    def offset_of(self, joint_pos: Array, gravity_P: Array) -> Array:
        """Horizontal way from the middle of the ankles to the pelvis, (2,) [m], along the heading of the feet."""
        q = self._data.qpos
        q[g1.ROOT_POS], q[g1.ROOT_QUAT], q[g1.JOINT_POS] = 0.0, _upright(gravity_P), joint_pos
        mujoco.mj_kinematics(self._model, self._data)
        feet, R = self._data.xpos[self._feet], self._data.xmat[self._feet]
        ahead = R[:, [0, 3]].sum(axis=0)
        ahead /= np.linalg.norm(ahead)
        way = -feet.mean(axis=0)[:2]
        return np.array([way @ ahead, way @ [-ahead[1], ahead[0]]])


def _down(quat: Array) -> Array:
    """Direction of gravity in a frame of orientation `quat` (4,) wxyz."""
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return -out.reshape(3, 3)[2]


def _upright(gravity_P: Array) -> Array:
    """Orientation (4,) wxyz without a heading of a pelvis that sees gravity in this direction (3,)."""
    x, y, z = gravity_P / np.linalg.norm(gravity_P)
    roll = quat_from_axis_angle([1.0, 0.0, 0.0], np.asarray(np.arctan2(-y, -z)))
    pitch = quat_from_axis_angle([0.0, 1.0, 0.0], np.asarray(np.arctan2(x, np.hypot(y, z))))
    return np.asarray(quat_mul(pitch, roll))
