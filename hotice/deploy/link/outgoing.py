"""The one place where a command becomes a message: checked, and for the machine that the robot says it is."""

from __future__ import annotations

from hotice.deploy.command import CheckedCommand
from hotice.deploy.link.protocol import LinkError, ReceivedState


def outgoing(command: CheckedCommand, state: ReceivedState | None) -> bytes:
    """The command as bytes, `mode_machine` echoed from the state. Raises `LinkError`: unchecked, or no state yet."""
    if type(command) is not CheckedCommand:
        raise LinkError(f"a link sends a CheckedCommand only, not {type(command).__name__}: make one of it")
    if state is None:
        raise LinkError("no valid LowState has come yet: which machine a command is for is not known, so none is sent")
    return command.message(state.mode_machine)
