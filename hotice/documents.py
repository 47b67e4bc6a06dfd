"""JSON and YAML of untrusted files: plain values, within limits of size and depth, no key twice, nothing executed."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Hashable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hotice.checks import shown
from hotice.errors import HoticeError, InputError, InvalidConfig
from hotice.files import read_bytes

if TYPE_CHECKING:
    import yaml

MAX_DEPTH = 50
"""Most lists and mappings within each other: what goes through a document one by one needs no stack of any size."""
MAX_DIGITS = 1000
"""Longest number: Python refuses to read or write thousands of digits, in an error of its own."""


def parse_json(where: str, content: bytes | str, error: type[HoticeError] = InputError, *, finite: bool = False) -> Any:
    """The value of a JSON text. `where` begins the message; `finite`: refuses NaN and infinities.

    Raises `error` for anything else than JSON, for a key that occurs twice and for nesting deeper than `MAX_DEPTH`.
    """

    def constant(word: str) -> float:
        if finite:
            raise ValueError(f"holds {word}: numbers must be finite")
        return float(word)

    def integer(digits: str) -> int:
        if len(digits) > MAX_DIGITS:
            raise ValueError(f"holds a number of {len(digits)} digits: at most {MAX_DIGITS} are read")
        return int(digits)

    try:
        text = content.decode() if isinstance(content, bytes) else content
        value = json.loads(text, parse_constant=constant, parse_int=integer, object_pairs_hook=_once)
    except json.JSONDecodeError as wrong:
        raise error(f"{where}: is not JSON: {wrong}") from None
    except UnicodeDecodeError as wrong:
        raise error(f"{where}: is not JSON: {wrong.reason} at byte {wrong.start}") from None
    except ValueError as wrong:
        raise error(f"{where}: {wrong}") from None
    except RecursionError:
        raise error(f"{where}: is nested too deeply") from None
    _check_depth(where, value, error)
    return value


def read_json(path: str | Path, max_bytes: int, error: type[HoticeError] = InputError, *, finite: bool = False) -> Any:
    """The value of a JSON file of at most `max_bytes`. Raises `error`, whose message names the file."""
    try:
        content = read_bytes(path, max_bytes)
    except InputError as wrong:
        raise error(str(wrong)) from None
    return parse_json(str(path), content, error, finite=finite)


def read_yaml(path: str | Path, max_bytes: int) -> Any:
    """The value of a YAML file of at most `max_bytes`: mappings, lists, text, numbers, true, false and null.

    Raises:
        InputError: the file cannot be read.
        InvalidConfig: it is no such YAML, or has aliases (a small file could become huge), tags or a key twice.
    """
    import yaml

    content = read_bytes(path, max_bytes)
    try:
        value = yaml.load(content.decode(), plain_loader())  # noqa: S506 - a loader of plain values
    except yaml.MarkedYAMLError as wrong:
        # the rest of the message quotes the file
        said = ", ".join(filter(None, (wrong.context, wrong.problem)))
        place = "" if wrong.problem_mark is None else f" in line {wrong.problem_mark.line + 1}"
        raise InvalidConfig(f"{path}: is no plain YAML: {said}{place}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as wrong:
        raise InvalidConfig(f"{path}: is no plain YAML: {' '.join(str(wrong).split())[:300]}") from None
    except RecursionError:
        raise InvalidConfig(f"{path}: is nested too deeply") from None
    _check_depth(str(path), value, InvalidConfig)
    return value


def plain_loader() -> type[yaml.SafeLoader]:
    """The loader of `read_yaml`; PyYAML is imported only where a YAML file is read."""
    import yaml

    kinds = ("null", "bool", "int", "float", "str", "seq", "map")

    class Plain(yaml.SafeLoader):
        # dates, sets and the like stay text: PyYAML's own constructors fail on impossible ones in many ways
        yaml_implicit_resolvers = {
            letter: [(tag, pattern) for tag, pattern in rows if tag.rpartition(":")[2] in kinds]
            for letter, rows in yaml.SafeLoader.yaml_implicit_resolvers.items()
        }

        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                raise yaml.YAMLError("aliases (*name) are not allowed: write the values out, or under 'defaults'")
            node = super().compose_node(parent, index)
            if node is not None and node.tag.removeprefix("tag:yaml.org,2002:") not in kinds:
                raise yaml.YAMLError(f"tag {shown(node.tag)} is not allowed: known are {', '.join(kinds)}")
            return node

        def construct_scalar(self, node: Any) -> Any:
            value = super().construct_scalar(node)
            number = node.tag.endswith((":int", ":float"))
            if number and (len(value) > MAX_DIGITS or not self._is(node.tag, value)):
                raise yaml.YAMLError(f"{shown(value)} is no number that can be read")
            return value

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            keys = [self.construct_object(key, deep=True) for key, _ in node.value]
            if wrong := [key for key in keys if not isinstance(key, Hashable)]:
                raise yaml.YAMLError(f"key {shown(wrong[0])}: text or a number is needed")
            if repeated := [key for key, count in Counter(keys).items() if count > 1]:
                raise yaml.YAMLError(f"key {shown(repeated[0])} twice")
            return super().construct_mapping(node, deep)

        def _is(self, tag: str, value: str) -> bool:
            """Whether text with this tag, perhaps given by hand, is what the tag says."""
            rows = self.yaml_implicit_resolvers.get(value[:1], ())
            return any(tag == known and pattern.match(value) for known, pattern in rows)

    return Plain


def _once(items: list[tuple[str, Any]]) -> dict[str, Any]:
    mapping = dict(items)
    if len(mapping) < len(items):
        twice = Counter(key for key, _ in items).most_common(1)[0][0]
        raise ValueError(f"key {shown(twice)} occurs twice in one mapping")
    return mapping


def _check_depth(where: str, value: Any, error: type[HoticeError]) -> None:
    level = [value]
    for _ in range(MAX_DEPTH):
        inner = (part.values() if isinstance(part, dict) else part for part in level if isinstance(part, dict | list))
        level = [part for parts in inner for part in parts if isinstance(part, dict | list)]
        if not level:
            return
    raise error(f"{where}: is nested more than {MAX_DEPTH} deep")
