import json
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
import torch

import hotice.evaluate.scorer as module
import hotice.evaluate.start as start
from hotice.errors import CheckpointError, HoticeError, InvalidConfig
from hotice.evaluate.carriers import policy_digest
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.run import evaluate
from hotice.evaluate.scorer import Scorer, score_block
from hotice.evaluate.seeds import TrialSeeds
from hotice.evaluate.trials import Trials, success_interval
from hotice.learn.policy import load_policy
from hotice.model import Box, load_scene
from hotice.model.builder import HIT_SENSORS
from hotice.model.carry import solve_carry
from hotice.model.dynamics import ROBOT_DYNAMICS, ROBOT_NOMINAL
from hotice.model.geometry.shapes import BoxShape, CylinderShape, MeshShape
from hotice.model.object_range import ObjectRange
from hotice.model.scene import Obstacle, Scene
from hotice.model.scene_digest import scene_digest
from hotice.sim.carry_bank import CarryBank
from hotice.sim.env import TransportEnv
from hotice.sim.physics.mujoco_batch import MujocoBatch

CALM = Conditions(perturbed=False)
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
        ((0.55, 0.0, 0.85), BoxShape((0.3, 0.3, 0.1)), "object_collision"),
        ((0.05, 0.31, 0.9), BoxShape((0.1, 0.3, 0.3)), "robot_collision"),
        ((0.05, -0.31, 0.9), CylinderShape(0.15, 0.3), "robot_collision"),
        ((0.12, 0.13, 0.05), BoxShape((0.1, 0.1, 0.1)), "robot_collision"),
    ],
)
def test_an_obstacle_in_the_way_is_a_collision(standing, states, position, shape, cause):
    asked = replace(CALM, protocol="paper")  # in converged physics what starts inside an obstacle is thrown out of it
    trials = score_block(standing, blocked(position, shape), 4 * states[:1], 0, asked)
    assert trials.outcomes == {cause: 4} and trials.successes == 0
    assert all(1.8 < d < 2.2 for d in trials.distance_m)


def test_an_obstacle_out_of_reach_is_none(standing, states):
    scene = blocked((1.0, 0.9, 0.5), BoxShape((0.1, 0.1, 1.0)))
    trials = score_block(standing, scene, 2 * states[:1], 0, CALM)
    assert not set(trials.outcomes) & {"robot_collision", "object_collision"} and trials.rollouts == 2


def test_success_is_counted_once_a_trial_with_its_distance_and_time(standing, states):
    trials = score_block(standing, near(0.04), (3 * states)[:5], 0, Conditions())
    assert trials.outcomes == {"success": 5} and trials.rollouts == len(trials.distance_m) == len(trials.time_s) == 5
    assert all(0.0 < d < 0.1 for d in trials.distance_m)
    assert all(0.0 < t <= 0.04 + 1e-6 for t in trials.time_s)


def test_trials_that_are_over_rest_and_change_nothing_for_the_others(states, monkeypatch):
    scene, policy = load_scene("pipe"), load_policy("carry", threads=1)
    advanced = []
    step = MujocoBatch.step

    def counted(self, *args):
        advanced.append(self.num_envs if self.only is None else len(self.only))
        step(self, *args)

    monkeypatch.setattr(MujocoBatch, "step", counted)
    trials = score_block(policy, scene, 3 * states, 2, Conditions())
    assert "success" in trials.outcome and sum(advanced) < 6 * len(advanced)
    monkeypatch.setattr(module, "let_rest", lambda *_: None)
    assert score_block(policy, scene, 3 * states, 2, Conditions()) == trials


def test_the_exact_verdict_is_the_same_whoever_else_looks(states):
    """Also where trials go on after a contact."""
    scene = blocked((0.62, 0.0, 0.85), BoxShape((0.3, 0.3, 0.1)))
    policy = load_policy("carry", threads=1)
    both, alone = (
        score_block(policy, scene, 2 * states, 1, Conditions(horizon_s=1.0), judges=judges)
        for judges in (("exact", "points"), ("exact",))
    )
    assert "object_collision" in both.outcome and replace(both, points=()) == alone and len(both.points) == 4


