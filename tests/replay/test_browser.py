"""The replay page in a real browser, at the sizes of a desk and a phone."""

import dataclasses

import pytest

from hotice.replay import write_html
from hotice.replay.events import RolloutEvent

pytest.importorskip("websockets")
from tools import browser, contrast  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser.found() is None, reason="needs Chromium")]


@pytest.fixture(scope="module")
def page(record, tmp_path_factory):
    touch = RolloutEvent(
        time_s=float(record.time_s[0]) + 0.5, kind="touch", text="trunk touches beam", solids=("trunk", "beam")
    )
    frames = len(record.time_s)
    second = dataclasses.replace(record, events=(touch,), clearance_m=[0.3] * frames)
    file = write_html([record, second], tmp_path_factory.mktemp("page") / "replay.html")
    with browser.opened(f"{file.as_uri()}#rollout=2&time=0.6&pause", 1280, 800) as shown:
        yield shown


def clock(page):
    page.drawn()
    return float(page.run("document.getElementById('clock').textContent").split()[0])


def test_the_address_opens_a_rollout_at_an_instant_and_is_followed(page):
    assert page.run("document.getElementById('rollout').value") == "1" and clock(page) == pytest.approx(0.6)
    page.run("location.hash = 'rollout=1&time=0.2&pause'")
    assert clock(page) == pytest.approx(0.2) and page.run("document.getElementById('rollout').value") == "0"
    page.run("location.hash = 'rollout=2&time=0.6&pause'")
    assert clock(page) == pytest.approx(0.6)


def test_touches_are_listed_and_ticked_and_values_told(page):
    assert page.run("[...document.querySelectorAll('#events li')].map((li) => li.textContent)") == [
        "0.50 s  trunk touches beam"
    ]
    assert page.run("document.querySelector('#marks i').className") == "touch"
    assert "clearance 0.300 m" in page.run("document.getElementById('values').textContent")


def test_keys_work_while_a_checkbox_has_the_focus(page):
    page.run("document.getElementById('trail').focus()")
    before = clock(page)
    page.key("ArrowRight")
    after = clock(page)
    assert after > before
    page.key(",", "Comma")
    assert clock(page) == pytest.approx(before, abs=0.02)
    page.key("Home")
    assert clock(page) == 0.0
    page.run("document.activeElement.blur()")
    page.run("location.hash = 'rollout=2&time=0.6&pause&x'")


def test_nothing_is_drawn_while_nothing_changes(page):
    """Once the camera has come to rest."""
    calls = "(() => { const draw = WebGL2RenderingContext.prototype; window.drawn = 0; const old = draw.clear; "
    page.run(calls + "draw.clear = function (...a) { window.drawn++; return old.apply(this, a); }; })()")
    for _ in range(10):
        page.drawn()
    page.run("window.drawn = 0")
    for _ in range(5):
        page.drawn()
    assert page.run("window.drawn") == 0
    page.key(".", "Period")
    page.drawn()
    assert page.run("window.drawn") > 0


def test_whatever_can_be_used_has_a_name(page):
    page.call("Accessibility.enable")
    used = {"button", "checkbox", "combobox", "slider", "link", "image"}
    nodes = [n for n in page.call("Accessibility.getFullAXTree")["nodes"] if n.get("role", {}).get("value") in used]
    assert len(nodes) > 12
    assert [n for n in nodes if not n.get("ignored") and not n.get("name", {}).get("value")] == []


def test_no_text_is_faint(page):
    assert len(contrast.texts(page)) > 20 and contrast.faint(page) == []
    # the least that is asked for is a grey of #767676 on white, and one step lighter is too light
    for grey, told in (("#767676", False), ("#787878", True)):
        style = f"position: fixed; top: 0; color: {grey}; background: white"
        page.run(f"document.body.insertAdjacentHTML('beforeend', '<p id=grey style=\"{style}\">words</p>')")
        assert bool(contrast.faint(page)) == told
        page.run("document.getElementById('grey').remove()")


def test_panels_fold_on_a_phone(page):
    page.size(390, 844, scale=2, phone=True)
    page.drawn()
    shown = "getComputedStyle(document.getElementById('options')).display"
    assert page.run(f"{shown}") == "grid"
    page.run("document.getElementById('fold').click()")
    assert page.run(shown) == "none" and page.run("document.getElementById('fold').ariaExpanded") == "false"
    page.run("document.getElementById('fold').click()")
    assert page.run(shown) == "grid"
    page.size(1280, 800)


def test_the_page_complains_of_nothing(page):
    page.drawn()
    assert page.complaints == []
