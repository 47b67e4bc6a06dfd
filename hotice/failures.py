"""Failures that a user can mend though they are no `HoticeError`: no memory left, a disk full or not writable.

They can come from anywhere (an allocation in torch, a log, a cache), so they are told apart at the end, by what they
are.
"""

from __future__ import annotations

import errno
import sys

from hotice.errors import HoticeError, OutOfMemory, OutputError

STOPPED = 75
"""Exit status of a run that was asked to stop and has saved: to be gone on with (EX_TEMPFAIL of sysexits.h)."""
INTERRUPTED = 130
"""Exit status after Ctrl-C where nothing was saved: 128 and the number of SIGINT, as shells have it."""

LOWER = {
    "train": "lower --num-envs or --steps, or raise --minibatches",
    "distill": "lower --num-envs, --steps or --aggregate, or raise --minibatches",
    "finetune": "lower --num-envs or --steps, or raise --minibatches",
    "evaluate": "lower --batch or --threads",
    "play": "lower --rollouts, or give fewer scenes",
    "benchmark": "lower --num-envs",
    "reproduce": "lower --num-envs or --threads",
    "pipeline": "lower --workers",
}
"""Options by command that lower its need of memory."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
FORBIDDEN = (errno.EROFS, errno.EACCES, errno.EPERM)
BROKEN = (errno.EIO, errno.ESTALE)
SAYINGS = (
    "DefaultCPUAllocator",
    "out of memory",
    "Could not allocate memory",
    "Failed to allocate",
    "Cannot allocate memory",
)
"""Messages by which torch (CPU), CUDA, MuJoCo, Warp and the kernel say that memory ran out, in errors of no kind
of their own."""


def mendable(error: BaseException, command: str = "") -> HoticeError | None:
    """Message for the user of `command` instead of a traceback; None for an error that is a defect."""
    if isinstance(error, HoticeError):
        return error
    if ran_out_of_memory(error):
        mend = LOWER.get(command, "ask for less at once")
        return OutOfMemory(f"out of memory{_where(error)}: {mend}; checkpoints and finished results are kept")
    if isinstance(error, OSError) and error.errno in FULL + FORBIDDEN + BROKEN:
        mend = "make room" if error.errno in FULL else "give a folder that can be written"
        name = error.filename if error.filename is not None else "the output"
        verb = "write" if error.errno in FULL else "use"
        return OutputError(f"cannot {verb} {name}: {error.strerror}: {mend}; checkpoints and finished results are kept")
    return None


def ran_out_of_memory(error: BaseException) -> bool:
    """Whether memory of the machine or of its GPU ran out."""
    if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
        return True
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(error, torch.OutOfMemoryError):
        return True
    return isinstance(error, (RuntimeError, ValueError)) and any(words in str(error) for words in SAYINGS)


def one_line(text: str) -> str:
    """Text on one line in which whatever would move the cursor or colour a terminal is written out."""
    words = text.replace("\n", " ")
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in words)


def _where(error: BaseException) -> str:
    return " on the GPU" if "CUDA" in str(error) or "cuda" in str(error) else ""
