"""Conditions for the two steps towards motion: from off to damping, and from damping to the posture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from hotice.deploy.guard.config import GuardConfig
from hotice.deploy.guard.faults import hot
from hotice.deploy.guard.measured import Measured
from hotice.deploy.guard.targets import Targets
from hotice.deploy.messages.hg import ABSENT, JOINTS, MACHINES, PITCH_ROLL
from hotice.model import g1


def against_damping(
    measured: Measured, config: GuardConfig, *, now_s: float, alone_s: float, charge: float | None, gamepad: bool
) -> Iterator[str]:
    """Why nothing may be sent yet, one sentence each; nothing if all is well.

    Args:
        measured: the states; config: needs and limits; now_s: [s]
        alone_s: for how long nobody else has been heard to command [s]
        charge: of the battery [percent], None if it is not known
        gamepad: whether there is one
    """
    limits = config.limits
    if measured.newest is None or measured.age_s(now_s) > limits.state_warn_s:
        yield f"no state within {limits.state_warn_s:g} s: look at cable, interface and domain"
        return
    if measured.refused_in_a_row:
        yield f"{measured.refused_in_a_row} damaged or impossible states in a row"
    state = measured.newest.record
    machine, motors = int(state["mode_machine"]), state["motor_state"][JOINTS]
    if machine not in ABSENT:
        yield f"machine {machine} ({MACHINES.get(machine, 'unknown')}) is not commanded"
    elif config.waist_needed and ABSENT[machine]:
        yield f"machine {machine} has a locked waist, which the policy moves"
    if int(state["mode_pr"]) != PITCH_ROLL:
        yield f"mode_pr is {state['mode_pr']}: {PITCH_ROLL} is needed"
    if alone_s < limits.alone_s:
        yield f"somebody else may be commanding: {limits.alone_s:g} s of silence are needed"
    if charge is None and config.battery_needed:
        yield "the battery's charge is not known"
    elif charge is not None and charge < limits.battery_start_percent:
        yield f"the battery has {charge:g} %: {limits.battery_start_percent:g} % are needed"
    if (motors["motorstate"] != 0).any():
        i = int(np.argmax(motors["motorstate"] != 0))
        yield f"{g1.ALL_JOINTS[i]} reports error {int(motors['motorstate'][i]):#x}"
    if hot(motors["temperature"], limits):
        i = int(np.argmax((motors["temperature"] > (limits.casing_c, limits.winding_c)).any(axis=1)))
        casing, winding = motors["temperature"][i].tolist()
        yield f"{g1.ALL_JOINTS[i]} is hot: casing {casing} °C, winding {winding} °C"
    if config.gamepad_needed and not gamepad:
        yield "there is no gamepad: switch it on"


def against_posture(targets: Targets, config: GuardConfig, now_s: float) -> Iterator[str]:
    """Why a robot that brakes may not be moved yet: the runner gives no posture, or would compile on the way."""
    newest = targets.newest
    if newest is None or targets.age_s(now_s) > config.limits.target_repeat_s:
        yield f"no fresh targets of the runner{f': {targets.why}' if targets.why else ''}"
    elif not newest["warm"]:
        yield "the runner is not warm yet"


def against_driving(targets: Targets, posture: np.ndarray, config: GuardConfig) -> Iterator[str]:
    """Why motors that hold the posture (29,) [rad] may not follow the runner yet: its targets are elsewhere."""
    if targets.newest is None:
        yield "no targets of the runner"
        return
    apart = np.abs(targets.newest["q"] - posture)
    if (apart > config.limits.step_rad).any():
        i = int(np.argmax(apart))
        yield f"the runner's {g1.ALL_JOINTS[i]} is {apart[i]:.2g} rad away from the posture"
