"""The guard's program before a robot whose own controller is active: refused, or released where the robot is held."""

import json
import os
import time
from types import SimpleNamespace

import pytest

from hotice.commands.deploy.child import Child
from hotice.deploy.programs.options import GuardOptions
from hotice.deploy.switcher import CHECK, RELEASE, SERVICE

pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")
DOMAIN = 24 + 8 * (os.getpid() % 25)
LONG_S = 60.0


def started(folder, node, server, **options):
    """What a guard said until it was ready or ended, and its last words."""
    name = f"leaves-{os.getpid()}"
    about = GuardOptions(slot=name, domain=DOMAIN, interface="lo", dry_run=False, log=str(folder), **options)
    guard, end_s, said = Child("guard", about.text()), time.monotonic() + LONG_S, []
    try:
        while guard.status is None and not any("ready" in each for each in said):
            assert time.monotonic() < end_s
            server.serve()
            said += guard.said()
            time.sleep(0.01)
    finally:
        guard.end(LONG_S, kill=True)
    return said, guard.last_words


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
        said, words = started(tmp_path / "a", node, server, has_controller=True)
        assert not any("ready" in each for each in said) and "'ai' is active" in words and "--release-held" in words
        assert robot.asked == [CHECK]
        said, _ = started(tmp_path / "b", node, server, has_controller=True, release_held=True)
        assert any("is released" in each.get("text", "") for each in said) and any("ready" in each for each in said)
        assert RELEASE in robot.asked and robot.controller == ""
        robot.asked.clear()
        said, words = started(tmp_path / "c", node, server, has_controller=True)
        assert any("ready" in each for each in said) and robot.asked == [CHECK], words
        server.close()
