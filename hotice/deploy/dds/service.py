"""Calls to the robot's services over DDS: the caller, and the answering end for simulated robots."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import TypeVar

from hotice import checks
from hotice.deploy.clock import Clock, MonotonicClock
from hotice.deploy.dds.idl_types import request_type, response_type
from hotice.deploy.dds.node import DdsNode
from hotice.deploy.dds.ports import Reader, Writer
from hotice.deploy.messages.invalid import InvalidMessage
from hotice.deploy.messages.rpc import Request, Response
from hotice.deploy.switcher import ServiceError

T = TypeVar("T")
POLL_S = 0.002
DEPTH = 16


def topics(service: str) -> tuple[str, str]:
    """Topics of the requests to a service and of its answers."""
    return f"rt/api/{service}/request", f"rt/api/{service}/response"


class DdsService:
    """Calls one service, one call at a time, see `Service`."""

    def __init__(self, node: DdsNode, service: str, clock: Clock | None = None) -> None:
        self._clock = clock or MonotonicClock()
        self._name = service
        asked, answered = topics(service)
        self._requests = Writer(node, asked, request_type())
        self._answers = Reader(node, answered, response_type(), depth=DEPTH)
        self._ids = count(int(self._clock.now() * 1e9))

    def call(self, api_id: int, parameter: str, timeout_s: float) -> Response:
        """The answer to this very call.

        Raises:
            ServiceError: nobody serves, or nobody answers within `timeout_s` [s]
            InvalidConfig: `timeout_s` is not a number above 0
        """
        end_s = self._clock.now() + checks.number("timeout_s", timeout_s, checks.POSITIVE)
        while not (self._requests.readers and self._answers.writers):
            if self._clock.now() >= end_s:
                raise ServiceError(f"nobody serves {self._name!r} on this interface and domain ({timeout_s:g} s)")
            self._clock.sleep(POLL_S)
        request = Request(id=next(self._ids), api_id=api_id, parameter=parameter)
        self._requests.write(request.encode())
        while True:
            for answer in _opened(Response.decode, self._answers):
                if (answer.id, answer.api_id) == (request.id, api_id):
                    return answer
            if self._clock.now() >= end_s:
                raise ServiceError(f"{self._name!r} did not answer call {api_id} within {timeout_s:g} s")
            self._clock.sleep(POLL_S)

    def close(self) -> None:
        self._requests.close()
        self._answers.close()


class DdsServer:
    """Answers calls to one service: `answer(api_id, parameter)` gives code and data."""

    def __init__(self, node: DdsNode, service: str, answer: Callable[[int, str], tuple[int, str]]) -> None:
        asked, answered = topics(service)
        self._answer = answer
        self._requests = Reader(node, asked, request_type(), depth=DEPTH)
        self._answers = Writer(node, answered, response_type())

    def serve(self) -> int:
        """Answers what was asked since the last call, without waiting; how many calls that were."""
        requests = _opened(Request.decode, self._requests)
        for request in requests:
            code, data = self._answer(request.api_id, request.parameter)
            self._answers.write(Response(id=request.id, api_id=request.api_id, code=code, data=data).encode())
        return len(requests)

    def close(self) -> None:
        self._answers.close()
        self._requests.close()


def _opened(decode: Callable[[bytes], T], reader: Reader) -> list[T]:
    opened = []
    for data in reader.take():
        try:
            opened.append(decode(data))
        except InvalidMessage:
            # whoever sent it gets no answer, as if it had been lost; a caller then reports its timeout
            continue
    return opened
