import json

import mujoco
import numpy as np
import pytest
import torch

import hotice.evaluate.carriers as carriers
import hotice.evaluate.start as start
import hotice.evaluate.walk_trials as walk_trials
from hotice.commands.program import main
from hotice.control.plant import TorquePlant
from hotice.control.walk import WalkConfig
from hotice.errors import InvalidConfig, MissingExtra, UnknownName, UnreachableGoal
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.run import evaluate
from hotice.evaluate.scorer import Scorer, score_block
from hotice.evaluate.walk_trials import Trial, score_walks
from hotice.learn.policy import load_policy
from hotice.model import Box, Cylinder, Sphere, builder
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.task.judge import Judge

GOAL_M = 0.35
STATE = solve_carry(Box((0.3, 0.3, 0.3), 1.0))


def scene(name, *obstacles, goal=GOAL_M):
    """Scene whose goal is some steps ahead; obstacles: (category, position, size)."""
    parts = tuple(Obstacle(f"part {i}", c, BoxShape(size), p) for i, (c, p, size) in enumerate(obstacles))
    return Scene(name, goal=(goal, 0.0), obstacles=parts)


SHORT = scene("short")
WIDE = scene("wide", ("ground", (1.0, 0.0, 0.05), (1.2, 2.0, 0.1)), goal=2.0)
"""A flat obstacle that no step leads across, though a body would pass over it."""


def walked(place, states=(STATE,), rollouts=1, seed=0, **task):
    return score_walks(WalkConfig(), place, rollouts * list(states), seed, Conditions(perturbed=False, **task))


@pytest.fixture
def asked(tmp_path):
    """Function: an evaluation of the walk in two scenes, one of which gives no plan."""
    SHORT.save(tmp_path / "short.json")
    WIDE.save(tmp_path / "wide.json")

    def make(**changes):
        scenes = (str(tmp_path / "short.json"), str(tmp_path / "wide.json"))
        given = dict(
            controller="walk",
            perturbed=False,
            scenes=scenes,
            rollouts=2,
            seed=5,
            objects=2,
            batch=1,
            threads=1,
            horizon_s=1.5,
        )
        return EvaluateConfig(**given | changes)

    return make


def without_source(report):
    return {k: v for k, v in report.items() if k != "source"}


def test_a_report_of_the_walk(asked, tmp_path, capsys):
    out = tmp_path / "walk.json"
    report = evaluate(asked(out=out))
    assert json.loads(out.read_text()) == report and report["format"] == "hotice-report/1"
    assert report["controller"] == "walk" and report["policy"] is None and not report["perturbed"]
    assert report["walk"]["step_length_m"] == WalkConfig().step_length_m
    short, wide = report["scenes"]
    assert short["success_rate"] == 1.0 and short["mean_distance_m"] < 0.1 and short["no_plans"] == 0
    assert 0.5 < short["mean_success_time_s"] < 2.0
    assert wide["no_plans"] == 2 and wide["success_rate"] == 0.0 and wide["timeouts"] == 0
    assert wide["mean_distance_m"] == pytest.approx(2.0, abs=0.04)
    printed = " ".join(capsys.readouterr().out.split())
    assert (
        "controller walk, protocol robot (2 ms, elliptic): 2 trials" in printed
        and " no " in printed
        and " plan " in printed
    )


def test_an_interrupted_evaluation_goes_on_and_ends_the_same(asked, tmp_path, monkeypatch, capfd):
    whole = evaluate(asked(out=tmp_path / "whole.json"))
    score, calls = walk_trials.score_walks, []

    def dying(*args, **kwargs):
        calls.append(kwargs["first"])
        if len(calls) == 2:
            raise KeyboardInterrupt
        return score(*args, **kwargs)

    monkeypatch.setattr(walk_trials, "score_walks", dying)
    out = tmp_path / "parts.json"
    with pytest.raises(KeyboardInterrupt):
        evaluate(asked(out=out))
    assert not out.exists()
    assert without_source(evaluate(asked(out=out))) == without_source(whole)
    assert len(calls) == 5 and "1 of 4 blocks" in capfd.readouterr().err


def test_what_is_kept_is_that_of_one_walk_only(asked, onnx_file):
    def settings(config, carrier):
        return Scorer(config=config, scenes=(SHORT,), states=(STATE,)).settings(carrier)

    walk = settings(asked(), WalkConfig())
    assert walk == settings(asked(out=None), WalkConfig())
    assert walk["carrier"] != settings(asked(), WalkConfig(step_length_m=0.26))["carrier"]
    by_policy = settings(asked(controller="policy", policy=str(onnx_file)), load_policy(onnx_file))
    assert {k for k in walk if walk[k] != by_policy[k]} == {"controller", "carrier"}


def test_policies_and_the_walk_start_alike(asked, onnx_file, monkeypatch):
    """Objects and starts of all blocks, to the bit."""
    seen = {"walk": [], "policy": []}

    class Watched(start.TransportEnv):
        def step(self, action):
            row = (self.carry.states[int(self.memory.model[0])].carried, self.physics.qpos[0].clone())
            if not seen["policy"] or len(seen["policy"]) < blocks:
                seen["policy"].append(row)
            return super().step(action)

    def look(plant, place, pf, state, *args, **kwargs):
        seen["walk"].append((state.carried, torch.from_numpy(plant.data.qpos.copy())))
        raise UnreachableGoal("not looked for")

    monkeypatch.setattr(walk_trials, "Walk", look)
    walk = Scorer.of(asked())
    for block in (0, 1):
        walk.score(WalkConfig(), 0, block)
    monkeypatch.setattr(start, "TransportEnv", Watched)
    policy = Scorer.of(asked(controller="policy", policy=str(onnx_file), horizon_s=0.02))
    for block in (0, 1):
        blocks = block + 1
        policy.score(load_policy(onnx_file), 0, block)
    assert [o for o, _ in seen["walk"]] == [o for o, _ in seen["policy"]] and seen["walk"][0][0] != seen["walk"][1][0]
    assert all(torch.equal(a, b) for (_, a), (_, b) in zip(seen["walk"], seen["policy"], strict=True))


