"""Lines that a program of a deployment says to the one that started it: JSON, one object a line, never waited for."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from typing import Any

from hotice.errors import HoticeError
from hotice.failures import one_line


class Saying:
    """Says lines on a descriptor without ever waiting; what does not fit, and what nobody hears, is dropped."""

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = sys.stdout.fileno() if descriptor is None else descriptor
        os.set_blocking(self._descriptor, False)
        self.dropped = 0

    def __call__(self, **fields: Any) -> None:
        # at most 4,096 bytes: a pipe takes such a line whole or not at all
        line = json.dumps(fields)[:4000].encode() + b"\n"
        try:
            os.write(self._descriptor, line)
        except (BlockingIOError, BrokenPipeError):
            self.dropped += 1


def ended(program: Callable[[], None]) -> int:
    """Exit status of a program: 0, or 2 with one line on standard error for what the user can mend."""
    try:
        program()
    except HoticeError as error:
        print(one_line(str(error)), file=sys.stderr)
        return 2
    return 0
