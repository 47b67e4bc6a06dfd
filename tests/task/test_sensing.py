"""The delay model and the rates of sensors: numbers and rules that a batch and a single robot share."""

import numpy as np
import pytest
import torch

from hotice.sim.sensing import Sensors
from hotice.task import sensing
from hotice.task.sensing import STUDENT_SENSING, SensingConfig, draw_delays, reads_late


def batch(config, n=4000, control_dt_s=0.02, substeps=4):
    """Sensors of n episodes that have just begun."""
    sensors = Sensors(
        config, n, control_dt_s, substeps, torch.device("cpu"), lambda motion, ids: {}, torch.zeros(3).bool(), []
    )
    sensors.restart(torch.arange(n), torch.Generator().manual_seed(0))
    return sensors


@pytest.mark.parametrize(
    "delay_s, control_dt_s, substeps, steps",
    [(0.0, 0.02, 4, 0), (0.02, 0.02, 4, 4), (0.02, 0.02, 10, 10), (0.01, 0.02, 4, 2), (0.1, 0.02, 4, 4)],
)
def test_the_longest_delay_is_a_control_step(delay_s, control_dt_s, substeps, steps):
    config = SensingConfig(action_delay_s=delay_s)
    assert config.longest_delay(control_dt_s, substeps) == steps
    sensors = batch(config, 400, control_dt_s, substeps)
    drawn = [draw_delays(config, control_dt_s, substeps, seed)[1] for seed in range(400)]
    assert set(sensors.action_delay.tolist()) == set(range(steps + 1))
    np.testing.assert_allclose(sorted(set(drawn)), control_dt_s / substeps * np.arange(steps + 1), atol=1e-12)


@pytest.mark.parametrize("share", [0.5, 0.2])
def test_so_many_episodes_are_late(share, monkeypatch):
    """Also with another share than the task's: the batch's constant is that of the one robot."""
    monkeypatch.setattr(sensing, "LATE_SHARE", share)
    one = np.mean([draw_delays(STUDENT_SENSING, 0.02, 4, seed)[0] for seed in range(1000)])
    assert batch(STUDENT_SENSING).late.float().mean() == pytest.approx(share, abs=0.03)
    assert one == pytest.approx(share, abs=0.05)
    assert not batch(SensingConfig()).late.any() and not draw_delays(SensingConfig(), 0.02, 4, 0)[0]


def test_the_first_measurement_is_never_late():
    assert [reads_late(True, count) for count in (1, 2, 3)] == [False, True, True] and not reads_late(False, 3)
    late, count = torch.tensor([True, True, False]), torch.tensor([1, 2, 2])
    assert reads_late(late, count).tolist() == [False, True, False]
    sensors = batch(STUDENT_SENSING, 2)
    sensors.late[:], ids = torch.tensor([True, False]), torch.arange(2)
    read = []
    for k in range(3):
        sensors.age[:] = k + 1
        read.append(sensors.delay(torch.full((2, 3), float(k)), ids)[:, 0].tolist())
    assert read == [[0.0, 0.0], [0.0, 1.0], [1.0, 2.0]]


@pytest.mark.parametrize("hz, dt_s, steps", [(0.0, 0.02, 1), (10.0, 0.02, 5), (50.0, 0.02, 1), (200.0, 0.02, 1)])
def test_refreshes_come_in_whole_steps(hz, dt_s, steps):
    config = SensingConfig(root_hz=hz)
    assert config.hold_steps(dt_s) == steps == batch(config, 1).hold_steps


@pytest.mark.parametrize("time_s, gain", [(0.0, 1.0), (0.2, 0.1), (0.01, 1.0)])
def test_the_filter_forgets_with_its_time(time_s, gain):
    config = SensingConfig(object_filter_s=time_s)
    assert config.object_gain(0.02) == pytest.approx(gain) and batch(config, 1).gain == pytest.approx(gain)
