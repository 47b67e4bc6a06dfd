"""Trials among obstacles that move: exact geometry moves, and who walks into whom is told apart."""

import json

import mujoco
import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig, InvalidScene
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.config import EvaluateConfig
from hotice.evaluate.run import evaluate
from hotice.evaluate.scorer import Scorer, score_block
from hotice.evaluate.start import start_trials
from hotice.learn.policy import load_policy
from hotice.model import Box, Obstacle, Scene, load_scene
from hotice.model.builder import HIT_SENSORS, build_model
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape, SphereShape
from hotice.model.moving import Motion, WayPoint, walking_person
from hotice.task.moving import MovingConfig

CALM = Conditions(perturbed=False)


@pytest.fixture(scope="module")
def states():
    return [solve_carry(Box((0.3, 0.3, 0.3), 1.0))]


class Standing:
    """Holds still: the zero action."""

    name = "standing"

    def __init__(self):
        self.meta = load_policy("student", threads=1).meta

    def act(self, obs):
        return torch.zeros(len(obs), 20)


def ball(*points, radius=0.1, z=0.95, name="ball"):
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(x, y, z)) for t, x, y in points))
    return Obstacle(name, "side", SphereShape(radius), (*points[0][1:], z), motion=course)


def test_models_hold_what_moves_as_bodies_of_their_own():
    wall = Obstacle("wall", "side", BoxShape((0.1, 0.3, 1.0)), (1.0, 0.9, 0.5))
    carried, still = Box((0.3, 0.3, 0.3), 1.0), Scene("s", obstacles=(wall,))
    person = walking_person("ann", [(1.5, -0.8), (1.5, 0.8)], 0.8)
    model = build_model(carried, Scene("s", obstacles=(person[0], wall, person[1])))
    assert model.nmocap == 2 and model.nv == build_model(carried, still).nv
    bodies = [model.body(f"obstacle/ann_{part}") for part in ("legs", "trunk")]
    assert [int(b.mocapid[0]) for b in bodies] == [0, 1]
    for body, obstacle in zip(bodies, person, strict=True):
        np.testing.assert_allclose(body.pos, obstacle.position_m)
    names = [model.sensor(i).name for i in range(model.nsensor)]
    assert names[-7:-4] == [*HIT_SENSORS, "self_contact"]
    assert names[-4:] == [f"{s}/{n}" for n in ("ann_legs", "ann_trunk") for s in HIT_SENSORS]
    same = build_model(carried, still)
    assert same.nmocap == 0 and "/" not in "".join(same.sensor(i).name for i in range(same.nsensor))


def test_a_ball_that_comes_hits_when_and_where_it_should(states):
    """A robot that stands, and a ball that flies at its box: a contact as soon as ball and box meet."""
    scene = Scene("s", obstacles=(ball((0.0, 1.5, 0.0), (1.5, 0.0, 0.0)),))
    trials = score_block(Standing(), scene, 3 * states, 0, CALM, judges=("exact",))
    assert trials.outcome == ("walked_into",) * 3
    front_m = float(states[0].object_pos_W[0]) + 0.15
    # the box is 3 cm off at most, and ahead by a lean of less than that
    expected_s = 1.5 - (front_m + 0.1)
    assert all(abs(t - expected_s) < 0.06 for t in trials.time_s)
    behind = Scene("s", obstacles=(ball((0.0, -1.5, 0.0), (1.2, -0.6, 0.0)),))
    assert set(score_block(Standing(), behind, states, 0, Conditions(perturbed=False, horizon_s=1.3)).outcome) <= {
        "timeout",
        "fall",
    }


def test_what_has_stopped_walks_into_nobody(states):
    """A box that was pushed there and rests is an obstacle as any other: whoever touches it has."""
    course = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(0.9, y, 0.5)) for t, y in ((0.0, 0.8), (0.6, 0.0))))
    crate = Obstacle("crate", "side", BoxShape((0.3, 0.6, 1.2)), (0.9, 0.8, 0.5), motion=course)
    carry = load_policy("student", threads=1)
    asked = Conditions(perturbed=False, moving=MovingConfig(known="still"))
    trials = score_block(carry, Scene("s", obstacles=(crate,)), states, 0, asked, judges=("exact",))
    assert set(trials.outcome) <= {"robot_collision", "object_collision"}


def test_a_robot_that_walks_runs_into_who_crosses_unseen(states):
    """Blind to what moves it collides; nothing but the knowledge differs."""
    person = walking_person("ann", [(1.2, 0.0), (1.2, -0.02)], 0.004)
    scene = Scene("s", ((-0.5, -1.5, 0.0), (2.5, 1.5, 1.5)), obstacles=person)
    policy = load_policy("student", threads=1)
    asked = Conditions(perturbed=False, moving=MovingConfig(known="still"))
    blind = score_block(policy, scene, states, 0, asked, judges=("exact",))
    assert set(blind.outcome) <= {"robot_collision", "object_collision"}


