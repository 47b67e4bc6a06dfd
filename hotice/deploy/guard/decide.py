"""The guard's decision: which mode follows from faults, wishes and what the runner says. Pure."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from hotice.deploy.guard.faults import Cause, Finding, Reaction
from hotice.deploy.guard.modes import DRIVEN, Mode, Request, wished

MOVING = (Mode.PICK_UP, Mode.CARRY)
"""Modes that end when the robot is to stand still."""


class Decision(NamedTuple):
    """The mode that follows, and why; `refused`: a wish that was not granted."""

    mode: Mode
    cause: Cause
    text: str
    refused: str = ""


def decide(
    mode: Mode,
    found: Sequence[Finding],
    wishes: Collection[Request],
    *,
    done: bool = False,
    posture_over: bool = False,
    against: Collection[str] = (),
) -> Decision:
    """The mode that follows.

    Args:
        mode: the present one; found: faults that are there, worst first; wishes: of the operator
        done: the runner says that what the mode is for is done
        posture_over: the way to the posture is over
        against: what stands against the wish that is granted next, one sentence each
    """
    worst = found[0] if found else Finding(Cause.NONE, Reaction.NONE, "")
    if mode is not Mode.OFF and Request.STOP in wishes:
        return Decision(Mode.DAMPING, Cause.OPERATOR, "stopped by the operator")
    if mode not in (Mode.OFF, Mode.DAMPING) and worst.reaction is Reaction.DAMPING:
        return Decision(Mode.DAMPING, worst.cause, str(worst))
    if worst.reaction is Reaction.LOWER and mode in (*MOVING, Mode.HOLD):
        return Decision(Mode.LOWER, worst.cause, str(worst))
    if worst.reaction >= Reaction.HOLD and mode in MOVING:
        return Decision(Mode.HOLD, worst.cause, str(worst))
    asked = [request for request in wishes if wished(mode, request) is not mode]
    if asked:
        return _granted(mode, min(asked, key=list(Request).index), worst, list(against))
    if mode is Mode.CARRY and done:
        return Decision(Mode.HOLD, Cause.DONE, "the goal is reached")
    if mode is Mode.POSTURE and posture_over:
        return Decision(Mode.READY, Cause.DONE, "the posture is reached")
    return Decision(mode, Cause.NONE, "")


def _granted(mode: Mode, asked: Request, worst: Finding, reasons: list[str]) -> Decision:
    following = wished(mode, asked)
    # from OFF the conditions of entry say all that these would
    if (mode is Mode.DAMPING and worst.reaction is Reaction.DAMPING) or (
        following in MOVING and worst.reaction >= Reaction.HOLD
    ):
        reasons.insert(0, str(worst))
    if reasons:
        return Decision(mode, Cause.NONE, "", f"{asked.value} is refused: {'; '.join(reasons)}")
    return Decision(following, Cause.OPERATOR, f"{asked.value}, asked by the operator")


def needs_runner(mode: Mode) -> bool:
    """Whether the runner's silence is a fault in this mode: as soon as motors hold."""
    return mode in (Mode.POSTURE, Mode.READY, *DRIVEN)
