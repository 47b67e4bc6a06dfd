"""The guard's program before a robot whose own controller is active: refused, or released where the robot is held."""

import json
import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from hotice.commands.deploy.child import Child
from hotice.deploy.guard.scheduling import give_way, take_precedence
from hotice.deploy.programs.options import GuardOptions
from hotice.deploy.switcher import CHECK, RELEASE, SERVICE

pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")
DOMAIN = 24 + 8 * (os.getpid() % 25)
LONG_S = 60.0


def started(folder, node, server, **options):
    """What a guard said until it was ready or ended, its last words, and how its threads were scheduled when ready."""
    name = f"leaves-{os.getpid()}"
    about = GuardOptions(slot=name, domain=DOMAIN, interface="lo", dry_run=False, log=str(folder), **options)
    guard, end_s, said, threads = Child("guard", about.text()), time.monotonic() + LONG_S, [], {}
    try:
        while guard.status is None and not any("ready" in each for each in said):
            assert time.monotonic() < end_s
            server.serve()
            said += guard.said()
            time.sleep(0.01)
        if guard.status is None:
            for task in Path(f"/proc/{guard.pid}/task").iterdir():
                threads[(task / "comm").read_text().strip()] = os.sched_getscheduler(int(task.name))
    finally:
        guard.end(LONG_S, kill=True)
    return said, guard.last_words, threads


def allowed():
    """How this system lets a guard be scheduled."""
    first = take_precedence()
    if first:
        give_way()
    return os.SCHED_FIFO if first else os.SCHED_OTHER


def test_an_active_controller_is_refused_and_released_only_if_held(tmp_path):
    from hotice.deploy.dds.node import DdsNode
    from hotice.deploy.dds.service import DdsServer

    robot = SimpleNamespace(controller="ai", asked=[])

    def answer(api_id, parameter):
        robot.asked.append(api_id)
        if api_id == RELEASE:
            robot.controller = ""
        return 0, json.dumps({"form": "0", "name": robot.controller})

    with DdsNode(domain=DOMAIN, interface="lo") as node:
        server = DdsServer(node, SERVICE, answer)
        said, words, _ = started(tmp_path / "a", node, server, has_controller=True)
        assert not any("ready" in each for each in said) and "'ai' is active" in words and "--release-held" in words
        assert robot.asked == [CHECK]
        said, _, threads = started(tmp_path / "b", node, server, has_controller=True, release_held=True)
        assert any("is released" in each.get("text", "") for each in said) and any("ready" in each for each in said)
        assert RELEASE in robot.asked and robot.controller == ""
        # what receives states goes before other programs as the guard itself does, where that is allowed
        received = {name: how for name, how in threads.items() if name in ("recv", "tev") or name.startswith("dq.")}
        assert len(received) >= 3 and set(received.values()) == {allowed()}, threads
        robot.asked.clear()
        said, words, _ = started(tmp_path / "c", node, server, has_controller=True)
        assert any("ready" in each for each in said) and robot.asked == [CHECK], words
        server.close()
