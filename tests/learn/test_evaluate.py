import json

import pytest
import torch

from hotice.errors import CheckpointError, HoticeError, InvalidConfig
from hotice.learn.evaluate import EvaluateConfig, SceneScore, evaluate, evaluation_task, score_scene
from hotice.learn.policy import load_policy
from hotice.learn.wilson import wilson
from hotice.model import Box, load_scene
from hotice.model.carry import solve_carry
from hotice.model.scene import Obstacle, Scene
from hotice.model.shapes import BoxShape, CylinderShape

REPORT = {"format", "policy", "seed", "rollouts", "success_rate", "mean_distance_m", "scenes"}
ROW = {
    "name",
    "rollouts",
    "success_rate",
    "mean_distance_m",
    "robot_collisions",
    "object_collisions",
    "falls",
    "drops",
    "timeouts",
}


@pytest.fixture(scope="module")
def states():
    return [solve_carry(Box((0.3, 0.3, 0.3), 1.0)), solve_carry(Box((0.22, 0.34, 0.25), 3.0))]


class Standing:
    """Holds still: the zero action."""

    name = "standing"

    def __init__(self, meta):
        self.meta = meta

    def act(self, obs):
        return torch.zeros(len(obs), 20)


@pytest.fixture(scope="module")
def standing(onnx_file):
    return Standing(load_policy(onnx_file).meta)


def blocked(position, shape):
    return Scene("blocked", obstacles=(Obstacle("it", "side", shape, position),))


def near(x):
    """A scene whose goal is x metres ahead of the start."""
    return Scene("near", goal=(x, 0.0))


@pytest.mark.parametrize(
    "position, shape, cause",
    [
        ((0.62, 0.0, 0.85), BoxShape((0.3, 0.3, 0.1)), "object_collision"),
        ((0.05, 0.31, 0.9), BoxShape((0.1, 0.3, 0.3)), "robot_collision"),
        ((0.05, -0.31, 0.9), CylinderShape(0.15, 0.3), "robot_collision"),
        ((0.12, 0.13, 0.05), BoxShape((0.1, 0.1, 0.1)), "robot_collision"),
    ],
)
def test_an_obstacle_in_the_way_is_a_collision(standing, states, position, shape, cause):
    score = score_scene(standing, blocked(position, shape), states[:1], 4, 0, threads=1)
    assert score.outcomes == {cause: 4} and score.successes == 0
    assert all(1.8 < d < 2.2 for d in score.distances_m)


def test_an_obstacle_out_of_reach_is_none(standing, states):
    score = score_scene(standing, blocked((1.0, 0.9, 0.5), BoxShape((0.1, 0.1, 1.0))), states[:1], 2, 0, threads=1)
    assert not set(score.outcomes) & {"robot_collision", "object_collision"} and score.rollouts == 2


def test_success_is_counted_once_a_trial_with_its_distance_and_time(standing, states):
    score = score_scene(standing, near(0.04), states, 5, 0, batch=2, threads=1)
    assert score.outcomes == {"success": 5} and score.rollouts == 5
    assert all(0.0 < d < 0.1 for d in score.distances_m)
    assert all(0.0 < t <= 0.04 + 1e-6 for t in score.times_s)


def test_every_trial_is_counted_once_whatever_the_batch(standing, states):
    for batch in (1, 3, 64):
        score = score_scene(standing, near(0.04), states, 5, 0, batch=batch, threads=1)
        assert score.rollouts == sum(score.outcomes.values()) == len(score.times_s) == 5


def test_the_seed_decides(standing, states):
    scene = blocked((0.05, 0.31, 0.9), BoxShape((0.1, 0.3, 0.3)))
    a, b, c = (score_scene(standing, scene, states, 4, seed, threads=1).distances_m for seed in (3, 3, 4))
    assert a == b != c


def test_objects_take_turns(standing, states, monkeypatch):
    """Also over several batches."""
    from hotice.learn import evaluate as module

    seen = []

    class Watched(module.TransportEnv):
        def step(self, action):
            step = super().step(action)
            seen.append(step.model.tolist())
            return step

    monkeypatch.setattr(module, "TransportEnv", Watched)
    score_scene(standing, near(0.04), states, 5, 0, batch=3, threads=1)
    assert seen[0] == [0, 1, 0] and seen[-1] == [1, 0, 1]


