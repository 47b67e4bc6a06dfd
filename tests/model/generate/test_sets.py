import hashlib

import pytest

from hotice.errors import UnknownName
from hotice.model import Scene, load_scene, load_scenes
from hotice.model.generate import check_traversable
from hotice.model.generate.sets import INDOOR_LONGEST_M, LONGEST_M, SETS, draw_entry
from hotice.model.shipped import SHIPPED, shipped_scenes, shipped_sets

SIZES = {"bench20": 20, "train75": 75, "unseen50": 50}
DIGESTS = {
    "bench20": "d8511a79f531c18fbd8e908e141c725c86ea24066d4236479fe61808033a2e9f",
    "train75": "dd6f57b974e1b4167f2fdb46675540d82757d3d0172057830502af633ae20fd0",
    "unseen50": "b5d3ab8726c8ab069e02a8dd0f0057161e66f7051e776c5fc0dc122a51aeb436",
}
"""Of names and contents of the files: the sets are fixed for good. A changed set is another set and gets another
name."""


@pytest.mark.parametrize("name", SIZES)
def test_a_set_is_fixed(name):
    digest = hashlib.sha256()
    for path in sorted((SHIPPED / name).glob("*.json")):
        digest.update(path.name.encode() + path.read_bytes())
    assert digest.hexdigest() == DIGESTS[name]


@pytest.mark.parametrize("name", SIZES)
def test_a_set_loads_by_name(name):
    scenes = load_scenes([name])
    assert len(scenes) == SIZES[name] == len(SETS[name])
    assert tuple(s.name for s in scenes) == shipped_sets()[name]
    assert [s.name.split("_", 1)[1] for s in scenes] == [e.family for e in SETS[name]]
    assert load_scene(scenes[3].name) == scenes[3] == load_scenes([scenes[3].name])[0]
    assert not set(shipped_scenes()) & set(shipped_sets()[name])


def test_no_scene_is_in_two_sets():
    obstacles = [str([o.to_dict() for o in s.obstacles]) for s in load_scenes(SIZES)]
    assert len(set(obstacles)) == sum(SIZES.values())
    train, unseen = ({e.family for e in SETS[name]} for name in ("train75", "unseen50"))
    assert unseen - train == {"two_pipes", "two_steps", "s_bend", "gauntlet"}


def test_bench20_has_every_kind_and_the_papers_task():
    scenes = load_scenes(["bench20"])
    kinds = [frozenset(o.category for o in s.obstacles) for s in scenes]
    for start, kind in ((5, {"overhead"}), (10, {"ground"})):
        assert all(k == kind for k in kinds[start : start + 5])
    assert all("side" in k for k in kinds[:5]) and all(len(k) >= 2 for k in kinds[15:])
    for scene in scenes:
        assert (scene.start, scene.goal) == ((0, 0, 0), (2, 0)) and scene.bounds_m == Scene("default").bounds_m


@pytest.mark.parametrize(
    "name",
    ["bench20", pytest.param("train75", marks=pytest.mark.slow), pytest.param("unseen50", marks=pytest.mark.slow)],
)
def test_every_scene_can_be_traversed(name):
    for scene in load_scenes([name]):
        way = check_traversable(scene)
        assert way.ok and way.length_m <= (INDOOR_LONGEST_M if "indoor" in scene.name else LONGEST_M), scene.name


@pytest.mark.parametrize(
    ("name", "index"), [("bench20", 0), ("bench20", 11), ("bench20", 15), ("train75", 7), ("unseen50", 0)]
)
def test_a_file_is_what_its_entry_draws(name, index):
    assert draw_entry(name, index)[0] == load_scene(shipped_sets()[name][index])


def test_unknown_sets():
    with pytest.raises(UnknownName, match="known are bench20, train75, unseen50"):
        draw_entry("bench21", 0)
    with pytest.raises(UnknownName, match="bench20, "):
        load_scenes(["bench21"])
