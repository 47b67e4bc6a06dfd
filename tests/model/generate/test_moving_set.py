"""moving20: fixed for good, drawn as it says, and each of its scenes can be passed in time, but not heedlessly."""

import hashlib

import numpy as np
import pytest

from hotice.model import load_scene, load_scenes
from hotice.model.generate.families import MOVING, generate
from hotice.model.generate.family_names import family_of
from hotice.model.generate.moving_set import BOUNDS_M, ENTRIES, NAME, SPEEDS_M_S, draw_moving, heedless_is_hit
from hotice.model.generate.passing import UNTIL_S, check_passing
from hotice.model.shipped import SHIPPED, shipped_sets

DIGEST = "c3cd747ca3c44cabdb8b14127243fa4087eb42c88b6d2a222d400aff471d34a9"
"""Of names and contents of the files: the set is fixed for good. A changed set is another set and gets another name."""
QUICK = (0, 5, 10, 15, 16)


def test_the_set_is_fixed_and_loads_by_name():
    digest = hashlib.sha256()
    for path in sorted((SHIPPED / NAME).glob("*.json")):
        digest.update(path.name.encode() + path.read_bytes())
    assert digest.hexdigest() == DIGEST
    scenes = load_scenes([NAME])
    assert len(scenes) == len(ENTRIES) == 20 and tuple(s.name for s in scenes) == shipped_sets()[NAME]
    assert [s.name.split("_", 1)[1] for s in scenes] == [kind for kind, _ in ENTRIES]


@pytest.mark.parametrize("index", range(20))
def test_what_moves_has_the_speed_that_it_is_graded_by(index):
    scene, (kind, speed) = load_scene(shipped_sets()[NAME][index]), ENTRIES[index]
    assert (scene.start, scene.goal, scene.bounds_m) == ((0, 0, 0), (2, 0), BOUNDS_M) and speed in SPEEDS_M_S
    assert scene.moving and heedless_is_hit(scene)
    for obstacle in scene.moving:
        motion = obstacle.motion
        width = obstacle.shape.size_m[1] + 0.04 if kind == "swinging_door" else None
        fastest = motion.top_speed_m_s if width is None else motion.top_rate_rad_s * width
        assert fastest == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize("index", [pytest.param(i, marks=() if i in QUICK else pytest.mark.slow) for i in range(20)])
def test_every_scene_can_be_passed_in_time(index):
    found = check_passing(load_scene(shipped_sets()[NAME][index]))
    assert found.ok and found.arrival_s <= UNTIL_S + 0.05 and found.clearance_m >= 0.03 - 1e-9


@pytest.mark.parametrize("index", [1, 14])
def test_a_scene_is_drawn_again_as_it_is(index):
    assert draw_moving(index) == load_scene(shipped_sets()[NAME][index])


def test_families_of_moving_scenes_are_graded_by_speed_and_none_is_of_the_set():
    made = generate("moving", 10, seed=3)
    assert [s.name for s in made.scenes] == [f"{kind}_s3_{i:02d}" for i in (0, 1) for kind in MOVING]
    assert [family_of(s.name) for s in made.scenes] == [*MOVING, *MOVING]
    speeds = [max(o.motion.top_speed_m_s for o in s.moving) for s in made.scenes if "door" not in s.name]
    np.testing.assert_allclose(speeds, [0.2] * 4 + [1.2] * 4)
    assert all(heedless_is_hit(s) and check_passing(s).ok for s in made.scenes[:3])
    assert {r.reason for r in made.rejected} and all(r.scene in {s.name for s in made.scenes} for r in made.rejected)
    shipped = {load_scene(name).obstacles for name in shipped_sets()[NAME]}
    assert not shipped & {s.obstacles for s in made.scenes}
    assert made.scenes == generate("moving", 10, seed=3).scenes != generate("moving", 10, seed=4).scenes
