import torch

from hotice.learn.curriculum import SceneCurriculum


def test_scenes_at_the_edge_of_skill_come_first():
    curriculum = SceneCurriculum(3, torch.device("cpu"))
    ended = torch.full((3,), 200.0)
    for _ in range(10):
        curriculum.update(ended, torch.tensor([200.0, 100.0, 0.0]))
    weights = curriculum.weights()
    torch.testing.assert_close(curriculum.rate, torch.tensor([1.0, 0.5, 0.0]), atol=1e-3, rtol=0)
    torch.testing.assert_close(weights, torch.tensor([0.25, 1.25, 0.25]), atol=1e-2, rtol=0)


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
