from types import SimpleNamespace

import torch

from hotice.learn.train.statistics import EpisodeStatistics
from hotice.task.rules import OUTCOMES

TIMEOUT, FALL = OUTCOMES.index("timeout"), OUTCOMES.index("fall")


def step(outcome, reached, touched=(False, False), distance=(1.0, 1.0), length=(10, 20)):
    return SimpleNamespace(
        outcome=torch.tensor(outcome),
        reached=torch.tensor(reached),
        touched=torch.tensor(touched),
        goal_distance=torch.tensor(distance),
        length=torch.tensor(length),
        scene=torch.tensor([0, 1]),
    )


def test_first_arrival_counts_whatever_ends_the_episode():
    stats = EpisodeStatistics(2, 2, torch.device("cpu"))
    stats.add(step([0, 0], [True, False]))
    stats.add(step([FALL, TIMEOUT], [False, False], distance=(0.2, 0.6)))
    log, ended, successes = stats.pop()
    assert ended.tolist() == [1.0, 1.0] and successes.tolist() == [1.0, 0.0]
    assert log["share/reached"] == 0.5 and log["share/fall"] == 0.5 and log["share/timeout"] == 0.5
    assert abs(log["distance_m"] - 0.4) < 1e-6 and log["length"] == 15.0


def test_arrival_after_a_touch_does_not_count():
    stats = EpisodeStatistics(2, 2, torch.device("cpu"))
    stats.add(step([0, 0], [False, False], touched=(True, False)))
    stats.add(step([TIMEOUT, TIMEOUT], [True, True]))
    _, _, successes = stats.pop()
    assert successes.tolist() == [0.0, 1.0]


def test_nothing_is_carried_into_the_next_episode_or_interval():
    stats = EpisodeStatistics(2, 2, torch.device("cpu"))
    stats.add(step([FALL, FALL], [True, True]))
    stats.pop()
    stats.add(step([FALL, FALL], [False, False]))
    log, _, successes = stats.pop()
    assert successes.tolist() == [0.0, 0.0] and log["episodes"] == 2.0
    assert stats.pop()[0] == {"episodes": 0.0}


def test_an_episode_that_did_not_begin_at_its_first_step_does_not_count():
    stats = EpisodeStatistics(2, 2, torch.device("cpu"))
    stats.whole[0] = False
    stats.add(step([0, 0], [True, True]))
    stats.add(step([TIMEOUT, TIMEOUT], [False, False], length=(250, 2)))
    log, ended, successes = stats.pop()
    assert ended.tolist() == [0.0, 1.0] and successes.tolist() == [0.0, 1.0] and log["length"] == 2.0
    assert stats.whole.tolist() == [True, True] and not stats.reached.any()
    stats.add(step([FALL, 0], [False, False], length=(3, 3)))
    assert stats.pop()[1].tolist() == [1.0, 0.0]