def test_a_trial_that_has_arrived_goes_on_to_the_limit(standing, states):
    """The robot that holds still stands near the goal for a while: far less than 5 s of it."""
    trials = score_block(standing, near(0.04), 2 * states, 0, Conditions(perturbed=False, horizon_s=0.3))
    assert trials.outcomes == {"success": 4} and trials.standing == (True,) * 4
    assert all(a != b for a, b in zip(trials.distance_m, trials.distance_at_limit_m, strict=True))
    assert all(d < 0.2 for d in trials.distance_at_limit_m)
    policy = load_policy("carry", threads=1)
    trials = score_block(policy, Scene("open", goal=(0.5, 0.0)), states[:1], 0, Conditions(perturbed=False))
    assert trials.outcome == ("success",) and trials.stayed == (True,) and trials.distance_at_limit_m[0] < 0.1


def test_the_seed_decides(standing, states):
    scene = blocked((0.05, 0.31, 0.9), BoxShape((0.1, 0.3, 0.3)))
    a, b, c = (
        score_block(standing, scene, 2 * states, seed, Conditions(), judges=("exact",)).distance_m for seed in (3, 3, 4)
    )
    assert a == b != c


def test_objects_take_turns_in_an_order_of_the_scene(onnx_file, tmp_path, monkeypatch):
    """Also over several blocks: each is carried as often, and which trial carries it depends on the scene."""
    seen = []
    monkeypatch.setattr(module, "score_block", lambda *a, **k: seen.append([s.carried for s in a[2]]))
    config = tiny_evaluation(onnx_file, None, rollouts=24, objects=8, batch=9)
    scorer = Scorer.of(config)
    for block in scorer.blocks():
        scorer.score(None, *block)
    pool = [s.carried for s in scorer.states]
    first, second = (sum(seen[i : i + 3], []) for i in (0, 3))
    assert [len(s) for s in seen] == [9, 9, 6] * 2 and len(pool) == 8
    assert all(order.count(o) == 3 for o in pool for order in (first, second)) and first != second


def test_a_contact_of_the_newest_state_is_a_hit(standing, states):
    """The robot falls onto a low block: hits say at every step what a fresh look at the state says."""
    scene = blocked((0.35, 0.0, 0.15), BoxShape((0.3, 0.6, 0.3)))
    config = CALM.task(standing.meta["task"])
    carry = CarryBank.of(states[:1], config.physics_dt_s, torch.device("cpu"), scene=scene)
    env = TransportEnv(2, [scene], carry, config=config, threads=1)
    env.reset()
    env.physics.qvel[:, 0] = 1.0
    model, found = carry.models[0], []
    for _ in range(40):
        env.physics.step(config.substeps)
        for row in range(2):
            data = mujoco.MjData(model)
            data.qpos[:], data.ctrl[:] = env.physics.qpos[row].numpy(), env.physics.ctrl[row].numpy()
            mujoco.mj_forward(model, data)
            fresh = [bool(data.sensor(name).data[0] > 0) for name in HIT_SENSORS]
            found += fresh
            assert all(hit or not now for hit, now in zip(env.physics.hits[row].tolist(), fresh, strict=True))
    assert any(found)


def test_a_diverged_trial_counts_from_where_it_was(standing, states):
    class Exploding(Standing):
        steps = 0

        def act(self, obs):
            self.steps += 1
            if self.steps == 3:
                env.physics.qvel[1] = float("inf")
            return super().act(obs)

    class Seen(start.TransportEnv):
        def __init__(self, *args, **kwargs):
            nonlocal env
            super().__init__(*args, **kwargs)
            env = self

    env = None
    place = Scene("far", bounds_m=((-0.5, -1.0, 0.0), (4.5, 1.0, 1.5)), start=(2.0, 0.0, 0.0), goal=(2.5, 0.0))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(start, "TransportEnv", Seen)
        trials = score_block(Exploding(standing.meta), place, states, 0, CALM)
    assert trials.outcome[1] == "unstable" and 0.4 < trials.distance_m[1] < 0.6
    assert not Path("MUJOCO_LOG.TXT").exists()


