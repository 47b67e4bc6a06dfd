"""The live view in a real browser: an obstacle is dragged, fields and ways bend, the robot finds another way."""

import contextlib
import re
import subprocess
import sys
import time

import pytest

from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.shipped import resolve_scenes

pytest.importorskip("websockets")
from tools import browser  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.skipif(browser.found() is None, reason="needs Chromium")]
PATIENCE_S = 60.0
FIRST = "window.hotice.show().obstacles[0]"


BENT = "window.ways.filter((way) => way.points.some((v, i) => i % 3 === 1 && v > 0.05)).length"
"""How many of the planned ways lead more than 5 cm to the left of the straight line."""
POST = Obstacle("post", "side", BoxShape((0.2, 0.3, 1.0)), (1.2, -0.7, 0.5))


@contextlib.contextmanager
def command(scene):
    """The page of `hotice play --view`, in the browser."""
    command = [sys.executable, "-m", "hotice", "play", "--view", "--scene", scene, "--no-perturbed"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        url = re.search(r"http://\S+", process.stdout.readline())[0]
        with browser.opened(url, 1280, 800) as shown:
            wait(shown, "document.getElementById('view').dataset.version !== undefined")
            # the camera stays where it is
            shown.run("document.getElementById('follow').click()")
            yield shown
    finally:
        process.terminate()
        process.communicate()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    file = tmp_path_factory.mktemp("scene") / "post.json"
    Scene("post", obstacles=(POST,)).save(file)
    with command(str(file)) as shown:
        yield shown


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


def place(page):
    return page.run(f"{FIRST}.position.toArray()")


def push_button(page, name):
    page.run(f"document.getElementById('{name}').click()")


def pause(page, on):
    """Clicks until the page says so."""
    button = "document.getElementById('pause')"
    page.run(f"if ({button}.ariaPressed !== '{str(on).lower()}') {button}.click()")
    wait(page, f"{button}.ariaPressed === '{str(on).lower()}'")


def test_a_dragged_obstacle_bends_field_and_way_and_the_robot_arrives(page):
    """While time stands still for the robot, so that a slow machine sees the same; then it walks round the post."""
    page.run("window.hotice.listen((now) => { window.ways = now.ways; })")
    pause(page, True)
    push_button(page, "restart")
    wait(page, "document.getElementById('view').dataset.time === '0' && window.ways.length === 3")
    page.run("document.querySelector('[data-view=top]').click()")
    page.drawn()
    before, version = place(page), int(data(page, "version"))
    assert page.run(BENT) == 0
    # taken at its top, which is what is seen from above
    page.drag(on_screen(page, [before[0], before[1], 1.0]), on_screen(page, [before[0], -0.05, 1.0]))
    wait(page, f"{FIRST}.position.y > -0.07")
    wait(page, f"Number(document.getElementById('view').dataset.version) > {version}")
    wait(page, "Number(document.getElementById('view').dataset.behind) === 0 && window.ways.length === 3")
    # the head's goes over the post; pelvis and object go round it
    wait(page, f"{BENT} === 2")
    pause(page, False)
    wait(page, "document.getElementById('view').dataset.mode === 'at the goal'")
    facts = page.run("document.getElementById('facts').textContent")
    assert "Touches0" in facts and "as the obstacles are" in facts


def pushes(page):
    """Velocities [m/s] of the pushes that are told."""
    told = page.run("[...document.querySelectorAll('#events li, #events > *')].map((event) => event.textContent)")
    return [
        tuple(map(float, found)) for text in told for found in re.findall(r"pushed by (-?\d\.\d+), (-?\d\.\d+)", text)
    ]


def lifted(place):
    """The top of the object at a place, which is what is seen of it from above."""
    return [place[0], place[1], place[2] + 0.12]


def test_the_robot_is_pushed_by_the_mouse(page):
    """A drag by 0.4 m to the left is 0.4 m/s to the left, and felt; a click pushes by 0.4 m/s away from who looks."""
    pause(page, False)
    wait(page, "document.getElementById('view').dataset.mode === 'at the goal'")
    page.run("document.querySelector('[data-view=top]').click()")
    page.drawn()
    record = "window.hotice.page.records[0]"
    page.run(f"window.sideways = []; window.hotice.listen(() => window.sideways.push({record}.root_pos[1]))")
    held, before = page.run(f"Array.from({record}.object_pos)"), len(pushes(page))
    to = [held[0], held[1] + 0.4, held[2]]
    page.drag(on_screen(page, lifted(held)), on_screen(page, lifted(to)))
    wait(page, "document.getElementById('events').textContent.includes('pushed by')")
    (x, y) = pushes(page)[before]
    assert abs(x) < 0.06 and abs(y - 0.4) < 0.06
    # a step aside of more than its sway at the goal
    wait(page, "Math.max(...window.sideways) - window.sideways[0] > 0.03")
    page.run("document.querySelector('[data-view=angle]').click()")
    page.drawn()
    away = page.run("window.hotice.camera.getWorldDirection(new THREE.Vector3()).setZ(0).normalize().toArray()")
    here = on_screen(page, page.run(f"Array.from({record}.object_pos)"))
    page.drag(here, here, steps=1)
    end = time.monotonic() + PATIENCE_S
    while len(pushes(page)) == before + 1:
        assert time.monotonic() < end, "the click pushed nothing"
        time.sleep(0.02)
    (x, y) = pushes(page)[before + 1]
    assert abs(x - 0.4 * away[0]) < 0.02 and abs(y - 0.4 * away[1]) < 0.02


def test_a_refused_push_and_a_refused_object_are_told(page):
    push_button(page, "restart")
    pause(page, True)
    page.run("document.getElementById('what').value = ''; document.querySelector('[data-go=away]').click()")
    wait(page, "document.getElementById('events').textContent.includes('time stands still')")
    page.run("document.getElementById('mass').value = 99; document.getElementById('take').click()")
    wait(page, "document.getElementById('told').textContent.includes('mass of the object is 99')")
    pause(page, False)


def test_another_object_is_taken_and_shown(page):
    script = "[...document.querySelectorAll('#sizes input')].forEach((input, i) => { input.value = [25, 35, 20][i]; });"
    page.run(f"{script} document.getElementById('mass').value = 2; document.getElementById('take').click()")
    shape = "window.hotice.show().geoms.find((mesh, i) => window.hotice.page.records[0].geoms[i].object).geometry"
    wait(page, f"{shape}.parameters.width === 0.25 && {shape}.parameters.height === 0.35")
    assert "25 × 35 × 20 cm, 2.00 kg" in page.run("document.getElementById('facts').textContent")


def test_whatever_can_be_used_has_a_name(page):
    page.call("Accessibility.enable")
    used = {"button", "checkbox", "combobox", "slider", "spinbutton", "link", "image"}
    nodes = [n for n in page.call("Accessibility.getFullAXTree")["nodes"] if n.get("role", {}).get("value") in used]
    assert len(nodes) > 25
    assert [n for n in nodes if not n.get("ignored") and not n.get("name", {}).get("value")] == []


def test_panels_fold_on_a_phone_and_nothing_is_cut_off(page):
    page.size(390, 844, scale=1, phone=True)
    wide = (
        "[...document.querySelectorAll('#steer *')].filter((e) => e.getBoundingClientRect().right > innerWidth).length"
    )
    wait(page, f"innerWidth === 390 && {wide} === 0")
    push_button(page, "fold")
    assert page.run("getComputedStyle(document.getElementById('choices')).display") == "none"
    push_button(page, "fold")
    page.size(1280, 800)


def test_the_page_complains_of_nothing(page):
    page.drawn()
    # the refused order alone: 400
    assert [text for text in page.complaints if "400" not in text] == []


def test_a_person_walks_by_while_a_wall_is_dragged_and_begins_anew_with_the_robot():
    """At 0.2 m/s along the corridor against the robot, from x = 1.61 m."""
    (scene,) = resolve_scenes(["moving20/17_oncoming"])
    wall, _, legs, trunk = (f"window.hotice.show().obstacles[{i}].position" for i in range(4))
    with command(scene.name) as page:
        wait(page, f"{legs}.x < 1.5 && {trunk}.x < 1.5")
        pause(page, True)
        time_s, x = float(data(page, "time")), page.run(f"{legs}.x")
        assert abs(x - scene.obstacles[2].at(time_s).position_m[0]) < 1e-3 and scene.obstacles[2].name == "person_legs"
        page.run("document.querySelector('[data-view=top]').click()")
        page.drawn()
        # a page that is drawn anew between frames leaves the person there
        assert page.run(f"{legs}.x") == x
        before = page.run(f"{wall}.toArray()")
        pause(page, False)
        page.drag(on_screen(page, [*before[:2], 1.5]), on_screen(page, [before[0], before[1] - 0.1, 1.5]))
        wait(page, f"Math.abs({wall}.y - {before[1] - 0.1}) < 0.02")
        wait(page, f"{legs}.x < {x - 0.05} && Math.abs({trunk}.x - {legs}.x) < 1e-6")
        pause(page, True)
        push_button(page, "restart")
        wait(page, "document.getElementById('view').dataset.time === '0'")
        assert abs(page.run(f"{legs}.x") - scene.obstacles[2].position_m[0]) < 1e-3
        assert abs(page.run(f"{wall}.y") - before[1] + 0.1) < 0.02 and page.complaints == []