def test_the_simulated_geometry_is_where_the_scene_says(states):
    scene = Scene("s", obstacles=walking_person("ann", [(1.5, -0.9), (1.5, 0.9)], 1.0, start_s=0.1))
    env = start_trials(scene, 2 * states, 0, CALM, trained=load_policy("student", threads=1).meta["task"])
    env.reset()
    for k in range(1, 16):
        env.step(torch.zeros(2, 20))
        time_s = k * env.config.control_dt_s
        then = scene.at(time_s)
        data = env.physics.batch.get_data(1)
        for m, obstacle in enumerate(then.obstacles):
            np.testing.assert_allclose(data.mocap_pos[m], obstacle.position_m, atol=1e-5)
            body = env.physics.models[0].body(f"obstacle/{obstacle.name}").id
            np.testing.assert_allclose(data.xpos[body], obstacle.position_m, atol=1e-5)
            assert mujoco.mj_name2id(env.physics.models[0], mujoco.mjtObj.mjOBJ_BODY, "obstacles") != body
        # and so are the distances: those of the cover's spheres to the capsules
        seen = env.snapshot()
        cover, x = env.reader.robot_cover, env.physics
        p_W = x.xpos[:, cover.frame] + (x.xmat[:, cover.frame] @ cover.centre[0].double()[..., None]).squeeze(-1)
        gaps = then.signed_distance(p_W.numpy()) - cover.radius[0].numpy()
        np.testing.assert_allclose(seen.clearance, gaps.min(axis=1), atol=1e-4)


def test_what_is_known_decides_what_is_read(states):
    """The true snapshot sees movers where they are; the measured one where they were seen and went on from."""
    scene = Scene("s", obstacles=walking_person("ann", [(1.0, -0.9), (1.0, 0.9)], 1.4))
    trained = load_policy("student", threads=1).meta["task"]
    read = {}
    for known in ("still", "near", "live"):
        asked = Conditions(moving=MovingConfig(known=known))
        env = start_trials(scene, states, 0, asked, trained=trained)
        first, _ = env.reset()
        steps = [first]
        for _ in range(40):
            steps.append(env.step(torch.zeros(1, 20)).policy)
        read[known] = torch.stack(steps)
        assert torch.isfinite(read[known]).all()
    quiet = start_trials(scene, states, 0, Conditions(), trained=trained)
    assert quiet.policy_table.layout() == env.policy_table.layout()
    assert not torch.equal(read["still"], read["near"]) and not torch.equal(read["near"], read["live"])
    fields = env.policy_table.columns(["sgf", "ogf", "scan", "command"])
    same = ~fields & ~env.policy_table.columns(["history", "last_action"])
    np.testing.assert_array_equal(read["still"][..., same], read["near"][..., same])


def test_still_scenes_do_not_ask_what_is_known(states):
    scene, policy = load_scene("gap"), load_policy("student", threads=1)
    short = [
        score_block(policy, scene, 2 * states, 1, Conditions(horizon_s=0.5, moving=MovingConfig(known=known)))
        for known in ("still", "live")
    ]
    assert short[0] == short[1] and "walked_into" not in short[0].summary()


def test_a_report_counts_it_apart(tmp_path, capsys):
    Scene("flies", obstacles=(ball((0.0, 1.2, 0.0), (0.9, 0.3, 0.0)),)).save(tmp_path / "flies.json")
    asked = {"policy": "student", "rollouts": 2, "threads": 1, "horizon_s": 0.6, "perturbed": False, "objects": 1}
    scenes = (str(tmp_path / "flies.json"), "gap")
    report = evaluate(EvaluateConfig(scenes=scenes, out=tmp_path / "r.json", moving="still", **asked))
    flies, gap = report["scenes"]
    assert "walked_into" in flies and "walked_into" not in gap and report["moving"] == "still"
    counted = sum(flies[k] for k in ("walked_into", "robot_collisions", "object_collisions"))
    assert counted == 2 and json.loads((tmp_path / "r.json").read_text()) == report
    text = capsys.readouterr().out
    assert "walked" in text and "of movers known: still" in text
    assert "moving" not in evaluate(EvaluateConfig(scenes=("gap",), **asked))


def test_who_knows_nothing_that_moves_says_so():
    scene = Scene("s", obstacles=(ball((0.0, 1.2, 0.0), (0.9, 0.3, 0.0)),))
    config = EvaluateConfig(controller="walk", scenes=("gap",), rollouts=1, perturbed=False)
    assert Scorer.of(config).scenes
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hotice.evaluate.scorer.resolve_scenes", lambda _: [scene])
        with pytest.raises(InvalidScene, match="obstacle 'ball' moves, which the walking baseline does not know yet"):
            Scorer.of(config)
    with pytest.raises(InvalidConfig, match="known is 'all': known are still, near, live"):
        MovingConfig(known="all")
    with pytest.raises(InvalidConfig, match="sensor_hz is 0"):
        MovingConfig(sensor_hz=0.0)
