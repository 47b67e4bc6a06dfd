import numpy as np
import pytest

from hotice.deploy.clock import SimulatedClock
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.rpc import Response
from hotice.deploy.switcher import (
    QUESTIONS,
    ActiveController,
    ServiceError,
    active_controller,
    leave_high_level,
    made_ours,
)
from hotice.errors import InvalidConfig


class Switcher:
    """The robot's service as far as it is known: a name until it was released `stubborn` times."""

    def __init__(self, stubborn=1, code=0, data=None):
        self.left, self.code, self.data, self.calls = stubborn, code, data, []

    def call(self, api_id, parameter, timeout_s):
        assert parameter == "{}" and timeout_s > 0.0
        self.calls.append(api_id)
        if api_id == 1003:
            self.left -= 1
        name = "ai" if self.left > 0 else ""
        data = f'{{"form":"0","name":"{name}"}}' if self.data is None else self.data
        return Response(id=1, api_id=api_id, code=self.code, data=data)


def test_which_controller_is_active():
    assert active_controller(Switcher()) == "ai" and active_controller(Switcher(stubborn=0)) == ""


@pytest.mark.parametrize("releases", [0, 1, 3])
def test_releases_until_none_is_active(releases):
    switcher = Switcher(stubborn=releases)
    assert leave_high_level(switcher, SimulatedClock(), robot_is_held=True) == releases
    assert switcher.calls == [1001] + [1003, 1001] * releases


@pytest.mark.parametrize("held", [False, None, 1])
def test_a_robot_that_is_not_held_is_not_released(held):
    switcher = Switcher()
    with pytest.raises(LinkError, match="limp"):
        leave_high_level(switcher, SimulatedClock(), robot_is_held=held)
    assert switcher.calls == []


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 0.0, -1.0, "5", None])
def test_times_that_never_end_are_refused(wrong):
    switcher = Switcher(stubborn=3)
    for call in (
        lambda: active_controller(switcher, timeout_s=wrong),
        lambda: leave_high_level(switcher, SimulatedClock(), robot_is_held=True, timeout_s=wrong),
    ):
        with pytest.raises(InvalidConfig, match="timeout_s is .*: a finite number above 0"):
            call()
    if wrong != 0.0:
        with pytest.raises(InvalidConfig, match="pause_s is .*of at least 0"):
            leave_high_level(switcher, SimulatedClock(), robot_is_held=True, pause_s=wrong)
    assert switcher.calls == []


def test_a_controller_that_stays():
    with pytest.raises(ServiceError, match="'ai' is still active after 5 s and 10 releases"):
        leave_high_level(Switcher(stubborn=99), SimulatedClock(), robot_is_held=True)


@pytest.mark.parametrize("data", ["", "ai", "[]", '{"form":"0"}', '{"name":3}', "[" * 100_000])
def test_nonsense_is_no_released_robot(data):
    """Else an answer that cannot be read would pass for "no controller active"."""
    with pytest.raises(ServiceError):
        leave_high_level(Switcher(data=data), SimulatedClock(), robot_is_held=True)


class Deaf(Switcher):
    """Does not hear the first questions."""

    def __init__(self, deaf):
        super().__init__(stubborn=0)
        self.deaf, self.waited_s = deaf, 0.0

    def call(self, api_id, parameter, timeout_s):
        if self.deaf:
            self.deaf, self.waited_s = self.deaf - 1, self.waited_s + timeout_s
            raise ServiceError("did not answer")
        return super().call(api_id, parameter, timeout_s)


def test_a_question_that_was_lost_is_asked_again():
    assert active_controller(Deaf(QUESTIONS - 1)) == ""
    switcher = Deaf(99)
    with pytest.raises(ServiceError, match="did not answer"):
        active_controller(switcher, timeout_s=5.0)
    assert switcher.waited_s == pytest.approx(5.0)


def test_a_controller_is_released_only_where_the_robot_is_held():
    switcher = Switcher(stubborn=2)
    for held in (False, None, 1):
        with pytest.raises(ActiveController, match="'ai' is active.*hang it up.*--release-held"):
            made_ours(switcher, SimulatedClock(), robot_is_held=held)
    assert 1003 not in switcher.calls
    assert "'ai' is released (2 calls)" in made_ours(switcher, SimulatedClock(), robot_is_held=True)
    assert "none of the robot's own" in made_ours(switcher, SimulatedClock(), robot_is_held=False)


def test_errors_of_the_service():
    with pytest.raises(ServiceError, match="call 1001 with error 7"):
        active_controller(Switcher(code=7))
