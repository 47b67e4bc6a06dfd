"""Formulas of pages as MathML, which browsers draw themselves: a site that loads nothing has no other way."""

from __future__ import annotations

import re

CODE = re.compile(r"(^(?:```|~~~).*?^(?:```|~~~)[ \t]*$|`+[^`\n]+`+)", re.M | re.S)
"""Blocks and words of code, in which a dollar is a dollar."""
DISPLAY = re.compile(r"\$\$(.+?)\$\$", re.S)
INLINE = re.compile(r"(?<![\\$\w])\$(?=[^\s$])([^$\n]*[^\s$\\])\$(?![\w$])")


def with_mathml(page: str) -> str:
    """A page of Markdown with its formulas ($…$ and $$…$$, LaTeX) as MathML. Raises `ValueError` for a broken one."""
    parts = CODE.split(page)
    # what the expression captures is every second part
    return "".join(part if i % 2 else _formulas(part) for i, part in enumerate(parts))


def _formulas(text: str) -> str:
    text = DISPLAY.sub(lambda found: _mathml(found[1], "block"), text)
    return INLINE.sub(lambda found: _mathml(found[1], "inline"), text)


def _mathml(formula: str, display: str) -> str:
    from latex2mathml import exceptions
    from latex2mathml.converter import convert

    broken = tuple(kind for kind in vars(exceptions).values() if isinstance(kind, type))
    try:
        made = convert(" ".join(formula.split()), display=display)
    except broken as error:
        raise ValueError(f"no formula: {formula.strip()}: {type(error).__name__}") from None
    if "\\" in made:
        raise ValueError(f"no formula: {formula.strip()}: it has a command that MathML is not made of")
    made = made.replace("\n", " ")
    # a line that began with `math` would be a block of HTML to Markdown, and the rest of its paragraph too
    return made if display == "block" else f"<span>{made}</span>"
