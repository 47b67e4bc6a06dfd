"""JSON and YAML of files that nobody should trust."""

import math

import pytest

from hotice.documents import MAX_DEPTH, parse_json, read_json, read_yaml
from hotice.errors import InputError, InvalidConfig


@pytest.mark.parametrize(
    "content, message",
    [
        ("{", "is not JSON: Expecting"),
        (b"\xff", "is not JSON: invalid start byte at byte 0"),
        ("[" * 100_000, "nested too deeply"),
        ("[" * 51 + "]" * 51, "nested more than 50 deep"),
        ('{"a":' * 60 + "1" + "}" * 60, "nested more than 50 deep"),
        ('{"a": 1, "b": 2, "a": 3}', "key 'a' occurs twice"),
        ("9" * 5000, "a number of 5000 digits: at most 1000"),
    ],
)
def test_json_that_is_refused(content, message):
    with pytest.raises(InputError, match=f"^x: .*{message}"):
        parse_json("x", content)


def test_json_that_is_read(tmp_path):
    file = tmp_path / "a.json"
    file.write_text('{"a": [1, NaN, "9"], "b": ' + "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1) + "}")
    value = read_json(file, 1000)
    assert value["a"][0] == 1 and math.isnan(value["a"][1])
    with pytest.raises(InvalidConfig, match="a.json: holds NaN: numbers must be finite"):
        read_json(file, 1000, InvalidConfig, finite=True)
    with pytest.raises(InvalidConfig, match="larger than"):
        read_json(file, 20, InvalidConfig)


def test_numbers_beyond_all_floats_are_not_finite_either():
    assert parse_json("x", "[1e400, -1e400]") == [math.inf, -math.inf]
    with pytest.raises(InputError, match="^x: holds '-1e400': numbers must be finite$"):
        parse_json("x", "[1e300, -1e400]", finite=True)


@pytest.fixture
def yaml_of(tmp_path):
    def read(text):
        (tmp_path / "a.yaml").write_text(text)
        return read_yaml(tmp_path / "a.yaml", 2**20)

    return read


def test_yaml_that_is_read(yaml_of):
    value = yaml_of("a: 1\nb: [2.5, yes, ~, 'x', -.inf, 0x1F]\nday: 2001-99-99\nc: {d: !!str 3}\n")
    assert value == {"a": 1, "b": [2.5, True, None, "x", -math.inf, 31], "day": "2001-99-99", "c": {"d": "3"}}


@pytest.mark.parametrize(
    "text, message",
    [
        ("a: &a [1]\nb: *a\n", "aliases .* are not allowed"),
        ("a: 1\na: 2\n", "key 'a' twice"),
        ("a: {1: x, 1: y}\n", "key 1 twice"),
        ("? [a]\n: 1\n", "text or a number is needed"),
        ("seed: " + "9" * 5000, "is no int that can be read"),
        ("seed: !!int x", "'x' is no int that can be read"),
        ("seed: !!float x", "'x' is no float that can be read"),
        ("seed: !!bool x", "'x' is no bool that can be read"),
        ("seed: !!null x", "'x' is no null that can be read"),
        ("seed: !!map x", "expected a mapping node, but found scalar in line 1"),
        ("!!map [a, b]", "expected a mapping node, but found sequence in line 1"),
        ("a: !!timestamp x", "tag .*timestamp.* is not allowed"),
        ("a: !!binary x", "tag .*binary.* is not allowed"),
        ("!!python/object/apply:os.system ['true']", "tag .*os.system.* is not allowed"),
        ("a: [", "expected the node content.* in line 1"),
        ("a: 1\n---\nb: 2\n", "expected a single document"),
        ("[" * 100_000, "nested too deeply"),
        ("[" * 51 + "]" * 51, "nested more than 50 deep"),
        ("\n".join(" " * i + "a:" for i in range(600)), "nested"),
    ],
)
def test_yaml_that_is_refused(yaml_of, text, message):
    with pytest.raises(InvalidConfig, match=f"^.*a.yaml: .*{message}") as caught:
        yaml_of(text)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 500


def test_many_keys_take_no_time_to_compare(yaml_of):
    """Each with each would be ten thousand million comparisons."""
    assert len(yaml_of("".join(f"k{i}: 1\n" for i in range(20_000)))) == 20_000