def test_the_papers_trial(standing):
    asked = Conditions()
    config = asked.task(standing.meta["task"])
    assert (asked.horizon_s, config.goal_radius_m, config.control_dt_s, asked.limit(config)) == (5.0, 0.1, 0.02, 250)
    assert config.max_steps > 300 and not config.end_at_goal and not config.collisions and config.anywhere == 0.0
    assert config.leg_scale_rad == standing.meta["task"]["leg_scale_rad"]
    assert (config.physics_dt_s, config.substeps, asked.elliptic) == (0.002, 10, True)
    paper = Conditions(protocol="paper")
    config = paper.task(standing.meta["task"])
    assert (config.physics_dt_s, config.substeps, paper.elliptic) == (0.005, 4, False)


def test_training_tolerances_do_not_soften_the_score(standing):
    task = standing.meta["task"] | {"goal_radius_m": 0.5, "episode_s": 20.0, "collisions": False, "tolerance_m": 0.05}
    assert CALM.task(task) == CALM.task(standing.meta["task"])


def tiny_evaluation(policy, out, **changes):
    near_scene, wall = Path("near.json"), Path("wall.json")
    near(0.04).save(near_scene)
    blocked((0.55, 0.0, 0.85), BoxShape((0.3, 0.3, 0.1))).save(wall)
    given = dict(
        policy=str(policy),
        scenes=(str(near_scene), str(wall)),
        rollouts=3,
        seed=5,
        out=out,
        objects=2,
        batch=2,
        horizon_s=1.0,
    )
    return EvaluateConfig(**given | dict(threads=1) | changes)


def test_report(onnx_file, tmp_path, capsys):
    out = tmp_path / "report.json"
    report = evaluate(tiny_evaluation(onnx_file, out))
    assert json.loads(out.read_text()) == report
    assert REPORT <= set(report) and report["format"] == "hotice-report/1" and report["perturbed"]
    assert (report["seed"], report["rollouts"]) == (5, 3)
    assert [r["name"] for r in report["scenes"]] == ["near", "blocked"]
    for row in report["scenes"]:
        assert ROW <= set(row) and row["rollouts"] == 3
        causes = sum(row[k] for k in (*(ROW - {"name", "rollouts", "success_rate", "mean_distance_m"}), "unstable"))
        wins = round(row["success_rate"] * 3)
        assert causes + wins == 3
        assert row["success_interval_95"] == pytest.approx(success_interval(wins, 3), abs=1e-4)
    rates = [r["success_rate"] for r in report["scenes"]]
    assert report["success_rate"] == pytest.approx(sum(rates) / 2) == 0.5
    assert report["mean_distance_m"] == pytest.approx(sum(r["mean_distance_m"] for r in report["scenes"]) / 2)
    assert report["referees"] == ["exact", "points"]
    near_row, wall = report["scenes"]
    assert near_row["points"]["success_rate"] == 1.0 and near_row["standing_share"] is not None
    assert wall["standing_share"] is None and wall["mean_distance_at_limit_m"] == wall["mean_distance_m"]
    assert report["points"]["success_interval_95"] == pytest.approx(success_interval(3, 6), abs=1e-4)
    printed = capsys.readouterr().out
    assert "near" in printed and "noise" in printed and "points" in printed
    assert all(len(line) <= 130 for line in printed.splitlines())
    kept = json.loads((tmp_path / "report.json.trials" / "scene-001.json").read_text())
    assert kept["name"] == "blocked" and kept["rollouts"] == 3 and set(kept["blocks"]) == {"0", "1"}


