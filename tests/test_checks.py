"""Checks of numbers, arrays, keys and names: what passes, what does not, and what the message says."""

import math
import re
import subprocess
import sys
from dataclasses import dataclass

import numpy as np
import pytest

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig, InvalidObject, InvalidScene

HUGE = 10**5000


@dataclass(frozen=True)
class Config:
    steps: object = 2
    gain: object = 0.5
    name: str = "x"


@pytest.mark.parametrize(
    ("allowed", "inside", "outside", "text"),
    [
        (checks.ANY, (-1e300, 0, 1.7e308), (math.inf, -math.inf, math.nan, HUGE), ""),
        (checks.POSITIVE, (1e-12, 5, 1e9), (0, -0.0, -1, math.inf), "above 0"),
        (checks.NOT_NEGATIVE, (0, 0.0, 3), (-1e-300, math.nan), "of at least 0"),
        (checks.SHARE, (0, 1, 0.5), (1.0000001, -1), "from 0 to 1"),
        (checks.COUNT, (1, 10**9), (0, -5), "of at least 1"),
        (checks.INT64, (0, 2**63 - 1), (2**63, -1, HUGE), "from 0 to 2^63 - 1"),
        (Range(above=0, most=1_000_000), (1e6, 1), (0, 1_000_001), "above 0 and at most 1,000,000"),
        (Range(least=0, below=1), (0, 0.999), (1,), "from 0 to below 1"),
        (Range(most=5), (5, -1e9), (6,), "of at most 5"),
        (Range(least=-1e4, most=1e4), (-1e4, 1e4), (10001,), "within ±10000"),
        (Range(least=0.01, most=0.2, unit="m"), (0.01, 0.2), (0.0,), "from 0.01 to 0.2 m"),
    ],
    ids=range(11),
)
def test_ranges(allowed, inside, outside, text):
    assert str(allowed) == text
    assert all(checks.number("x", value, allowed) == float(value) for value in inside)
    for value in outside:
        with pytest.raises(InvalidConfig, match="^x is .*: " + re.escape(f"a finite number {text}".rstrip())) as caught:
            checks.number("x", value, allowed)
        assert str(caught.value).endswith(" is needed")


@pytest.mark.parametrize("value", [True, "1", None, [1.0], 1j, np.True_, b"1", {}])
def test_what_is_no_number(value):
    for check in (checks.number, checks.whole):
        with pytest.raises(InvalidScene, match="x is .* number is needed"):
            check("x", value, error=InvalidScene)


def test_numbers_of_numpy_become_pythons():
    assert type(checks.number("x", np.float32(0.5))) is float and type(checks.number("x", np.int64(3))) is float
    assert type(checks.whole("x", np.uint8(3))) is int


@pytest.mark.parametrize("value", [3.0, np.float64(3.0), True, 0])
def test_whole_numbers(value):
    with pytest.raises(InvalidConfig, match=r"x is .*: a whole number of at least 1 is needed \(one each\)"):
        checks.whole("x", value, Range(least=1, note="one each"))


def test_fields_of_a_configuration():
    checks.numbers(Config(), checks.POSITIVE, but=("name",))
    checks.wholes(Config(), checks.COUNT, "steps")
    with pytest.raises(InvalidConfig, match="^gain is -1: a finite number above 0 is needed$"):
        checks.numbers(Config(gain=-1), checks.POSITIVE, "steps", "gain")
    with pytest.raises(InvalidConfig, match="^name is 'x': a finite number"):
        checks.numbers(Config(), checks.POSITIVE)


def test_vectors():
    for value in ([1, 2.5], (1, 2.5), np.array([1, 2.5])):
        assert checks.vector("p", value, 2) == (1.0, 2.5)
    assert checks.vector("p", [4], None) == (4.0,)
    for value, length, wanted in (([1], 2, "2"), ("ab", 2, "2"), (3, 2, "2"), ([], None, "one or more"), ([], 1, "1")):
        with pytest.raises(InvalidObject, match=f"^p is .*: a list of {wanted} numbers is needed$"):
            checks.vector("p", value, length, error=InvalidObject)
    with pytest.raises(InvalidObject, match=r"^p\[1\] is nan: a finite number above 0 is needed$"):
        checks.vector("p", [1.0, math.nan], 2, checks.POSITIVE, InvalidObject)
    with pytest.raises(InvalidConfig, match=r"^p\[0\] is \[1, 2\]"):
        checks.vector("p", np.array([[1, 2], [3, 4]]), 2)


