"""Help texts without breaks in mid sentence: paragraphs of field docstrings as one line, which tyro then wraps."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from textwrap import dedent

from tyro.constructors import ConstructorRegistry, StructConstructorSpec, StructTypeInfo


def whole_paragraphs(text: str) -> str:
    """Text with the lines of each paragraph joined; blank lines and items that begin with `- ` stay apart."""
    lines: list[str] = []
    for line in dedent(text).strip().splitlines():
        line = line.strip()
        if not line or not lines or not lines[-1] or line.startswith("- "):
            if line or lines[-1]:  # one blank line is enough: tyro doubles them
                lines.append(line)
        else:
            lines[-1] += f" {line}"
    return "\n".join(lines)


def unbroken_help() -> ConstructorRegistry:
    """Registry that joins the paragraphs of help texts; to be entered (`with`) around `tyro.cli`.

    tyro joins lines that begin with a letter, but it reads docstrings of fields with the indentation of their later
    lines, which it then takes for the items of a list.
    """
    registry = ConstructorRegistry()
    asked: list[StructTypeInfo] = []

    @registry.struct_rule
    def joined(info: StructTypeInfo) -> StructConstructorSpec | None:
        # The registry is asked again for the rule that would have applied without this one, which then stands aside.
        if any(info is other for other in asked):
            return None
        asked.append(info)
        try:
            spec = ConstructorRegistry.get_struct_spec(info)
        finally:
            asked.pop()
        if not isinstance(spec, StructConstructorSpec):
            return None
        fields = (dataclasses.replace(f, helptext=_joined(f.helptext)) for f in spec.fields)
        return dataclasses.replace(spec, fields=tuple(fields))

    return registry


def _joined(text: str | Callable[[], str | None] | None) -> Callable[[], str | None]:
    """The same help text with whole paragraphs, found when it is asked for (it is read from source files)."""

    def read() -> str | None:
        found = text() if callable(text) else text
        return None if found is None else whole_paragraphs(found)

    return read
