"""The reward table, and each term in a situation made by hand."""

import dataclasses

import pytest
import torch

from hotice.errors import InvalidConfig, UnknownName
from hotice.model import g1
from hotice.sim import PRESETS, terms
from hotice.sim.rewards import REWARDS, L, Reward, RewardTable, S, U
from hotice.sim.snapshot import FEET, HEAD, PELVIS, POINTS
from hotice.task.presets import DUAL, SINGLE, get_preset

DT = 0.02
HANDS = [POINTS.index("left_hand"), POINTS.index("right_hand")]


def one(_):
    return torch.ones(8)


@pytest.fixture
def walking(env, altered):
    """Everything moves with c = 0.6 m/s along +x, which is also every field; upright, feet apart."""
    s = env.snapshot()
    x = torch.tensor([0.6, 0.0, 0.0])
    still = torch.zeros(8, 3)
    return altered(
        s,
        v_WK=x.expand_as(s.v_WK),
        v_WOK=x.expand_as(s.v_WOK),
        v_WP=x.expand(8, 3),
        v_WO=x.expand(8, 3),
        w_WP_P=still,
        w_WO=still,
        c_W=x.expand(8, 3),
        speed=torch.full((8,), 0.6),
        heading_error=torch.zeros(8),
        yaw=torch.zeros(8),
        sgf=s.sgf._replace(force_W=x.expand_as(s.sgf.force_W)),
        ogf=s.ogf._replace(force_W=x.expand_as(s.ogf.force_W)),
        gravity_P=torch.tensor([0.0, 0.0, -1.0]).expand(8, 3),
    )


# the table


def test_who_receives_what(walking):
    rows = [Reward("l", L, 1.0, one, ""), Reward("u", U, 10.0, one, ""), Reward("s", S, 100.0, one, "")]
    dual, values = RewardTable(rows, DUAL, DT)(walking)
    torch.testing.assert_close(dual, DT * torch.tensor([101.0, 110.0]).expand(8, 2))
    single, _ = RewardTable(rows, SINGLE, DT)(walking)
    torch.testing.assert_close(single, DT * torch.full((8, 1), 111.0))  # every term once
    assert values.shape == (8, 3)


def test_the_shipped_table_has_all_three_sets_and_the_papers_terms():
    receivers = {row.name: row.agents for row in REWARDS}
    assert set(receivers.values()) == {L, U, S}
    for name in ("sgf_head", "sgf_pelvis", "sgf_feet", "ogf_hands", "ogf_object", "object_lift"):
        assert receivers[name] == S, name


def test_streams_are_weighted_sums(moving):
    s = moving.snapshot()
    streams, values = moving.rewards(s)
    low = sum(r.weight * DT * r.term(s) for r in REWARDS if "low" in r.agents)
    up = sum(r.weight * DT * r.term(s) for r in REWARDS if "up" in r.agents)
    torch.testing.assert_close(streams, torch.stack([low, up], dim=1), atol=1e-6, rtol=1e-5)
    assert torch.isfinite(values).all() and values.shape == (8, len(REWARDS))


@pytest.mark.parametrize(
    "rows, message",
    [
        ([Reward("a", L, 1, one, ""), Reward("a", U, 1, one, "")], "'a' occurs twice"),
        ([Reward("a", ("left",), 1, one, "")], "known are 'low' and 'up'"),
        ([Reward("a", (), 1, one, "")], "known are 'low' and 'up'"),
    ],
)
def test_wrong_tables_are_refused(rows, message):
    with pytest.raises(InvalidConfig, match=message):
        RewardTable(rows, DUAL, DT)


@pytest.mark.parametrize("value", [torch.ones(8, 1), torch.ones(()), torch.full((8,), float("nan"))])
def test_terms_are_checked_on_a_snapshot(walking, value):
    with pytest.raises(InvalidConfig, match="'a' gives shape"):
        RewardTable([Reward("a", L, 1.0, lambda s: value, "")], DUAL, DT).check(walking)


def test_presets_differ_only_in_what_table_one_says():
    assert set(PRESETS) == {"dual_hodpf", "dual_sgf", "single_hodpf", "single_sgf"}
    for name, preset in PRESETS.items():
        assert {f.name for f in dataclasses.fields(preset)} == {"agents", "object_field"}
        assert preset.agents == (DUAL if name.startswith("dual") else SINGLE)
        assert preset.object_field == ("ogf" if name.endswith("hodpf") else "sgf")
    slices = [a.actions for a in DUAL]
    assert [a.size for a in DUAL] == [12, 8] and [a.size for a in SINGLE] == [20]
    assert slices == [g1.LOWER, g1.UPPER] and [s.start for s in slices] == [0, 12]
    with pytest.raises(UnknownName, match="dual_hodpf"):
        get_preset("triple")


def test_every_term_is_tried_below():
    tried = " ".join(k for k in globals() if k.startswith("test_")) + " ".join(SIGNS)
    missing = [r.name for r in REWARDS if r.name not in tried]
    assert not missing, f"no test of {missing}: add a row to SIGNS"


