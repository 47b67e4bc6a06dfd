"""PyYAML held to plain values: mappings, lists, text, numbers, true, false and null."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Any

import yaml

from hotice.checks import shown

WORDS = ("null", "bool", "int", "float")
"""Kinds of scalars that are written in certain ways only."""
KINDS = (*WORDS, "str", "seq", "map")


class Plain(yaml.SafeLoader):
    """A loader without aliases, tags and keys that occur twice. Raises `yaml.YAMLError`."""

    max_digits = 1000
    """Longest number."""
    # dates, sets and the like stay text: PyYAML's own constructors fail on impossible ones in many ways
    yaml_implicit_resolvers = {
        letter: [(tag, pattern) for tag, pattern in rows if tag.rpartition(":")[2] in KINDS]
        for letter, rows in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not allowed: write the values out, or under 'defaults'")
        node = super().compose_node(parent, index)
        if node is not None and node.tag.removeprefix("tag:yaml.org,2002:") not in KINDS:
            raise yaml.YAMLError(f"tag {shown(node.tag)} is not allowed: known are {', '.join(KINDS)}")
        return node

    def construct_scalar(self, node: Any) -> Any:
        value = super().construct_scalar(node)
        kind = node.tag.rpartition(":")[2]
        if kind in WORDS and (len(value) > self.max_digits or not self._is(node.tag, value)):
            raise yaml.YAMLError(f"{shown(value)} is no {kind} that can be read")
        return value

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        # a list or text can be tagged as a mapping: PyYAML's own answer to that comes below
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        keys = [self.construct_object(key, deep=True) for key, _ in pairs]
        if wrong := [key for key in keys if not isinstance(key, Hashable)]:
            raise yaml.YAMLError(f"key {shown(wrong[0])}: text or a number is needed")
        if repeated := [key for key, count in Counter(keys).items() if count > 1]:
            raise yaml.YAMLError(f"key {shown(repeated[0])} twice")
        return super().construct_mapping(node, deep)

    def _is(self, tag: str, value: str) -> bool:
        """Whether text with this tag, perhaps given by hand, is what the tag says."""
        rows = self.yaml_implicit_resolvers.get(value[:1], ())
        return any(tag == known and pattern.match(value) for known, pattern in rows)


def load_plain(text: str, max_digits: int) -> Any:
    """The value of a YAML text with numbers of at most `max_digits`. Raises `yaml.YAMLError` or `RecursionError`."""
    loader = Plain(text)
    loader.max_digits = max_digits
    try:
        return loader.get_single_data()
    finally:
        loader.dispose()