def test_intervals():
    assert checks.interval("r", [1, 1]) == (1.0, 1.0)
    with pytest.raises(InvalidConfig, match=r"^r is \[2, 1\]: the lowest number, then the highest, is needed$"):
        checks.interval("r", [2, 1])


def test_unit_quaternions():
    exact = (0.6, 0.0, 0.8, 0.0)
    assert checks.unit_quaternion("q", exact) == exact  # bit for bit
    np.testing.assert_allclose(checks.unit_quaternion("q", [1.0005, 0, 0, 0]), (1, 0, 0, 0))
    for value, length in (((1, 1, 0, 0), "1.414"), ((0, 0, 0, 0), "0"), ((1e300, 0, 0, 0), "inf")):
        with pytest.raises(InvalidConfig, match=f"^q has length {length}: a unit quaternion w, x, y, z is needed$"):
            checks.unit_quaternion("q", value)


def test_arrays():
    assert checks.array("a", [[1, 2, 3]], 1, 3).dtype == np.float64
    with pytest.raises(InvalidScene, match=r"^a has shape \(2,\): 3 finite numbers are needed$"):
        checks.array("a", [1, 2], 3, error=InvalidScene)
    with pytest.raises(InvalidScene, match=r"^a has shape \(2,\): \(2, 3\) finite numbers are needed$"):
        checks.array("a", [1, 2], 2, 3, error=InvalidScene)
    with pytest.raises(InvalidConfig, match="^a holds numbers that are not finite: 2 finite numbers are needed$"):
        checks.array("a", [1, math.nan], 2)
    for value in ([[1, 2], [3]], ["1", "2"], [True, False], [10**400, 1], [1 + 2j, 0], None):
        with pytest.raises(InvalidConfig, match="^a is .*: 2 finite numbers are needed$"):
            checks.array("a", value, 2)


def test_flags_and_names():
    assert checks.flag("f", False) is False
    for value in (0, "true", None):
        with pytest.raises(InvalidConfig, match="^f is .*: true or false is needed$"):
            checks.flag("f", value)
    assert checks.one_of("kind", "a", {"a": 1, "b": 2}) == "a"
    for value in ("c", None, [], ["a"]):
        with pytest.raises(InvalidConfig, match="^kind is .*: known are a, b, or a path$"):
            checks.one_of("kind", value, ("a", "b"), otherwise="a path")


def test_mappings():
    assert checks.mapping("m", {"a": 1}, ("a",), ("b",)) == {"a": 1}
    for value, text in (
        (3, "m is 3: a mapping with a, b is needed"),
        ({"b": 1}, "m lacks 'a': known are a, b"),
        ({"a": 1, "c": 1}, "m has unknown key 'c': known are a, b"),
        ({"a": 1, 7: 1, None: 2}, "m has unknown key 7, None: known are a, b"),
    ):
        with pytest.raises(InvalidScene, match=f"^{text}$"):
            checks.mapping("m", value, ("a",), ("b",), InvalidScene)


@pytest.mark.parametrize(
    "value",
    [HUGE, "x" * 10**6, [[[[[1]]]]] * 1000, {i: i for i in range(1000)}, object(), np.zeros((2, 2))],
    ids=["huge", "text", "deep", "wide", "object", "array"],
)
def test_messages_stay_short(value):
    with pytest.raises(InvalidConfig) as caught:
        checks.number("x", value)
    assert len(str(caught.value)) < 300 and "\n" not in str(caught.value)


def test_they_load_nothing_heavy():
    code = "import sys, hotice.checks; print(sorted({'torch', 'mujoco', 'scipy', 'numba'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize(
    "value, allowed, message",
    [
        (1e308, checks.POSITIVE, r"above 0 \(none larger than 1,000,000,000\)"),
        (1e-308, checks.POSITIVE, r"above 0 \(none smaller than 1e-12\)"),
        (1e-308, checks.NOT_NEGATIVE, r"of at least 0 \(none smaller than 1e-12\)"),
        (10**30, checks.COUNT, r"of at least 1 \(none larger than"),
    ],
)
def test_numbers_beyond_all_use(value, allowed, message):
    with pytest.raises(InvalidConfig, match=message):
        checks.number("x", value, allowed)


def test_an_end_that_says_so_allows_them():
    assert checks.whole("seed", 2**62, checks.INT64) == 2**62
    assert checks.number("x", 1e12, Range(most=1e13)) == 1e12
    assert checks.number("x", 1e-300) == 1e-300 and checks.number("x", 0, checks.NOT_NEGATIVE) == 0
