"""Leaving the robot's own controller, so that it listens to ours: calls to its motion switcher.

Releasing makes the robot limp at once, wherever it stands. What the robot does when it is selected again is as bad, so
that there is no call for it here; the maker's app or a restart brings the robot's own controller back.
"""

from __future__ import annotations

from typing import Protocol

from hotice import checks
from hotice.deploy.clock import Clock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.rpc import Response
from hotice.documents import parse_json

SERVICE = "motion_switcher"
CHECK, RELEASE = 1001, 1003
TIMEOUT_S = 5.0
QUESTIONS = 4


class ServiceError(LinkError):
    """A call to the robot that was not answered, or answered with an error or nonsense."""


class ActiveController(LinkError):
    """The robot's own controller commands its motors."""


class Service(Protocol):
    """Calls to one of the robot's services."""

    def call(self, api_id: int, parameter: str, timeout_s: float) -> Response:
        """The answer, whatever its code. Raises `ServiceError` after `timeout_s` [s] without one."""
        ...


def active_controller(service: Service, *, timeout_s: float = TIMEOUT_S) -> str:
    """Name of the robot's own controller that commands the motors, "" if none does.

    Asked up to `QUESTIONS` times: the first question may be lost while both sides are getting to know each other.

    Raises:
        ServiceError: no answer within `timeout_s` [s], or nonsense
        InvalidConfig: `timeout_s` is not a number above 0
    """
    each_s = checks.number("timeout_s", timeout_s, checks.POSITIVE) / QUESTIONS
    for left in reversed(range(QUESTIONS)):
        try:
            answer = service.call(CHECK, "{}", each_s)
            break
        except ServiceError:
            if not left:
                raise
    _check_code(answer, CHECK)
    data = parse_json(f"the motion switcher answered {answer.data[:80]!r}, which", answer.data, ServiceError)
    name = data.get("name") if isinstance(data, dict) else None
    if not isinstance(name, str):
        raise ServiceError(f"the motion switcher answered {answer.data[:80]!r}: an object with a text 'name' is needed")
    return name


def leave_high_level(
    service: Service, clock: Clock, *, robot_is_held: bool, timeout_s: float = TIMEOUT_S, pause_s: float = 0.5
) -> int:
    """Releases the robot's own controllers until none is active; how many calls that took.

    Args:
        service: the motion switcher
        robot_is_held: somebody has made sure that it hangs or sits: it goes limp at once
        clock: for the pause after a release and the timeout
        timeout_s: for each check, and until the last release [s]
        pause_s: after each release [s]

    Raises:
        LinkError: the robot is not held
        ServiceError: no answer, or a controller still active after `timeout_s`
        InvalidConfig: `timeout_s` is not a number above 0, or `pause_s` none of at least 0
    """
    if robot_is_held is not True:
        raise LinkError("releasing the robot's own controller makes it limp at once: hang or seat it first")
    timeout_s = checks.number("timeout_s", timeout_s, checks.POSITIVE)
    pause_s = checks.number("pause_s", pause_s, checks.NOT_NEGATIVE)
    end_s, calls = clock.now() + timeout_s, 0
    while name := active_controller(service, timeout_s=timeout_s):
        left_s = end_s - clock.now()
        if left_s <= 0.0:
            raise ServiceError(
                f"the robot's controller {name!r} is still active after {timeout_s:g} s and {calls} releases"
            )
        _check_code(service.call(RELEASE, "{}", left_s), RELEASE)
        calls += 1
        clock.sleep(pause_s)
    return calls


def made_ours(service: Service, clock: Clock, *, robot_is_held: bool) -> str:
    """Makes sure that none of the robot's own controllers commands it, and says in words how that is.

    One that is active is released only if the robot is held, see `leave_high_level`.

    Raises:
        ActiveController: one is active, and the robot is not said to be held
        ServiceError: no answer, or a controller that stays
    """
    name = active_controller(service)
    if not name:
        return "none of the robot's own controllers is active"
    if robot_is_held is not True:
        raise ActiveController(
            f"the robot's own controller {name!r} is active and would command beside us. Releasing it makes the robot "
            "limp at once: hang it up or seat it, keep clear, and start again with --release-held; or release it by "
            "its gamepad (L2+R2) or app first, held as well"
        )
    calls = leave_high_level(service, clock, robot_is_held=True)
    return f"the robot's own controller {name!r} is released ({calls} calls): the robot is limp"


def _check_code(answer: Response, api_id: int) -> None:
    if answer.code != 0:
        raise ServiceError(f"the motion switcher answered call {api_id} with error {answer.code}: 0 is success")