@pytest.mark.parametrize("carried", [Cylinder(0.16, 0.3, 1.5), Sphere(0.17, 1.5)])
def test_other_shapes_are_carried_too(carried):
    assert walked(SHORT, [solve_carry(carried)]).outcomes == {"success": 1}


def test_trials_are_looked_at_as_often_as_those_of_policies():
    """Also with steps of 2 ms, in which the controller acts every 4 ms."""
    for protocol in ("paper", "robot"):
        trials = walked(SHORT, protocol=protocol)
        assert trials.outcomes == {"success": 1}
        assert trials.time_s[0] == pytest.approx(0.02 * round(trials.time_s[0] / 0.02), abs=1e-9)


def test_the_protocol_reaches_the_simulation(monkeypatch):
    seen = []

    def look(plant, *args, **kwargs):
        seen.append((plant.model.opt.timestep, plant.model.opt.cone))
        raise UnreachableGoal("not looked for")

    monkeypatch.setattr(walk_trials, "Walk", look)
    for protocol in ("paper", "robot"):
        walked(SHORT, protocol=protocol)
    cone = mujoco.mjtCone
    assert seen == [(0.005, cone.mjCONE_PYRAMIDAL), (0.002, cone.mjCONE_ELLIPTIC)]


@pytest.mark.parametrize(
    "position, size, cause",
    [((0.05, 0.31, 0.9), (0.1, 0.3, 0.3), "robot_collision"), ((0.40, 0.0, 0.85), (0.2, 0.1, 0.1), "object_collision")],
)
def test_an_obstacle_in_the_way_is_a_collision(position, size, cause):
    """Exact geometry: it is hit from the start."""
    trials = walked(scene("hit", ("side", position, size), goal=0.8))
    assert trials.outcomes == {cause: 1} and trials.time_s == (0.02,)


@pytest.fixture(scope="module")
def plant():
    return TorquePlant(builder.build_model(STATE.carried, wrist_pos=STATE.wrist_pos))


@pytest.mark.parametrize(
    "cause, change",
    [
        ("", lambda data: None),
        ("fall", lambda data: data.qpos.__setitem__(2, 0.34)),
        ("fall", lambda data: data.qpos.__setitem__(slice(3, 7), [np.cos(0.55), 0.0, np.sin(0.55), 0.0])),
        ("drop", lambda data: data.qpos.__setitem__(28, data.qpos[28] + 0.16)),
        ("unstable", lambda data: data.qvel.__setitem__(20, 2e3)),
        ("unstable", lambda data: data.qvel.__setitem__(20, np.nan)),
    ],
)
def test_failures(plant, cause, change):
    plant.reset(STATE.qpos())
    change(plant.data)
    mujoco.mj_kinematics(plant.model, plant.data)
    assert Judge(plant.model).failure(plant.data) == cause


def test_a_trial_that_would_go_on_is_a_timeout():
    trial = Trial("success", 6.0, 0.09, 0.4, 0, 1.0, 0.1)
    assert trial.at(5.0) == ("timeout", 0.4, 5.0) and trial.at(6.0) == ("success", 0.09, 6.0)


def test_the_time_limit_is_that_of_both(onnx_file):
    trials = walked(SHORT, horizon_s=0.2)
    assert trials.outcomes == {"timeout": 1} and trials.time_s == (0.2,)
    trials = score_block(load_policy(onnx_file), SHORT, [STATE], 0, Conditions(perturbed=False, horizon_s=0.1))
    assert trials.outcomes == {"timeout": 1} and trials.time_s == (0.1,)


# asked for wrongly


@pytest.mark.parametrize(
    "changes, error, words",
    [
        (dict(controller="run"), UnknownName, "controller 'run': known are policy, walk"),
        (dict(policy="carry"), InvalidConfig, "leave out one"),
        (dict(controller="policy"), InvalidConfig, "--policy NAME or PATH, or --controller walk"),
        (dict(perturbed=True), InvalidConfig, "--no-perturbed"),
        (dict(horizon_s=0.0), InvalidConfig, "horizon_s"),
        (dict(horizon_s=float("nan")), InvalidConfig, "horizon_s"),
    ],
)
def test_impossible_combinations_are_refused(changes, error, words):
    with pytest.raises(error, match=words):
        EvaluateConfig(**{"controller": "walk", "perturbed": False, "scenes": ("open_floor",)} | changes)


@pytest.mark.parametrize(
    "options, words",
    [
        (["--controller", "walk"], "--no-perturbed"),
        (["--controller", "walk", "--policy", "carry", "--no-perturbed"], "leave out one"),
        ([], "no policy"),
    ],
)
def test_the_command_line_refuses_them_on_one_line(options, words, capfd):
    assert main(["evaluate", "--scenes", "open_floor", *options]) == 2
    said = capfd.readouterr().err
    assert words in said and said.count("\n") == 1


def test_a_walk_without_its_packages_is_refused(asked, monkeypatch):
    monkeypatch.setattr(carriers, "find_spec", lambda name: None if name == "proxsuite" else object())
    with pytest.raises(MissingExtra, match=r"proxsuite.*hotice\[drake\]"):
        evaluate(asked())
