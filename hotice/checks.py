"""Checks of what comes from outside: numbers of configurations, arrays, keys of untrusted files, names out of a table.

Each says what came and what is allowed, raises the error class that it is given, and returns what was checked.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hotice.errors import HoticeError, InvalidConfig

Error = type[HoticeError]


class _Short(reprlib.Repr):
    def repr_int(self, x: int, level: int) -> str:
        # Python refuses to write out thousands of digits
        return repr(x) if x.bit_length() <= 128 else f"an integer of {x.bit_length()} bits"


_SHOWN = _Short()
_SHOWN.maxlevel, _SHOWN.maxstring, _SHOWN.maxother = 3, 60, 60


def shown(value: object) -> str:
    """`repr` for messages: one line, short and shallow, whatever an untrusted file holds."""
    return " ".join(_SHOWN.repr(value).split())


FARTHEST = 10**9
NEAREST = 1e-12


@dataclass(frozen=True, kw_only=True)
class Range:
    """Numbers that are allowed, with both ends (`least`, `most`) or without (`above`, `below`).

    As text: `of at least 0`. `unit` stands behind the numbers, `note` in brackets at the end of the message.
    Amounts, which have a lowest number, end at `FARTHEST` unless another end is given, and what is smaller than
    `NEAREST` is neither 0 nor above it: products and quotients of such numbers overflow.
    """

    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    unit: str = ""
    note: str = ""

    def holds(self, value: Any) -> bool:
        """Whether a number is finite and within; an integer beyond all floats is not."""
        try:
            finite = math.isfinite(value)
        except OverflowError:
            return False
        return (
            finite
            and self.fault(value) == ""
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )

    def fault(self, value: Any) -> str:
        """That a number is beyond all use though no end forbids it, in words; else ""."""
        begins = self.least is not None or self.above is not None
        if begins and self.most is None and self.below is None and value > FARTHEST:
            return f"larger than {FARTHEST:,}"
        if 0 in (self.least, self.above) and 0 < value < NEAREST:
            return f"smaller than {NEAREST:g}"
        return ""

    def __str__(self) -> str:
        if self.least is not None and self.least == -(self.most or math.nan):
            ends = f"within ±{_limit(-self.least)}"
        elif self.least is not None and self.most is not None:
            ends = f"from {_limit(self.least)} to {_limit(self.most)}"
        elif self.least is not None and self.below is not None:
            ends = f"from {_limit(self.least)} to below {_limit(self.below)}"
        else:
            words = {"at least": self.least, "above": self.above, "at most": self.most, "below": self.below}
            ends = " and ".join(f"{word} {_limit(end)}" for word, end in words.items() if end is not None)
            ends = ends.replace("at", "of at", 1) if ends.startswith("at") else ends
        return f"{ends} {self.unit}" if self.unit else ends


ANY = Range()
POSITIVE = Range(above=0)
NOT_NEGATIVE = Range(least=0)
SHARE = Range(least=0, most=1)
COUNT = Range(least=1)
"""Of things of which there must be one."""
INT64 = Range(least=0, most=2**63 - 1)
"""Of seeds and counters, which are stored in 64 bits."""


def number(where: str, value: object, allowed: Range = ANY, error: Error = InvalidConfig) -> float:
    """`value` as a float. Raises `error`, whose message starts with `where`, unless it is an `allowed` number."""
    if isinstance(value, bool) or not isinstance(value, Real) or not allowed.holds(value):
        raise error(_refusal(where, value, "a finite number", allowed))
    return float(value)


def whole(where: str, value: object, allowed: Range = ANY, error: Error = InvalidConfig) -> int:
    """`value` as an integer. Raises `error`, as `number` does; also for 3.0."""
    if isinstance(value, bool) or not isinstance(value, Integral) or not allowed.holds(value):
        raise error(_refusal(where, value, "a whole number", allowed))
    return int(value)


def numbers(owner: object, allowed: Range, *names: str, but: Collection[str] = ()) -> None:
    """`number` for the named attributes of a configuration, or for all of them except those in `but`."""
    for name in names or vars(owner):
        if name not in but:
            number(name, getattr(owner, name), allowed)


def wholes(owner: object, allowed: Range, *names: str) -> None:
    """`whole` for the named attributes of a configuration."""
    for name in names:
        whole(name, getattr(owner, name), allowed)


def vector(
    where: str, value: object, length: int | None, allowed: Range = ANY, error: Error = InvalidConfig
) -> tuple[float, ...]:
    """`length` numbers (None: one or more) of a list, tuple or array, each as `number` wants it. Raises `error`."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple) or len(value) != (max(len(value), 1) if length is None else length):
        wanted = "one or more numbers" if length is None else f"{length} numbers"
        raise error(f"{where} is {shown(value)}: a list of {wanted} is needed")
    return tuple(number(f"{where}[{i}]", v, allowed, error) for i, v in enumerate(value))