# terms: along the field, against it, by hand


@pytest.mark.parametrize("name, points", [("sgf_head", [HEAD]), ("sgf_pelvis", [PELVIS]), ("sgf_feet", list(FEET))])
def test_sgf_head_sgf_pelvis_sgf_feet(walking, altered, name, points):
    term = getattr(terms, name)
    full = (0.6 / 0.7) ** 2  # the cosine is softened by 0.1 m/s
    torch.testing.assert_close(term(walking), torch.full((8,), full))
    v = walking.v_WK.clone()
    v[:, points] *= -1
    torch.testing.assert_close(term(altered(walking, v_WK=v)), torch.full((8,), -full))
    v = torch.zeros_like(walking.v_WK)
    v[:, points, 1] = 0.6  # across
    assert term(altered(walking, v_WK=v)).abs().max() < 1e-6
    others = torch.full_like(walking.v_WK, -1.0)
    others[:, points] = walking.v_WK[:, points]
    torch.testing.assert_close(term(altered(walking, v_WK=others)), torch.full((8,), full))
    assert (term(altered(walking, goal_distance=torch.zeros(8))) == 0).all()


@pytest.mark.parametrize("name", ["ogf_hands", "ogf_object"])
def test_ogf_hands_ogf_object_score_only_what_differs_from_the_command(walking, altered, name):
    term = getattr(terms, name)
    assert term(walking).abs().max() < 1e-6, "walking along scores nothing by itself"
    up = torch.tensor([0.6, 0.0, 0.5])
    field = walking.ogf._replace(force_W=up.expand_as(walking.ogf.force_W))
    assert term(altered(walking, ogf=field)).abs().max() < 1e-6, "the field asks, nothing moves beyond c"
    full = (0.5 / 0.6) ** 2

    def moved(v):
        v_WK = walking.v_WK.clone()
        v_WK[:, HANDS] = v
        return altered(walking, ogf=field, v_WK=v_WK, v_WOK=v.expand_as(walking.v_WOK))

    torch.testing.assert_close(term(moved(up)), torch.full((8,), full))
    torch.testing.assert_close(term(moved(torch.tensor([0.6, 0.0, -0.5]))), torch.full((8,), -full))
    # without subtracting c this would count as following: forwards faster, not up
    assert term(moved(torch.tensor([1.2, 0.0, 0.0]))).abs().max() < 1e-6


def test_progress_is_linear_along_the_command_and_capped(walking, altered):
    def at(*v):
        return float(terms.progress(altered(walking, v_WP=torch.tensor(v).expand(8, 3)))[0])

    assert at(0.3, 0.0, 0.0) == pytest.approx(0.5) and at(0.6, 0.0, 0.0) == pytest.approx(1.0)
    assert at(2.0, 0.0, 0.0) == pytest.approx(1.0) and at(-0.6, 0.0, 0.0) == pytest.approx(-1.0)
    assert at(0.0, 0.6, 0.6) == pytest.approx(0.0)


def plus(name, row, amount):
    def change(s):
        value = getattr(s, name).clone()
        value[(slice(None), *row)] += amount
        return {name: value}

    return change


def lifted(s):
    p = s.p_WK.clone()
    p[:, 11:15, 2] += 0.2
    return {"p_WK": p, "touch": torch.zeros(8, 2, dtype=torch.bool)}


def close_feet(s):
    p = s.p_WK.clone()
    p[:, list(FEET), 1] *= 0.2
    return {"p_WK": p}


def hands_off(s):
    p = s.p_WK.clone()
    p[:, HANDS, 1] *= 1.5
    return {"p_WK": p}


def feet_down(left, right):
    return lambda s: {"touch": torch.tensor([left, right]).expand(8, 2)}