def test_single_sources_of_noise_can_be_switched_off(onnx_file, tmp_path, capfd):
    out = tmp_path / "r.json"
    full = evaluate(tiny_evaluation(onnx_file, out))
    capfd.readouterr()
    report = evaluate(tiny_evaluation(onnx_file, out, without=("pushes", "delay")))
    shown = capfd.readouterr()
    assert full["without"] == [] and report["without"] == ["pushes", "delay"]
    assert json.loads(out.read_text())["without"] == ["pushes", "delay"]
    assert "without pushes, delay" in " ".join(shown.out.split()) and "another without: starting anew" in shown.err


def test_without_reaches_the_environment(standing, states, monkeypatch):
    seen = []

    class Watched(start.TransportEnv):
        def __init__(self, *args, config, **kwargs):
            seen.append(config)
            super().__init__(*args, config=config, **kwargs)

    monkeypatch.setattr(start, "TransportEnv", Watched)
    for sources in ((), ("pushes",), ("dynamics", "root-rate")):
        score_block(standing, near(0.04), states, 0, Conditions(without=sources))
    assert [c.push_m_s for c in seen] == [1.0, 0.0, 1.0] and [c.sensing.root_hz for c in seen] == [10.0, 10.0, 0.0]
    assert [c.dynamics for c in seen] == [ROBOT_DYNAMICS, ROBOT_DYNAMICS, ROBOT_NOMINAL]


@pytest.mark.parametrize(
    "names, words",
    [
        (("exact", "video"), "unknown referee 'video'"),
        (("exact", "exact"), "name each once"),
        (("points",), "exact is needed"),
        ((), "exact is needed"),
    ],
)
def test_referees_given_wrongly_are_refused(names, words):
    with pytest.raises(HoticeError, match=words):
        EvaluateConfig(policy="x", scenes=("open_floor",), referees=names)


def test_one_referee_alone_is_reported_alone(onnx_file, tmp_path, capsys):
    report = evaluate(tiny_evaluation(onnx_file, tmp_path / "r.json", referees=("exact",), rollouts=1))
    assert report["referees"] == ["exact"] and report["points"] is None and report["scenes"][0]["points"] is None
    assert "points" not in capsys.readouterr().out


@pytest.mark.parametrize("changes", [dict(without=("noise",)), dict(without=("pushes",), perturbed=False)])
def test_sources_given_wrongly_are_refused(changes):
    with pytest.raises(HoticeError, match="sensor-noise|nothing is left"):
        EvaluateConfig(policy="x", scenes=("open_floor",), **changes)


def without_source(report):
    return {k: v for k, v in report.items() if k != "source"}


def test_an_interrupted_evaluation_goes_on_and_ends_the_same(onnx_file, tmp_path, monkeypatch, capfd):
    whole = evaluate(tiny_evaluation(onnx_file, tmp_path / "whole.json"))
    out, score, calls = tmp_path / "parts.json", module.score_block, []

    def dying(*args, **kwargs):
        calls.append(kwargs["first"])
        if len(calls) == 3:
            raise KeyboardInterrupt
        return score(*args, **kwargs)

    monkeypatch.setattr(module, "score_block", dying)
    with pytest.raises(KeyboardInterrupt):
        evaluate(tiny_evaluation(onnx_file, out))
    assert not out.exists()
    assert without_source(evaluate(tiny_evaluation(onnx_file, out))) == without_source(whole)
    assert len(calls) == 5 and "2 of 4 blocks" in capfd.readouterr().err


def test_other_settings_start_anew(onnx_file, tmp_path, capfd):
    out = tmp_path / "r.json"
    evaluate(tiny_evaluation(onnx_file, out, rollouts=1))
    capfd.readouterr()
    other = evaluate(tiny_evaluation(onnx_file, out, rollouts=1, seed=6))
    assert "another seed: starting anew" in capfd.readouterr().err
    assert without_source(other) == without_source(
        evaluate(tiny_evaluation(onnx_file, tmp_path / "s.json", rollouts=1, seed=6))
    )


