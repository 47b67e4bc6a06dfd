"""The one place where a command becomes a message: checked, and fit for the machine that the robot says it is."""

from __future__ import annotations

from hotice.deploy.command import CheckedCommand
from hotice.deploy.link.protocol import LinkError, ReceivedState
from hotice.deploy.messages.hg import ABSENT, MACHINES, PITCH_ROLL
from hotice.model import g1


def outgoing(command: CheckedCommand, state: ReceivedState | None) -> bytes:
    """The command as bytes, `mode_machine` echoed from the state.

    Raises:
        LinkError: it is unchecked, no state has come yet, or it does not fit the machine or mode of the state
    """
    if type(command) is not CheckedCommand:
        raise LinkError(f"a link sends a CheckedCommand only, not {type(command).__name__}: make one of it")
    if state is None:
        raise LinkError("no valid LowState has come yet: which machine a command is for is not known, so none is sent")
    machine, pr = state.mode_machine, int(state.record["mode_pr"])
    absent = ABSENT.get(machine)
    if absent is None:
        allowed = ", ".join(map(str, ABSENT))
        raise LinkError(
            f"the robot is machine {machine} ({MACHINES.get(machine, 'unknown')}), whose joints are not the 29 of a "
            f"command: machines {allowed} are commanded; read this one's states only"
        )
    on = [i for i in absent if command.enabled[i]]
    if on:
        names = " and ".join(g1.ALL_JOINTS[i] for i in on)
        raise LinkError(
            f"a command turns on {names}, which machine {machine} ({MACHINES[machine]}) has no motor for: "
            f"set `enabled` False at {', '.join(map(str, on))}"
        )
    if pr != PITCH_ROLL:
        raise LinkError(
            f"the robot's state is of mode_pr {pr} (actuators of ankles and waist): commands are of mode_pr "
            f"{PITCH_ROLL} (pitch and roll) only; stop the program that changed it, or restart the robot"
        )
    return command.message(machine)