SIGNS = {
    # name: (better, worse): changes of the walking snapshot between which the weighted term must fall
    "object_lift": (plus("p_WO", (2,), 0.0), plus("p_WO", (2,), -0.08)),
    "clearance_ahead": (
        lambda s: {"clearance_ahead": torch.full((8,), -0.05)},
        lambda s: {"clearance_ahead": torch.full((8,), -0.10)},
    ),
    "clearance": (lambda s: {"clearance": torch.full((8,), 0.06)}, lambda s: {"clearance": torch.full((8,), 0.01)}),
    "arrival": (
        lambda s: {"goal_distance": torch.full((8,), 0.05)},
        lambda s: {"goal_distance": torch.full((8,), 0.3)},
    ),
    "velocity_tracking": (lambda s: {}, plus("v_WP", (0,), -0.4)),
    "heading": (lambda s: {}, lambda s: {"heading_error": torch.full((8,), -0.5)}),
    "yaw_rate": (
        lambda s: {"heading_error": torch.full((8,), 0.3), "w_WP_P": torch.tensor([0.0, 0.0, 0.6]).expand(8, 3)},
        lambda s: {"heading_error": torch.full((8,), 0.3), "w_WP_P": torch.tensor([0.0, 0.0, -0.6]).expand(8, 3)},
    ),
    "upright": (lambda s: {}, plus("gravity_P", (0,), 0.4)),
    "root_height": (
        lambda s: {"p_WP": torch.tensor([0.0, 0.0, 0.74]).expand(8, 3)},
        lambda s: {"p_WP": torch.tensor([0.0, 0.0, 0.60]).expand(8, 3)},
    ),
    "root_bounce": (lambda s: {}, plus("v_WP", (2,), 0.5)),
    "root_rocking": (lambda s: {}, plus("w_WP_P", (1,), 1.0)),
    "swing_height": (
        lambda s: {**lifted(s), "swing": torch.tensor([0.1, 0.0]).expand(8, 2)},
        lambda s: {"swing": torch.tensor([0.1, 0.0]).expand(8, 2)},
    ),
    "foot_slip": (
        lambda s: {"touch": torch.zeros(8, 2, dtype=torch.bool)},
        lambda s: {"touch": torch.ones(8, 2, dtype=torch.bool)},
    ),
    "single_support": (feet_down(True, False), feet_down(True, True)),
    "flight": (feet_down(True, False), feet_down(False, False)),
    "foot_spread": (lambda s: {}, close_feet),
    "hip_posture": (lambda s: {"q": s.grasp.joint_pos}, lambda s: {"q": s.grasp.joint_pos + 0.3}),
    "stand_still": (
        lambda s: {"q": s.grasp.joint_pos, "speed": torch.zeros(8)},
        lambda s: {"q": s.grasp.joint_pos + 0.3, "speed": torch.zeros(8)},
    ),
    "leg_smoothness": (lambda s: {}, plus("action", (0,), 1.0)),
    "leg_torque": (lambda s: {"torque": torch.zeros(8, 20)}, lambda s: {"torque": torch.full((8, 20), 40.0)}),
    "hand_reach": (lambda s: {}, hands_off),
    "grasp_slip": (lambda s: {}, plus("v_WO", (2,), -0.5)),
    "object_upright": (
        lambda s: {"R_WO": torch.eye(3).expand(8, 3, 3)},
        lambda s: {"R_WO": torch.tensor([[1.0, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]]).expand(8, 3, 3)},
    ),
    "object_steady": (lambda s: {}, plus("w_WO", (1,), 2.0)),
    "arm_smoothness": (lambda s: {}, plus("action", (15,), 1.0)),
    "arm_posture": (lambda s: {}, plus("action", (15,), 1.0)),
}


@pytest.mark.parametrize("name", SIGNS)
def test_the_worse_situation_pays_less(walking, altered, name):
    row = next((r for r in REWARDS if r.name == name), None)
    if row is None:
        pytest.skip(f"{name} is no longer in the table")
    better, worse = (row.weight * row.term(altered(walking, **change(walking))) for change in SIGNS[name])
    assert (better > worse + 1e-4).all(), (better, worse)
    assert better.shape == (8,)


def test_gait_schedule_wants_the_feet_where_the_clock_says(walking, altered):
    left_swings = {"swing": torch.tensor([0.1, 0.0]).expand(8, 2), "stance": torch.tensor([False, True]).expand(8, 2)}

    def score(left, right, **more):
        touch = torch.tensor([left, right]).expand(8, 2)
        return float(terms.gait_schedule(altered(walking, touch=touch, **left_swings, **more))[0])

    assert score(False, True) > score(True, True) > score(True, False)
    standing = {"speed": torch.zeros(8)}
    assert score(True, True, **standing) > score(False, True, **standing) > score(False, False, **standing)


def test_torque_smoothness_and_posture_touch_their_half_of_the_body_only(walking, altered):
    legs, arms = torch.zeros(8, 20), torch.zeros(8, 20)
    legs[:, :12], arms[:, 12:] = 1.0, 1.0
    assert (terms.leg_smoothness(altered(walking, action=arms)) == 0).all()
    assert (terms.arm_smoothness(altered(walking, action=legs)) == 0).all()
    assert (terms.leg_torque(altered(walking, torque=100 * arms)) == 0).all()
    torch.testing.assert_close(terms.leg_torque(altered(walking, torque=100 * legs)), torch.full((8,), 12.0))


def test_hands_may_slide_round_a_sphere_but_not_away_from_it(env):
    """Environments 3 and 7 carry the sphere."""
    s = env.snapshot()
    turned = torch.tensor([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    reach = terms.hand_reach(dataclasses.replace(s, R_WO=s.R_WO @ turned.T))
    base = terms.hand_reach(s)
    torch.testing.assert_close(reach[[3, 7]], base[[3, 7]], atol=1e-4, rtol=0)
    assert (reach[[0, 1, 4, 5]] < base[[0, 1, 4, 5]] - 0.05).all()
