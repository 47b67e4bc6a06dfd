import numpy as np
import pytest

from hotice.control.walk import WalkConfig
from hotice.control.walk.arms import level_arms
from hotice.control.walk.body import body_spheres
from hotice.control.walk.footsteps import foot_place, plan_footsteps
from hotice.control.walk.ground import SOLE_BACK_M, SOLE_FRONT_M, Ground
from hotice.control.walk.path import plan_path, streamline
from hotice.control.walk.plan import plan_walk
from hotice.control.walk.profile import SLOPE, plan_profile, postures
from hotice.errors import InvalidConfig, UnreachableGoal
from hotice.fields import build_hod_pf
from hotice.model import Box, Scene
from hotice.model.carry import solve_carry

CONFIG = WalkConfig()
STATE = solve_carry(Box((0.30, 0.30, 0.30), 1.5))


def scene(*obstacles: tuple[str, str, tuple, tuple]) -> Scene:
    return Scene.from_dict(
        {
            "format": "hotice-scene/1",
            "name": "test",
            "bounds_m": [[-0.5, -1.0, 0.0], [2.5, 1.0, 1.5]],
            "start": {"position_m": [0.0, 0.0], "yaw_rad": 0.0},
            "goal": {"position_m": [2.0, 0.0]},
            "obstacles": [
                {
                    "name": n,
                    "category": c,
                    "shape": {"type": "box", "size_m": list(size)},
                    "position_m": list(at),
                    "quaternion_wxyz": [1, 0, 0, 0],
                }
                for n, c, size, at in obstacles
            ],
        }
    )


OPEN = scene()
BAR = scene(("bar", "ground", (0.08, 2.0, 0.06), (1.0, 0.0, 0.03)))
WALL = scene(("wall", "side", (0.2, 1.2, 1.5), (1.0, 0.5, 0.75)))
BEAM = scene(("beam", "overhead", (0.2, 2.0, 0.4), (1.0, 0.0, 1.40)))


@pytest.fixture(scope="module")
def fields():
    return {id(s): build_hod_pf(s, resolution_m=0.06) for s in (OPEN, BAR, WALL, BEAM)}


def steps_of(fields, s):
    pf = fields[id(s)]
    body = body_spheres(STATE)
    path = plan_path(pf, (0.0, 0.0, 0.0), body)
    return path, plan_footsteps(path, Ground(pf.scene, CONFIG.ground_margin_m), CONFIG)


def test_streamline_of_the_open_floor_is_straight(fields):
    line = streamline(fields[id(OPEN)], np.zeros(2))
    assert np.abs(line[:, 1]).max() < 0.02
    assert line[-1] == pytest.approx([2.0, 0.0])


def test_footsteps_alternate_and_end_side_by_side(fields):
    path, steps = steps_of(fields, OPEN)
    feet = [s.foot for s in steps]
    assert all(a != b for a, b in zip(feet, feet[1:], strict=False))
    advance = np.diff([0.0, *[s.station for s in steps]])
    assert (advance <= CONFIG.longest_step_m + 1e-9).all() and (advance >= -1e-9).all()
    assert advance[:-1] == pytest.approx(CONFIG.step_length_m, abs=0.03)
    assert steps[-1].station == steps[-2].station == pytest.approx(path.length_m)
    gap = np.linalg.norm(steps[-1].xy - steps[-2].xy)
    assert gap == pytest.approx(2 * CONFIG.half_width_m, abs=1e-6)


def test_times_add_up(fields):
    _, steps = steps_of(fields, OPEN)
    for a, b in zip(steps, steps[1:], strict=False):
        assert b.time_s - a.time_s == pytest.approx(b.span_s + CONFIG.double_support_s)


def test_feet_stand_beside_the_way(fields):
    path, _ = steps_of(fields, OPEN)
    left, yaw = foot_place(path, 1.0, 0, CONFIG.half_width_m)
    assert left == pytest.approx([1.0, CONFIG.half_width_m], abs=0.01) and yaw == pytest.approx(0.0, abs=0.01)