def interval(where: str, value: object, allowed: Range = ANY, error: Error = InvalidConfig) -> tuple[float, float]:
    """A lowest and a highest number, each as `number` wants it. Raises `error`."""
    low, high = vector(where, value, 2, allowed, error)
    if low > high:
        raise error(f"{where} is {shown(value)}: the lowest number, then the highest, is needed")
    return low, high


def unit_quaternion(where: str, value: object, error: Error = InvalidConfig) -> tuple[float, ...]:
    """Four numbers w, x, y, z of length 1 to a thousandth, then of length 1. Raises `error`."""
    quat = np.array(vector(where, value, 4, error=error))
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(quat))
    if not abs(length - 1.0) <= 1e-3:
        raise error(f"{where} has length {length:.4g}: a unit quaternion w, x, y, z is needed")
    # what is of length 1 stays bit for bit
    return tuple((quat / length if abs(length - 1.0) > 1e-12 else quat).tolist())


def array(where: str, value: ArrayLike, *shape: int, error: Error = InvalidConfig) -> NDArray[np.float64]:
    """`value` as floats of this shape, all finite. Raises `error`."""
    wanted = f"{shape[0]}" if len(shape) == 1 else f"{shape}"
    try:
        given = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        given = np.array(None)
    if given.dtype.kind not in "iuf":
        raise error(f"{where} is {shown(value)}: {wanted} finite numbers are needed")
    result = given.astype(np.float64, copy=False)
    if result.shape != shape:
        raise error(f"{where} has shape {result.shape}: {wanted} finite numbers are needed")
    if not np.isfinite(result).all():
        raise error(f"{where} holds numbers that are not finite: {wanted} finite numbers are needed")
    return result


def flag(where: str, value: object, error: Error = InvalidConfig) -> bool:
    """`value` unless it is something else than true or false. Raises `error`."""
    if not isinstance(value, bool):
        raise error(f"{where} is {shown(value)}: true or false is needed")
    return value


def one_of(where: str, value: object, known: Iterable[str], error: Error = InvalidConfig, otherwise: str = "") -> str:
    """`value` if it is one of the `known` names. Raises `error`, which also says what else may be given."""
    names = list(known)
    if not isinstance(value, str) or value not in names:
        raise error(
            f"{where} is {shown(value)}: known are {', '.join(names)}{f', or {otherwise}' if otherwise else ''}"
        )
    return value


def mapping(
    where: str,
    data: object,
    required: Collection[str] = (),
    optional: Collection[str] = (),
    error: Error = InvalidConfig,
) -> Mapping[str, Any]:
    """`data` if it is a mapping with all `required` keys and none beside them and `optional` ones. Raises `error`."""
    keys = (*required, *optional)
    if not isinstance(data, Mapping):
        raise error(f"{where} is {shown(data)}: a mapping {'with' if required else 'of'} {', '.join(keys)} is needed")
    for wrong, found in (("lacks", set(required) - set(data)), ("has unknown key", set(data) - set(keys))):
        if found:
            some = ", ".join(sorted(map(shown, found))[:5])
            raise error(f"{where} {wrong} {some}: known are {', '.join(keys)}")
    return data


def _refusal(where: str, value: object, kind: str, allowed: Range) -> str:
    wanted = f"{kind} {allowed}".rstrip()
    if isinstance(value, Real) and not isinstance(value, bool) and (fault := allowed.fault(value)):
        wanted += f" (none {fault})"
    return f"{where} is {shown(value)}: {wanted} is needed{f' ({allowed.note})' if allowed.note else ''}"


def _limit(value: float) -> str:
    if isinstance(value, int) and value >= 2**31 - 1 and (value + 1).bit_count() == 1:
        return f"2^{value.bit_length()} - 1"
    return f"{value:,}" if isinstance(value, int) else f"{value:g}"
