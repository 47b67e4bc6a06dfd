"""Faults injected into a station's signals: values that cannot be, and what freezes, comes late or is lost."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false, reportReturnType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidStation
from hotice.policy.percept import Percept
from hotice.systems.signals import GUIDANCE, NUM_JOINTS, PERCEPT, ROBOT_STATE, STAMPS

Array = NDArray[np.float64]
SIGNALS = {
    "robot_state": ROBOT_STATE,
    "tick": 1,
    "percept": PERCEPT,
    "stamps": STAMPS,
    "guidance": GUIDANCE,
    "command": NUM_JOINTS,
}
"""Signals that may fail, and their sizes."""
BOX = tuple(i for name in ("p_WO", "R_WO", "p_WOK") for i in range(PERCEPT)[Percept.PARTS[name]])
"""What a percept says of the object."""
KINDS = ("value", "add", "scale", "frozen", "late")
LONGEST_S = 1.0


@dataclass(frozen=True, kw_only=True)
class InjectedFault:
    """One fault of one signal for a while; of several, one comes after the other. Raises `InvalidStation`."""

    signal: str
    """See `SIGNALS`."""
    index: tuple[int, ...] | None = None
    """Which of its numbers; None: all."""
    kind: str = "value"
    """value, add and scale: numbers are `value`, or more or times by it. frozen: as when the fault began. late: as they
    were `value` seconds ago, at most 1."""
    value: float = float("nan")
    from_s: float = 0.5
    """When it begins [s]; until_s: and ends."""
    until_s: float = float("inf")

    def __post_init__(self) -> None:
        checks.one_of("signal", self.signal, SIGNALS, InvalidStation)
        checks.one_of("kind", self.kind, KINDS, InvalidStation)
        checks.number("from_s", self.from_s, checks.NOT_NEGATIVE, InvalidStation)
        if not self.until_s > self.from_s:
            raise InvalidStation(f"until_s is {self.until_s!r}: a time after from_s, {self.from_s:g} s, is needed")
        if self.kind == "late":
            checks.number(
                "value of a late signal", self.value, Range(above=0, most=LONGEST_S, unit="s"), InvalidStation
            )
        for i in self.index or ():
            checks.whole("index", i, Range(least=0, most=SIGNALS[self.signal] - 1), InvalidStation)


def lost_box(from_s: float, until_s: float = float("inf")) -> tuple[InjectedFault, ...]:
    """Faults of an object that is no longer seen: its pose stands still in the world, and so does the pose's stamp."""
    return (
        InjectedFault(signal="percept", index=BOX, kind="frozen", from_s=from_s, until_s=until_s),
        InjectedFault(signal="stamps", index=(1,), kind="frozen", from_s=from_s, until_s=until_s),
    )


class FaultySignal(LeafSystem):
    """Input and output `signal` (n,); the output has the faults. The state holds samples of the last second.

    Args:
        size: n. faults: of this signal. control_dt_s: period of the samples.
    """

    def __init__(self, size: int, faults: Sequence[InjectedFault], control_dt_s: float) -> None:
        super().__init__()
        self._faults, self._rows = tuple(faults), round(LONGEST_S / control_dt_s) + 2
        self._input = self.DeclareVectorInputPort("signal", size)
        self._size = size
        self.DeclareDiscreteState(np.full(self._rows * (size + 1), np.nan))  # times and values, newest first
        self.DeclareDiscreteState(np.full(max(1, len(self._faults)) * size, np.nan))  # as each fault began
        self.DeclareVectorOutputPort("signal", size, self._output)
        self.DeclarePeriodicDiscreteUpdateEvent(control_dt_s, 0.0, self._update)

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        now, signal = context.get_time(), self._input.Eval(context)
        samples = context.get_discrete_state(0).value().reshape(self._rows, -1)
        newest = np.concatenate([[now], signal])
        discrete_state.set_value(0, np.vstack([newest, samples[:-1]]).ravel())
        begun = context.get_discrete_state(1).value().reshape(-1, self._size).copy()
        for i, fault in enumerate(self._faults):
            if now <= fault.from_s + 1e-9:
                begun[i] = signal
        discrete_state.set_value(1, begun.ravel())

    def _output(self, context: Context, output: BasicVector) -> None:
        now, signal = context.get_time(), self._input.Eval(context).copy()
        for i, fault in enumerate(self._faults):
            if fault.from_s - 1e-9 <= now < fault.until_s - 1e-9:
                where = slice(None) if fault.index is None else list(fault.index)
                signal[where] = self._bad(context, i, fault, signal)[where]
        output.SetFromVector(signal)

    def _bad(self, context: Context, i: int, fault: InjectedFault, signal: Array) -> Array:
        if fault.kind == "frozen":
            begun = context.get_discrete_state(1).value().reshape(-1, self._size)[i]
            return begun if context.get_time() > fault.from_s + 1e-9 else signal
        if fault.kind == "late":
            samples = context.get_discrete_state(0).value().reshape(self._rows, -1)
            (old,) = np.nonzero(samples[:, 0] <= context.get_time() - fault.value + 1e-9)
            return samples[old[0], 1:] if len(old) else signal
        with np.errstate(all="ignore"):
            return {"value": 0.0 * np.nan_to_num(signal) + fault.value, "add": signal + fault.value}.get(
                fault.kind, signal * fault.value
            )


class Now(LeafSystem):
    """Output `stamps` (2,): the time [s]: of poses that are made now."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareVectorOutputPort(
            "stamps",
            STAMPS,
            lambda context, output: output.SetFromVector(np.full(STAMPS, context.get_time())),
            {self.time_ticket()},
        )
