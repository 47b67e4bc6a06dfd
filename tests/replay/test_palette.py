import re
from pathlib import Path

import hotice.replay
import hotice.view
from hotice.learn.train import ways_picture
from hotice.replay import palette
from hotice.replay.stage_model import SUN

VIEWER = (Path(hotice.replay.__file__).parent / "viewer.js").read_text()
STYLE = (Path(hotice.replay.__file__).parent / "viewer.css").read_text()
STEER = (Path(hotice.view.__file__).parent / "steer.js").read_text()


def number(color):
    return "0x" + color.removeprefix("#")


def test_the_page_repeats_the_palette():
    colors = {**palette.CATEGORY_COLORS, "other": palette.OTHER_COLOR}
    assert "const COLORS = { " + ", ".join(f"{name}: {number(color)}" for name, color in colors.items()) in VIEWER
    assert f"[SGF, OGF, TOUCHED] = [{number(palette.SGF_COLOR)}, {number(palette.OGF_COLOR)}," in VIEWER
    assert f"{{ sgf: {number(palette.SGF_COLOR)}, ogf: {number(palette.OGF_COLOR)} }}" in STEER
    for color in (palette.SKY, palette.FLOOR, palette.TILE_LINES, palette.GOAL_COLOR, palette.ROOT_COLOR):
        assert number(color) in VIEWER
    assert number(palette.OBJECT_COLOR) in VIEWER
    for name, color in {
        "ink": palette.INK,
        "sgf": palette.SGF_COLOR,
        "ogf": palette.OGF_COLOR,
        "good": palette.OUTCOME_COLORS["success"],
        "bad": palette.FAILURE_COLOR,
    }.items():
        assert re.search(rf"--{name}: {color};", STYLE), name


def test_the_page_repeats_camera_haze_and_sun():
    assert f"angle: {list(palette.FROM)}" in VIEWER
    assert f"PerspectiveCamera({palette.FIELD_OF_VIEW_DEG:g}, " in VIEWER
    assert "Fog({}, {:g}, {:g})".format(number(palette.SKY), *palette.HAZE_M) in VIEWER
    assert f"checked ? {palette.FAR_M} :" in VIEWER and f"checked ? {palette.AHEAD_M} : 0" in VIEWER
    assert f"root[1], {palette.HEIGHT_M})" in VIEWER
    assert f"sun.position.set(root[0] - {-SUN[0]}, root[1] - {-SUN[1]}, {SUN[2]})" in VIEWER


def test_pictures_of_training_have_its_colours():
    assert ways_picture.COLORS["success"] == palette.OUTCOME_COLORS["success"]
    assert ways_picture.COLORS["timeout"] == palette.OUTCOME_COLORS["timeout"]
    assert ways_picture.FAILURE == palette.FAILURE_COLOR
