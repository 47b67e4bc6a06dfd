import json
from types import SimpleNamespace

import pytest
import torch

from hotice.errors import InvalidConfig
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.train import curriculum as module
from hotice.learn.train.curriculum import SceneCurriculum, Stages
from hotice.learn.train.runner import Runner


def test_scenes_that_still_fail_come_first():
    curriculum = SceneCurriculum(4, torch.device("cpu"))
    ended = torch.full((4,), 200.0)
    for _ in range(10):
        curriculum.update(ended, torch.tensor([200.0, 150.0, 100.0, 0.0]))
    weights = curriculum.weights()
    torch.testing.assert_close(curriculum.rate, torch.tensor([1.0, 0.75, 0.5, 0.0]), atol=1e-3, rtol=0)
    torch.testing.assert_close(weights, torch.tensor([0.25, 1.0, 1.25, 1.25]), atol=1e-2, rtol=0)


def test_no_episodes_change_nothing_and_every_scene_keeps_a_chance():
    curriculum = SceneCurriculum(2, torch.device("cpu"))
    curriculum.update(torch.zeros(2), torch.zeros(2))
    assert curriculum.rate.tolist() == [0.5, 0.5]
    curriculum.rate = torch.tensor([0.0, 1.0])
    assert (curriculum.weights() > 0).all()


def test_few_episodes_move_the_rate_little():
    curriculum = SceneCurriculum(1, torch.device("cpu"), memory=60.0)
    curriculum.update(torch.tensor([20.0]), torch.tensor([20.0]))
    assert abs(curriculum.rate.item() - (0.5 + 0.25 * 0.5)) < 1e-6


# goal distance and object size


class Held:
    """What `Stages` sets, without an environment."""

    def __init__(self):
        self.near = self.small = None

    def hold_back(self, *, far, large):
        self.near = SimpleNamespace(limit_m=3.0, farthest_m=3.0) if far else None
        self.small = SimpleNamespace(share=1.0) if large else None


def test_the_lower_of_the_two_climbs_and_the_higher_falls():
    held = Held()
    stages = Stages(held, 1.0, 0.25, episodes=10)
    assert (held.near.limit_m, held.small.share) == (1.0, 0.25)
    stages.update(9.0, 9.0)
    assert held.near.limit_m == 1.0, "too few episodes"
    stages.update(1.0, 1.0)
    assert (held.near.limit_m, held.small.share) == (pytest.approx(1.2), 0.25)
    stages.update(10.0, 8.0)
    assert (held.near.limit_m, held.small.share) == (pytest.approx(1.2), pytest.approx(0.325))
    stages.update(10.0, 5.0)
    assert stages.rung == {"distance": 1, "objects": 1}, "neither easy nor hopeless"
    stages.update(10.0, 10.0)
    stages.update(10.0, 1.0)
    assert stages.rung == {"distance": 1, "objects": 1}
    for _ in range(40):
        stages.update(10.0, 10.0)
    assert (held.near.limit_m, held.small.share) == (3.0, 1.0)


def test_each_alone_and_neither():
    held = Held()
    stages = Stages(held, 0.0, 0.5, episodes=1)
    for _ in range(3):
        stages.update(1.0, 1.0)
    assert held.near is None and held.small.share == pytest.approx(0.65)
    assert stages.log() == {"curriculum/objects": held.small.share}
    none = Stages(Held(), 0.0, 0.0, episodes=1)
    none.update(5.0, 5.0)
    assert none.state() == {} and none.log() == {}


def test_the_state_comes_back():
    first, second = (Stages(Held(), 1.0, 0.5, episodes=4) for _ in range(2))
    for _ in range(5):
        first.update(3.0, 3.0)
    second.load_state(first.state())
    assert second.rung == first.rung != {"distance": 0, "objects": 0} and second.ended == first.ended
    assert second.starter.near.limit_m == first.starter.near.limit_m
    second.load_state({})
    assert second.rung == first.rung


def test_a_run_with_stages_goes_on_bit_for_bit(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FALL", -1.0)
    monkeypatch.setattr(module, "RISE", -0.5)  # every rate lets it climb
    options = dict(scenes=("open_floor", "gap"), curriculum_distance_m=0.5, curriculum_objects=0.4)
    Runner(tiny(tmp_path / "whole", updates=10, **options)).train()
    Runner(tiny(tmp_path / "parts", updates=6, **options)).train()
    middle = Runner(tiny(tmp_path / "parts", updates=10, resume=True, **options))
    assert sum(middle.stages.rung.values()) > 0 and middle.env.starter.near.limit_m > 0.5
    middle.train()
    a, b = (load_checkpoint(tmp_path / name)[0] for name in ("whole", "parts"))
    assert set(a) == set(b) and [k for k in a if not torch.equal(a[k], b[k])] == []
    assert {"stages.distance", "stages.objects"} <= set(a)
    row = json.loads((tmp_path / "parts" / "log.jsonl").read_text().splitlines()[-1])
    assert row["curriculum/distance_m"] > 0.5 and 0.4 < row["curriculum/objects"] <= 1.0


def test_a_run_without_stages_has_no_trace_of_them(run):
    assert not [k for k in load_checkpoint(run)[0] if k.startswith("stages")]
    assert "curriculum/distance_m" not in (run / "log.jsonl").read_text()


@pytest.mark.parametrize(
    "changes",
    [
        dict(curriculum_distance_m=0.1),
        dict(curriculum_distance_m=float("nan")),
        dict(curriculum_distance_m=-1.0),
        dict(curriculum_objects=1.5),
        dict(curriculum_objects=float("nan")),
    ],
)
def test_impossible_stages_are_refused(tiny, tmp_path, changes):
    with pytest.raises(InvalidConfig, match="curriculum_"):
        tiny(tmp_path, **changes)
