"""What happens when, as text on a command line: `WHAT@3s`, or `WHAT@3s+0.5s` for half a second."""

from __future__ import annotations

import re

from hotice import checks
from hotice.errors import InvalidConfig

_TEXT = re.compile(r"([^@\s]+)@(\d{1,9}(?:\.\d{1,9})?)s(?:\+(\d{1,9}(?:\.\d{1,9})?)s)?")


def timed(kind: str, text: str, examples: str) -> tuple[str, float, float | None]:
    """What, its start [s] and its duration [s], None for none. Raises `InvalidConfig`."""
    found = _TEXT.fullmatch(text)
    if not found:
        raise InvalidConfig(
            f"{kind} is {checks.shown(text)}: WHAT@STARTs or WHAT@STARTs+DURATIONs is needed, as {examples}"
        )
    what, start, duration = found.groups()
    return what, float(start), None if duration is None else float(duration)
