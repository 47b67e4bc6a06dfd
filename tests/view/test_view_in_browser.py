"""The live view in a real browser: an obstacle is dragged, fields and ways bend, the robot finds another way."""

import re
import subprocess
import sys
import time

import pytest

pytest.importorskip("websockets")
from tools import browser  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser.found() is None, reason="needs Chromium")]
PATIENCE_S = 120.0
FIRST = "window.hotice.show().obstacles[0]"


@pytest.fixture(scope="module")
def page():
    command = [sys.executable, "-m", "hotice", "play", "--view", "--scene", "gap", "--no-perturbed"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = re.search(r"http://\S+", process.stdout.readline())[0]
        with browser.opened(url, 1280, 800) as shown:
            wait(shown, "document.getElementById('view').dataset.version !== undefined")
            yield shown
    finally:
        process.terminate()
        process.communicate()


def wait(page, condition):
    end = time.monotonic() + PATIENCE_S
    while not page.run(condition):
        assert time.monotonic() < end, f"never true: {condition}"
        time.sleep(0.02)


def data(page, name):
    return page.run(f"document.getElementById('view').dataset.{name}")


def on_screen(page, point):
    """Where a point (x, y, z) of the world is seen [px]."""
    script = (
        f"(() => {{ const p = new THREE.Vector3({', '.join(map(str, point))}).project(window.hotice.camera); "
        "return [(p.x + 1) / 2 * innerWidth, (1 - p.y) / 2 * innerHeight]; })()"
    )
    return page.run(script)
