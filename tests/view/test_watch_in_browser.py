"""A run that is trained, in a real browser: curves grow, each new checkpoint walks, the page is taken anew."""

import json
import re
import subprocess
import sys
import time

import pytest

pytest.importorskip("websockets")
from tools import browser, contrast  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser.found() is None, reason="needs Chromium")]
PATIENCE_S = 120.0
VERSION = "window.hotice?.page.steer.version"
TEXT = "document.getElementById('training').textContent"


@pytest.fixture(scope="module")
def page(tmp_path_factory, tiny_options):
    """Beside a training in three scenes, until the browser has gone."""
    folder = tmp_path_factory.mktemp("watched")
    scenes = ["--scenes", "beam", "gap", "pillars", "--updates", "100000", "--checkpoint-updates", "5"]
    command = [sys.executable, "-m", "hotice", "train", *scenes, *tiny_options, "--out", "run", "--view"]
    process = subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True)
    try:
        url = next(found[0] for line in process.stderr if (found := re.search(r"http://\S+", line)))
        with browser.opened(url, 1280, 800) as shown:
            yield shown
    finally:
        process.terminate()
        process.communicate()


def ask(page, script):
    """Whether an expression is true; None while the page is taken anew and has nothing to say."""
    try:
        return page.run(f"(() => {{ try {{ return Boolean({script}); }} catch {{ return null; }} }})()")
    except RuntimeError as error:
        if "navigated" not in str(error):
            raise
        return None


def wait(page, condition):
    end = time.monotonic() + PATIENCE_S
    while not ask(page, condition):
        assert time.monotonic() < end, f"never true: {condition}"
        time.sleep(0.1)


def hold(page, held):
    """Whether the page stays as it is when another checkpoint has walked."""
    wait(page, "document.getElementById('training') && window.hotice")
    wait(
        page,
        f"(document.getElementById('newest').checked === {str(held).lower()} "
        f"? document.getElementById('newest').click() : 0, "
        f"document.getElementById('newest').checked !== {str(held).lower()})",
    )


def test_each_new_checkpoint_walks_and_curves_grow(page):
    wait(page, f"{VERSION} >= 1")
    hold(page, True)
    wait(page, f"{TEXT}.includes('reward') && document.querySelectorAll('#families meter').length >= 3")
    assert len(page.run("window.hotice.page.records.map((record) => record.scene.name)")) == 3
    policies = page.run("document.getElementById('facts').textContent")
    assert re.search(r"checkpoint-\d+", policies)
    painted = (
        "(() => { const c = document.getElementById('growth'); "
        "const all = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; "
        "return all.filter((v, i) => i % 4 === 3 && v > 0).length; })()"
    )
    wait(page, f"{painted} > 50")
    page.run("document.getElementById('next').click()")
    version = page.run(VERSION)
    # held, it tells of the next one and stays
    wait(page, f"{TEXT}.includes('a newer checkpoint has walked')")
    time.sleep(2.5)
    assert page.run(VERSION) == version
    hold(page, False)
    # and the rollout that was looked at stays chosen
    wait(page, f"{VERSION} > {version} && document.getElementById('rollout').value === '1'")


def test_nothing_is_cut_off_and_whatever_can_be_used_has_a_name(page):
    wait(page, f"{VERSION} >= 1")
    hold(page, True)
    wait(page, "document.querySelectorAll('#families meter').length >= 3")
    assert contrast.faint(page) == []
    page.call("Accessibility.enable")
    used = {"button", "checkbox", "combobox", "slider", "meter", "image", "group"}
    nodes = [n for n in page.call("Accessibility.getFullAXTree")["nodes"] if n.get("role", {}).get("value") in used]
    assert len(nodes) > 15
    assert [json.dumps(n) for n in nodes if not n.get("ignored") and not n.get("name", {}).get("value")] == []
    wide = (
        "[...document.querySelectorAll('#info *')].filter((e) => e.getBoundingClientRect().right > innerWidth).length"
    )
    assert page.run(wide) == 0
    page.size(390, 844, scale=1, phone=True)
    wait(page, f"innerWidth === 390 && {wide} === 0")
    page.size(1280, 800)
    assert page.complaints == []