def test_the_papers_trial(standing):
    config = evaluation_task(standing.meta["task"])
    assert (config.episode_s, config.goal_radius_m, config.control_dt_s) == (5.0, 0.1, 0.02)
    assert config.max_steps == 250 and config.end_at_goal and config.collisions and config.anywhere == 0.0
    assert config.leg_scale_rad == standing.meta["task"]["leg_scale_rad"]
    fine = evaluation_task(standing.meta["task"], fine=True)
    assert (fine.physics_dt_s, fine.control_dt_s) == (0.002, 0.02)


def test_training_tolerances_do_not_soften_the_score(standing):
    task = standing.meta["task"] | {"goal_radius_m": 0.5, "episode_s": 20.0, "collisions": False, "tolerance_m": 0.05}
    assert evaluation_task(task) == evaluation_task(standing.meta["task"])


def test_report(onnx_file, tmp_path, capsys):
    out = tmp_path / "report.json"
    config = EvaluateConfig(
        policy=str(onnx_file), scenes=("open_floor", "pillars"), rollouts=3, seed=5, out=out, objects=2, threads=1
    )
    report = evaluate(config)
    assert json.loads(out.read_text()) == report
    assert (
        REPORT <= set(report)
        and report["format"] == "hotice-report/1"
        and (report["seed"], report["rollouts"]) == (5, 3)
    )
    assert [r["name"] for r in report["scenes"]] == ["open_floor", "pillars"]
    for row in report["scenes"]:
        assert ROW <= set(row) and row["rollouts"] == 3
        causes = sum(row[k] for k in (*(ROW - {"name", "rollouts", "success_rate", "mean_distance_m"}), "unstable"))
        wins = round(row["success_rate"] * 3)
        assert causes + wins == 3
        assert row["success_interval_95"] == pytest.approx(wilson(wins, 3), abs=1e-4)
    rates = [r["success_rate"] for r in report["scenes"]]
    assert report["success_rate"] == pytest.approx(sum(rates) / 2)
    assert report["mean_distance_m"] == pytest.approx(sum(r["mean_distance_m"] for r in report["scenes"]) / 2)
    assert "open_floor" in capsys.readouterr().out


def test_score_sums(states):
    score = SceneScore("s", {"success": 1, "fall": 2}, [0.05, 1.0, 1.5], [2.0, 0.0, 0.0])
    row = score.to_dict()
    assert row["success_rate"] == pytest.approx(1 / 3) and row["mean_distance_m"] == pytest.approx(0.85)
    assert row["mean_success_time_s"] == 2.0 and row["falls"] == 2 and row["drops"] == 0
    assert SceneScore("s").to_dict()["success_interval_95"] == [0.0, 1.0]


def test_a_policy_of_another_layout_is_refused(onnx_file, states):
    policy = Standing(load_policy(onnx_file).meta | {"layout": [["gyro", 3]]})
    with pytest.raises(CheckpointError, match="the policy reads 3 numbers"):
        score_scene(policy, load_scene("open_floor"), states, 1, 0, threads=1)


@pytest.mark.parametrize(
    "changes", [dict(rollouts=0), dict(batch=-1), dict(objects=0), dict(scenes=()), dict(seed=-1), dict(threads=-1)]
)
def test_impossible_numbers_are_refused(changes):
    with pytest.raises(InvalidConfig):
        EvaluateConfig(**({"policy": "x", "scenes": ("open_floor",)} | changes))


@pytest.mark.parametrize(
    "changes", [dict(mass_kg=(0.5, float("nan"))), dict(size_m=(-1.0, 0.2)), dict(shapes=("cone",))]
)
def test_impossible_objects_are_refused(onnx_file, changes):
    with pytest.raises(HoticeError):
        evaluate(EvaluateConfig(policy=str(onnx_file), scenes=("open_floor",), rollouts=1, threads=1, **changes))
