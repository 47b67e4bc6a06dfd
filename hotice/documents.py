"""JSON and YAML of untrusted files: plain values, within limits of size and depth, no key twice, nothing executed."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from hotice.checks import shown
from hotice.errors import HoticeError, InputError, InvalidConfig
from hotice.files import read_bytes

MAX_DEPTH = 50
"""Most lists and mappings within each other: what goes through a document one by one needs no stack of any size."""
MAX_DIGITS = 1000
"""Longest number: Python refuses to read or write thousands of digits, in an error of its own."""


def parse_json(where: str, content: bytes | str, error: type[HoticeError] = InputError, *, finite: bool = False) -> Any:
    """The value of a JSON text. `where` begins the message; `finite`: refuses NaN, infinities and what is read as one.

    Raises `error` for anything else than JSON, for a key that occurs twice and for nesting deeper than `MAX_DEPTH`.
    """

    def constant(word: str) -> float:
        if finite:
            raise ValueError(f"holds {word}: numbers must be finite")
        return float(word)

    def decimal(digits: str) -> float:
        value = float(digits)
        if finite and not math.isfinite(value):
            raise ValueError(f"holds {shown(digits)}: numbers must be finite")
        return value

    def integer(digits: str) -> int:
        if len(digits) > MAX_DIGITS:
            raise ValueError(f"holds a number of {len(digits)} digits: at most {MAX_DIGITS} are read")
        return int(digits)

    try:
        text = content.decode() if isinstance(content, bytes) else content
        value = json.loads(
            text, parse_constant=constant, parse_float=decimal, parse_int=integer, object_pairs_hook=_once
        )
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
    # PyYAML is imported only where a YAML file is read
    import yaml

    from hotice.plain_yaml import load_plain

    content = read_bytes(path, max_bytes)
    try:
        value = load_plain(content.decode(), MAX_DIGITS)
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
