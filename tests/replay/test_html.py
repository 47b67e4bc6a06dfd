import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from hotice.errors import HoticeError, OutputError
from hotice.replay import RolloutEvent, write_html
from hotice.replay.html import _quantised, _without_sign_flips

NASTY = "</script><script>alert(1)</script><!-- /*{{three}}*/ ' \" & \\u003c"


class Page(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value or "" for key, value in attrs if key in ("src", "href", "action", "data")]
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.tags and self.tags[-1] == "script":
            self.scripts[-1] += data

    def handle_endtag(self, tag):
        if tag == "script":
            self.tags.append("/script")

    @property
    def data(self):
        return json.loads(self.scripts[0])


def values(packed: dict) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["data"]), dtype="<i2") * packed["scale"]


@pytest.fixture(scope="module")
def text(record, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("html") / "replay.html"
    event = RolloutEvent(time_s=0.5, kind="fault", text=NASTY)
    second = replace(
        record,
        scene=record.scene.renamed(NASTY),
        outcome="object_collision",
        policy=NASTY,
        time_s=record.time_s + 7.0,
        events=(event, replace(event, time_s=7.5)),
    )
    write_html([record, second], path)
    return path.read_text(encoding="utf-8")


def test_page_loads_nothing(text):
    page = Page(text)
    assert page.links == []
    assert not {"link", "iframe", "img", "object", "embed", "base"} & set(page.tags)
    assert "default-src 'none'" in text
    code = re.sub(r"http://www\.w3\.org/\S+", "", "".join(page.scripts))
    assert not re.search(r"""(?:src|href)\s*=\s*["']?https?:|import\s*\(|fetch\s*\(\s*["']http|@import""", code)
    assert len(text) < 3e6


def test_page_holds_the_rollouts(text, record):
    page = Page(text)
    assert len(page.scripts) == 3 and "THREE" in page.scripts[1] and "three.js authors" in page.scripts[1]
    first, second = page.data["records"]
    assert (first["outcome"], second["outcome"]) == ("success", "object_collision")
    assert [o["type"] for o in first["scene"]["obstacles"]] == ["box", "cylinder", "capsule", "sphere", "mesh"]
    assert len(first["geoms"]) == 5
    thin = record.every(0.04)
    np.testing.assert_allclose(values(first["geom_pos"]), thin.geom_pos_W.ravel(), atol=1e-4)
    np.testing.assert_allclose(values(first["arrow_force"]), thin.arrow_force_W.ravel(), atol=1e-4)


def test_events_are_on_the_page_s_own_clock(text):
    first, second = Page(text).data["records"]
    assert first["events"] == [] and [e["time"] for e in second["events"]] == [-6.5, 0.5]
    assert {(e["kind"], e["text"]) for e in second["events"]} == {("fault", NASTY)}


def test_names_cannot_break_out_of_the_data(text):
    page = Page(text)
    assert page.data["records"][1]["scene"]["name"] == NASTY
    assert page.data["records"][1]["policy"] == NASTY
    assert "<script>alert" not in text


def test_every_part_of_the_page_that_the_viewer_asks_for_exists(text):
    viewer = Page(text).scripts[2]
    asked = set(re.findall(r"\$\(\"(\w+)\"\)", viewer))
    present = set(re.findall(r'\bid="(\w+)"', text))
    assert asked and asked <= present


def test_quantisation_is_exact_to_half_a_step():
    numbers = np.random.default_rng(0).normal(size=(50, 3))
    packed = _quantised(numbers)
    assert np.abs(values(packed) - numbers.ravel()).max() <= 0.5001 * packed["scale"]
    assert values(_quantised(np.zeros((2, 3)))).tolist() == [0.0] * 6
    assert values(_quantised(np.zeros((2, 0, 3)))).tolist() == []


def test_quaternions_do_not_jump():
    angle = np.linspace(0, 4 * np.pi, 60)
    quat = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=-1)[:, None]
    flipped = quat * np.where(np.arange(60) % 3 == 0, -1, 1)[:, None, None]
    smooth = _without_sign_flips(flipped)
    assert np.linalg.norm(np.diff(smooth, axis=0), axis=-1).max() < 0.2
    np.testing.assert_allclose(np.abs(np.sum(smooth * quat, axis=-1)), 1.0)


def test_bad_requests(record, tmp_path):
    with pytest.raises(HoticeError, match="at least one rollout"):
        write_html([], tmp_path / "replay.html")
    with pytest.raises(OutputError, match="cannot write"):
        write_html([record], tmp_path / "missing" / "replay.html")


def test_a_page_that_was_there_survives_a_failure(record, tmp_path, monkeypatch):
    path = tmp_path / "replay.html"
    path.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("hotice.files.os.replace", full)
    with pytest.raises(OutputError, match="No space left"):
        write_html([record], path)
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["replay.html"]
