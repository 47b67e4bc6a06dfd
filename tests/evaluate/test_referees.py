"""Verdicts on made-up sequences, right values by hand."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from hotice.evaluate.referees import FREE_STEPS, Signals, afterwards, exact, points
from hotice.evaluate.trial_log import TrialLog
from hotice.fields.bank import FieldBank
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene

LIMIT, STAY = 100, 20


def sequence(steps=LIMIT + STAY, **events):
    """Signals of one trial of `steps` steps, numbered from 1, the goal 1 m off; events: name = {step: value}, which
    lasts for distances and gaps, and for a flag is that step."""
    made = {}
    for f in fields(Signals):
        flag = not f.name.endswith("_m")
        usual = False if flag else np.inf if "gap" in f.name else 1.0
        column = np.full(steps, usual)
        for step, value in sorted(events.pop(f.name, {}).items()):
            column[step - 1 : step if flag else None] = value
        made[f.name] = column[:, None]
    assert not events
    return Signals(**made)


def verdict(rule, **events):
    found = rule(sequence(**events), LIMIT)
    return found.outcome[0], int(found.step[0])


@pytest.mark.parametrize(
    "events, by_exact, by_points",
    [
        ({}, ("timeout", 100), ("timeout", 100)),
        (dict(goal_m={30: 0.099}), ("success", 30), ("success", 30)),
        (dict(goal_m={30: 0.1}), ("timeout", 100), ("timeout", 100)),  # within, not at
        (dict(goal_m={100: 0.05}), ("success", 100), ("success", 100)),
        (dict(goal_m={101: 0.05}), ("timeout", 100), ("timeout", 100)),
        (dict(robot_hit={20: True}, goal_m={30: 0.05}), ("robot_collision", 20), ("success", 30)),
        (dict(object_hit={30: True}, goal_m={30: 0.05}), ("object_collision", 30), ("success", 30)),
        (dict(object_hit={31: True}, goal_m={30: 0.05}), ("success", 30), ("success", 30)),
        (dict(object_hit={9: True}, robot_hit={9: True}), ("robot_collision", 9), ("timeout", 100)),
        (dict(fall={9: True}, robot_hit={9: True}, drop={9: True}), ("fall", 9), ("fall", 9)),
        (dict(unstable={9: True}, fall={9: True}), ("unstable", 9), ("unstable", 9)),
        (dict(drop={70: True}, goal_m={80: 0.0}), ("drop", 70), ("drop", 70)),
        (dict(robot_gap_m={60: -0.041}, goal_m={80: 0.0}), ("success", 80), ("robot_collision", 60)),
        (dict(robot_gap_m={60: -0.04}, goal_m={80: 0.0}), ("success", 80), ("success", 80)),
        (dict(object_gap_m={60: -0.2}, drop={60: True}), ("drop", 60), ("drop", 60)),
        (dict(object_gap_m={60: -0.2}, fall={61: True}), ("fall", 61), ("object_collision", 60)),
        # the first 50 steps are free; who is still inside then has collided
        (dict(robot_gap_m={20: -0.3, 51: 0.5}, goal_m={80: 0.0}), ("success", 80), ("success", 80)),
        (dict(robot_gap_m={20: -0.3, 52: 0.5}, goal_m={80: 0.0}), ("success", 80), ("robot_collision", 51)),
        (dict(robot_gap_m={20: -0.3}, goal_m={50: 0.0}), ("success", 50), ("success", 50)),
    ],
)
def test_verdicts(events, by_exact, by_points):
    assert FREE_STEPS == 50
    assert verdict(exact, **events) == by_exact and verdict(points, **events) == by_points


@pytest.mark.parametrize(
    "events, distance, standing, stayed",
    [
        (dict(goal_m={30: 0.09, 40: 0.02}), 0.02, True, True),
        (
            dict(goal_m={30: 0.09, 40: 0.15, 50: 0.09, 51: 0.3}),
            0.3,
            True,
            True,
        ),  # looked at a second later, not between
        (dict(goal_m={30: 0.09, 50: 0.11}), 0.11, True, False),
        (dict(goal_m={30: 0.09}, object_hit={60: True}), 0.09, False, True),
        (dict(goal_m={30: 0.09, 44: 0.4, 45: 0.01}, fall={44: True}), 0.4, False, False),
        (dict(goal_m={30: 0.09, 70: 0.4, 71: 0.01}, drop={70: True}), 0.4, False, True),
        # arrivals of the last second are looked at after the limit; contacts and falls after it count no more
        (dict(goal_m={95: 0.09, 100: 0.07, 115: 0.2}), 0.07, True, False),
        (dict(goal_m={95: 0.09, 100: 0.07}, robot_hit={101: True}, fall={118: True}), 0.07, True, True),
        (dict(goal_m={95: 0.09, 100: 0.07}, fall={110: True}), 0.07, True, False),
        (dict(goal_m={100: 0.09, 101: 0.01}), 0.09, True, True),
        # failures count from their end
        (dict(goal_m={30: 0.8, 40: 0.05}, robot_hit={35: True}), 0.8, False, False),
        (dict(goal_m={99: 0.8, 101: 0.05}), 0.8, False, False),
        (dict(goal_m={30: 0.7, 31: 0.05}, fall={30: True}), 0.7, False, False),
    ],
)
def test_what_comes_after_an_arrival(events, distance, standing, stayed):
    found = afterwards(sequence(**events), LIMIT, STAY)
    assert found.distance_m[0] == distance
    assert (bool(found.standing[0]), bool(found.stayed[0])) == (standing, stayed)


@pytest.mark.parametrize("hit", ["robot_hit", "object_hit"])
def test_a_robot_that_stands_is_walked_into(hit):
    """Not one that walks, nor one that touches what stands still; and the points rule knows no such thing."""
    into = ("walked_into", 20)
    by_robot = (hit.replace("hit", "collision"), 20)
    asked = {hit: {20: True}, "met": {20: True}}
    assert verdict(exact, **asked, way_m={1: 0.09}) == into
    assert verdict(exact, **asked, way_m={1: 0.11}) == by_robot
    assert verdict(exact, **asked, way_m={1: 0.5, 19: 0.09}) == into
    assert verdict(exact, **{hit: {20: True}}, way_m={1: 0.0}) == by_robot
    assert verdict(exact, met={20: True}, way_m={1: 0.0}) == ("timeout", 100)
    assert verdict(exact, **asked, way_m={1: 0.0}, goal_m={10: 0.05}) == ("success", 10)
    assert verdict(exact, **asked, way_m={1: 0.0}, fall={20: True}) == ("fall", 20)
    assert verdict(points, **asked, way_m={1: 0.0}) == ("timeout", 100)


def test_the_way_of_the_last_half_second():
    log = TrialLog(FieldBank.build([Scene("open")]), 2, LIMIT, 0.02, ("exact",))
    ways = [log.way(np.array([[0.01 * k, 0.0], [1.0, -0.02 * k]])) for k in range(60)]
    np.testing.assert_allclose(ways[10], [0.1, 0.2])
    np.testing.assert_allclose(ways[50], [0.25, 0.5])


def row(signals, t):
    return Signals(**{name: value[t] for name, value in vars(signals).items()})


@pytest.mark.parametrize(
    "events, steps, alone",
    [
        ({}, 100, 100),
        (dict(goal_m={30: 0.05}), 100, 100),
        (dict(goal_m={90: 0.05}), 110, 110),
        (dict(goal_m={101: 0.05}), 100, 100),
        (dict(robot_hit={40: True}, goal_m={90: 0.05}), 100, 40),
        (dict(robot_hit={40: True}, goal_m={30: 0.05}), 100, 100),
        (dict(fall={70: True}), 70, 70),
    ],
)
def test_trials_run_as_long_as_there_is_something_to_see(events, steps, alone):
    """And the verdicts on what was seen are those on all of it."""
    whole = sequence(**events)
    for names, last in ((("exact", "points"), steps), (("exact",), alone)):
        log = TrialLog(FieldBank.build([Scene("open")]), 1, LIMIT, 0.05, names)
        assert log.stay == STAY
        over = 0
        while log.running.any():
            over += log.see(row(whole, len(log.steps)))
        assert (len(log.steps), over) == (last, 1)
        trials, found = log.trials(), exact(whole, LIMIT)
        assert trials.outcome == found.outcome and trials.time_s == (round(0.05 * found.step[0], 6),)
        assert trials.points == (points(whole, LIMIT).outcome if "points" in names else ())
        after = afterwards(whole, LIMIT, STAY)
        assert trials.distance_at_limit_m == tuple(after.distance_m) and trials.stayed == tuple(after.stayed)


def test_gaps_are_depths_in_the_scene():
    """Within an interpolation of the grid, 4 cm; the deepest point counts."""
    place = Scene("wall", obstacles=(Obstacle("wall", "side", BoxShape((0.4, 1.0, 1.0)), (1.0, 0.0, 0.5)),))
    log = TrialLog(FieldBank.build([place]), 2, LIMIT, 0.02)
    body = torch.tensor([[[0.5, 0.0, 0.5], [0.9, 0.0, 0.5]], [[0.4, 0.0, 0.5], [0.6, 0.0, 0.5]]])
    load = torch.tensor([[[0.3, 0.0, 0.5]], [[0.85, 0.2, 0.5]]])
    robot_m, object_m = log.gaps(body, load)
    assert robot_m == pytest.approx([-0.1, 0.2], abs=0.01) and object_m == pytest.approx([0.5, -0.05], abs=0.01)
    alone = TrialLog(log.bank, 2, LIMIT, 0.02, ("exact",))
    assert np.isinf(alone.gaps(body, load)).all()