@pytest.mark.slow
def test_processes_change_nothing(onnx_file, tmp_path):
    one = evaluate(tiny_evaluation(onnx_file, tmp_path / "one.json"))
    two = evaluate(tiny_evaluation(onnx_file, tmp_path / "two.json", threads=2))
    assert without_source(one) == without_source(two)
    for name in ("scene-000.json", "scene-001.json"):
        a, b = (json.loads((tmp_path / f"{run}.json.trials" / name).read_text()) for run in ("one", "two"))
        assert a == b


def test_the_digest_of_a_policy_tells_what_it_says_and_does(standing):
    class Leaning(Standing):
        def act(self, obs):
            return torch.full((len(obs), 20), 0.1)

    digests = {
        policy_digest(p) for p in (standing, Leaning(standing.meta), Standing(standing.meta | {"preset": "dual_sgf"}))
    }
    assert len(digests) == 3 and policy_digest(standing) in digests


def test_the_digest_of_a_scene_covers_its_meshes(tmp_path):
    mesh = tmp_path / "wedge.obj"
    corners = "v 0 0 0\nv 0.3 0 0\nv 0 0.3 0\nv 0 0 {}\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    digests = []
    for height in (0.4, 0.4, 0.5):
        mesh.write_text(corners.format(height))
        digests.append(scene_digest(blocked((1.0, 0.0, 0.0), MeshShape("wedge.obj", 1.0, tmp_path))))
    assert digests[0] == digests[1] != digests[2] and scene_digest(near(0.04)) != scene_digest(near(0.05))


def test_no_training_draws_what_an_evaluation_of_the_same_seed_draws(monkeypatch):
    config = EvaluateConfig(policy="carry", scenes=("open_floor",), rollouts=4, seed=2)
    scored = Scorer.of(config).states
    assert len(scored) == 4
    ranges = ObjectRange(shapes=config.shapes, size_m=config.size_m, mass_kg=config.mass_kg)
    trained = CarryBank.sample(ranges, 4, 2, 0.005, torch.device("cpu")).states
    assert not {s.carried for s in scored} & {s.carried for s in trained}
    assert all(TrialSeeds.of(2, load_scene("gap")).block(first) != 2 for first in range(100))


@pytest.mark.parametrize("substeps, timestep_s", [(2, 0.005), (4, 0.005), (1, 0.004)])
def test_the_control_period_of_the_task_is_kept(standing, substeps, timestep_s):
    task = {**standing.meta["task"], "substeps": substeps, "physics_dt_s": timestep_s}
    for protocol, most in (("robot", 0.002), ("paper", 0.005)):
        asked = replace(CALM, protocol=protocol).task(task)
        assert asked.physics_dt_s <= most + 1e-12
        assert asked.control_dt_s == pytest.approx(substeps * timestep_s)


def test_sums_of_trials():
    trials = Trials.joined(
        [
            Trials(outcome=("success", "fall"), distance_m=(0.05, 1.0), time_s=(2.0, 1.0)),
            Trials(outcome=("fall",), distance_m=(1.5,), time_s=(0.5,)),
        ]
    )
    row = trials.summary()
    assert row["success_rate"] == pytest.approx(1 / 3) and row["mean_distance_m"] == pytest.approx(0.85)
    assert row["mean_success_time_s"] == 2.0 and row["falls"] == 2 and row["drops"] == 0
    assert Trials().summary()["success_interval_95"] == [0.0, 1.0]


def test_a_policy_of_another_layout_is_refused(onnx_file, states):
    policy = Standing(load_policy(onnx_file).meta | {"layout": [["gyro", 3]]})
    with pytest.raises(CheckpointError, match="3 numbers are read, 201 given"):
        score_block(policy, load_scene("open_floor"), states[:1], 0, CALM)


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