def test_no_sole_touches_a_bar_and_the_swing_passes_over_it(fields):
    _, steps = steps_of(fields, BAR)
    low, high = 1.0 - 0.04 - CONFIG.ground_margin_m, 1.0 + 0.04 + CONFIG.ground_margin_m
    x = np.array([s.x for s in steps])
    assert ((x + SOLE_FRONT_M <= low + 0.005) | (x - SOLE_BACK_M >= high - 0.005)).all()
    over = [s for s, before in zip(steps[2:], steps, strict=False) if before.x < 1.0 < s.x]
    assert len(over) == 2
    assert min(s.swing.apex_m for s in over) >= 0.06 + CONFIG.ground_margin_m
    assert min(s.span_s for s in over) > CONFIG.swing_s


def test_sole_height_over_a_bar(fields):
    ground = Ground(BAR, 0.02)
    away, on = ground.sole_height(np.array([[0.5, 0.0], [1.0, 0.0]]), 0.0)
    assert away == 0.0
    assert on == pytest.approx(0.08, abs=0.011)


def test_a_bar_too_wide_has_no_footsteps(fields):
    wide = scene(("step", "ground", (0.5, 2.0, 0.06), (1.0, 0.0, 0.03)))
    pf = build_hod_pf(wide, resolution_m=0.06)
    path = plan_path(pf, (0.0, 0.0, 0.0), body_spheres(STATE))
    with pytest.raises(UnreachableGoal, match="footholds"):
        plan_footsteps(path, Ground(pf.scene, CONFIG.ground_margin_m), CONFIG)


def test_the_body_keeps_clear_of_a_wall(fields):
    pf, body = fields[id(WALL)], body_spheres(STATE)
    path = plan_path(pf, (0.0, 0.0, 0.0), body)
    xy, yaw = path.at(np.linspace(0.0, path.length_m, 80))
    for p, turn in zip(xy, yaw, strict=True):
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        assert (WALL.signed_distance(body.robot @ R.T + [*p, 0.0]) - body.radius).min() > 0.02
        assert WALL.signed_distance(body.load @ R.T + [*p, 0.0]).min() > 0.02


def test_the_pelvis_sinks_under_a_beam_and_rises_again(fields):
    pf = fields[id(BEAM)]
    table = postures(STATE, level_arms(STATE), CONFIG)
    path = plan_path(pf, (0.0, 0.0, 0.0), table[0].body)
    profile = plan_profile(pf, path, table, CONFIG)
    assert profile.at(0.0)[0] == pytest.approx(CONFIG.pelvis_height_m)
    assert profile.at(path.length_m)[0] == pytest.approx(CONFIG.pelvis_height_m)
    assert profile.at(1.0)[0] < CONFIG.pelvis_height_m - 0.03
    assert profile.clearance_m > 0.0
    slope = np.abs(np.diff(profile.height)) / np.diff(profile.station)
    assert slope.max() <= SLOPE + 1e-6


def test_open_floor_needs_no_crouch(fields):
    plan = plan_walk(fields[id(OPEN)], STATE, (0.0, 0.0, 0.0))
    assert (plan.profile.height == CONFIG.pelvis_height_m).all() and (plan.profile.lean == 0.0).all()


def test_spheres_cover_head_and_load():
    body = body_spheres(STATE)
    assert 1.15 < body.height_m < 1.40
    top = body.load[:, 2].max()
    assert top == pytest.approx(STATE.object_pos_W[2] + 0.15, abs=1e-9)


def test_bad_configuration_is_refused():
    with pytest.raises(InvalidConfig, match="longest_step_m"):
        WalkConfig(longest_step_m=0.9)
    with pytest.raises(InvalidConfig, match="swing_s"):
        WalkConfig(swing_s=0.0)
