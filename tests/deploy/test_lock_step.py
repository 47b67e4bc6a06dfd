"""The whole deployment in lock step, as the benchmark runs it: trained noise and delays, poses, tags."""

import pytest

from benchmarks.deploy import BOX, run_trial
from hotice.deploy.programs.prepare import Prepared
from hotice.deploy.simulated import SimulatedRobotConfig
from hotice.fields import build_hod_pf
from hotice.model import load_scene
from hotice.policy import PolicyTask, open_policy
from tests.deploy.simulated_fixture import carry


@pytest.mark.slow
def test_a_carry_through_the_gap_is_scored():
    """The same every time."""
    pytest.importorskip("cv2", reason="tags need the extra `deploy`")
    policy = open_policy("student")
    task = PolicyTask.from_meta(policy.meta, policy.name)
    made = Prepared(policy, build_hod_pf(load_scene("gap"), task.resolution_m, task.margin_m), carry(BOX))
    config = SimulatedRobotConfig(box=BOX, delays="trained", dynamics="drawn", seed=1000)
    first = run_trial(made, config)
    assert first.outcome == "success" and first.stayed and first.refused == 0
    assert 2.0 < first.time_s < 5.0 and first == run_trial(made, config)
