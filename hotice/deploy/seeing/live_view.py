"""The runner's end of the live page: hands moments over and never waits for who draws or looks."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys

import numpy as np

from hotice import checks
from hotice.checks import Range
from hotice.deploy.runner.runner import RobotRunner
from hotice.deploy.seeing.live_frames import about_run
from hotice.deploy.seeing.moments import MOMENT, moment
from hotice.errors import HoticeError
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.policy import PolicySession

PERIOD_S = 0.05
"""Least time between two frames [s]."""
WAITING = 4
"""Moments that may wait for the page's process; more are dropped."""
NICE = 10
"""Whatever commands the robot goes before the page."""
START_S, END_S = 60.0, 5.0
LOOPBACK = "127.0.0.1"


class MomentSender:
    """Sends moments to the page's process, at most 20 a second; what it is too slow for is dropped, and counted."""

    def __init__(self, to: socket.socket) -> None:
        self.dropped = 0
        self._sent_s, self._ticked_s, self._gone = -np.inf, -np.inf, False
        self._late_s = 0.0
        self._socket = to
        to.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, WAITING * MOMENT.itemsize)
        to.setblocking(False)

    def due(self, time_s: float) -> bool:
        """Whether a moment of this time would be sent [s]."""
        return not self._gone and not 0.0 <= time_s - self._sent_s < PERIOD_S - 1e-9

    def show(self, shown: np.ndarray) -> bool:
        """Hands a moment () of `hotice.deploy.seeing.moment` over; False: too early, dropped, or nobody is there."""
        time_s = float(shown["time_s"])
        if not self.due(time_s):
            return False
        try:
            self._socket.send(shown.tobytes())
        except BlockingIOError:
            self.dropped += 1
            return False
        except ConnectionError:
            self._gone = True
            return False
        self._sent_s = time_s
        return True

    def after(self, runner: RobotRunner) -> None:
        """Shows what a runner's tick made, if it is time, and how late the worst tick since was; call it after each."""
        late_s, self._ticked_s = runner.began_s - self._ticked_s - runner.period_s, runner.began_s
        self._late_s = max(self._late_s, late_s if np.isfinite(late_s) else 0.0)
        if runner.status is None or not self.due(runner.began_s):
            return
        seen = moment(runner.status, runner.estimate, time_s=runner.began_s, late_s=self._late_s, around=runner.around)
        if self.show(seen):
            self._late_s = 0.0

    def close(self) -> None:
        """Nothing is sent any more."""
        self._gone = True
        self._socket.close()


class LiveView:
    """A page in the browser, at `url`, that shows each moment it is given, at most 20 times a second. Use `with`.

    Another process, of low priority, draws and serves. Where it is slow, moments are dropped; where it has died,
    nothing happens.

    Args:
        scene, carried, policy: what is shown
        host: address to listen at: 127.0.0.1 is this machine alone; any other shows the robot to the network
        port: 0 takes any free one

    Raises:
        HoticeError: the page cannot be served; says why.
    """

    def __init__(
        self, scene: Scene, carried: CarriedObject, policy: PolicySession, *, host: str = LOOPBACK, port: int = 0
    ) -> None:
        checks.whole("port", port, Range(least=0, most=65535))
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._sender = MomentSender(ours)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "hotice.deploy.seeing.live_server", str(theirs.fileno()), host, str(port)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        # who starts it may go before all others: this must not be inherited
        os.sched_setscheduler(self._process.pid, os.SCHED_OTHER, os.sched_param(0))
        os.setpriority(os.PRIO_PROCESS, self._process.pid, NICE)
        try:
            self.url = self._started(json.dumps(about_run(scene, carried, policy)).encode())
        except BaseException:
            self.close()
            raise

    def _started(self, about: bytes) -> str:
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            self._process.stdin.write(about)
            self._process.stdin.close()
        except BrokenPipeError:
            raise HoticeError("the live page's process ended at once: see what it wrote") from None
        if not select.select([self._process.stdout], [], [], START_S)[0]:
            raise HoticeError(f"the live page's process was not ready within {START_S:g} s")
        line = self._process.stdout.readline()
        if not line:
            raise HoticeError("the live page's process ended before it was ready: see what it wrote")
        said = json.loads(line)
        if "error" in said:
            raise HoticeError(said["error"])
        return said["url"]

    @property
    def dropped(self) -> int:
        """Moments that the page's process was too slow for."""
        return self._sender.dropped

    def show(self, shown: np.ndarray) -> bool:
        """Shows a moment () of `hotice.deploy.seeing.moment`, without waiting; False: it will not be seen."""
        return self._sender.show(shown)

    def after(self, runner: RobotRunner) -> None:
        """Shows what a runner's tick made, if it is time; call it after each."""
        self._sender.after(runner)

    def close(self) -> None:
        """Ends the page and its process; a second time does nothing."""
        self._sender.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGKILL)
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
