"""What a fall, a drop, an arrival and an outcome are: the same for numbers, arrays and tensors, and for all who ask."""

import math
import subprocess
import sys
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import torch

from hotice.evaluate.referees import Signals, exact
from hotice.model import Box, builder, g1
from hotice.model.carry import Posture, solve_carry
from hotice.model.generate.traversable import REACHED_M
from hotice.model.robot_state import RobotState
from hotice.sim.terminations import TERMINATIONS
from hotice.task import rules
from hotice.task.config import TaskConfig
from hotice.task.judge import Judge

LOW = Posture(pelvis_height_m=0.48, lean_rad=0.2)
KINDS = (np.array, torch.tensor)


@pytest.fixture(scope="module", params=[20, 29])
def carried(request):
    """Model and state of a robot that crouches with its load, the pelvis 0.48 m high: a valid carry state."""
    state = solve_carry(Box((0.3, 0.3, 0.3), 1.5), LOW)
    model = builder.build_model(state.carried, joints=request.param, wrist_pos=state.wrist_pos, floor=False)
    qpos = state.qpos() if request.param == 20 else RobotState.from_carry(state).to_mujoco(29)[0]
    return model, qpos


def snapshot_of(model, data):
    """What terminations read of a MuJoCo state, as a batch of one."""
    hands = torch.tensor(data.site_xpos[[model.site(name).id for name in g1.OGF_KEYPOINTS]])
    no = torch.zeros(1, dtype=torch.bool)
    return SimpleNamespace(
        p_WP=torch.tensor(data.body("pelvis").xpos)[None],
        gravity_P=-torch.tensor(data.body("pelvis").xmat.reshape(3, 3)[2])[None],
        p_WK=torch.cat([torch.zeros(9, 3), hands])[None],
        p_WO=torch.tensor(data.body(builder.OBJECT_BODY).xpos)[None],
        robot_hit=no,
        object_hit=no,
    )


def judged(model, qpos, shift=(0, 0, 0), lean=0.0, object_shift=(0, 0, 0), speed=0.0):
    """(by a Judge, by a Judge of rehearsals, by the table of terminations) of a changed state, "" for nothing."""
    data, at = mujoco.MjData(model), int(model.joint("object_free").qposadr[0])
    data.qpos[:] = qpos
    data.qpos[:3] += shift
    data.qpos[at : at + 3] += np.add(shift, object_shift)
    if lean:
        data.qpos[3:7] = np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0
    data.qvel[:3] = speed
    mujoco.mj_kinematics(model, data)
    s = snapshot_of(model, data)
    by_table = next((row.name for row in TERMINATIONS if row.condition(s)[0]), "")
    return Judge(model).failure(data), Judge(model, rules.falling).failure(data), by_table


def test_a_robot_that_crouches_with_its_load_has_not_fallen(carried):
    assert carried[1][2] == pytest.approx(0.48, abs=0.01)
    assert judged(*carried) == ("", "", "")


@pytest.mark.parametrize("height_m", [0.40, 0.45, 0.60, 0.785])
@pytest.mark.parametrize("lean_rad", [-0.2, 0.6])
def test_no_posture_of_a_carry_state_is_a_fall(height_m, lean_rad):
    posture = Posture(pelvis_height_m=height_m, lean_rad=lean_rad)
    assert not rules.falling(posture.pelvis_height_m - 0.03, math.cos(posture.lean_rad))  # 3 cm: what servos give


@pytest.mark.parametrize(
    "change, expected",
    [
        (dict(shift=(0, 0, 0.34 - 0.48)), ("fall", "fall", "fall")),
        (dict(shift=(0, 0, 0.36 - 0.48)), ("", "", "")),
        (dict(object_shift=(0.16, 0, 0)), ("drop", "drop", "drop")),
        (dict(object_shift=(0, -0.13, 0)), ("", "", "")),
        (dict(speed=1.1e3), ("unstable", "unstable", "")),
    ],
)
def test_all_judge_alike(carried, change, expected):
    assert judged(*carried, **change) == expected


@pytest.mark.parametrize("degrees, expected", [(61, ("fall", "fall", "fall")), (50, (None, "fall", None))])
def test_a_rehearsal_minds_leaning_more(carried, degrees, expected):
    """The load goes its own way here, so without a fall it is a drop."""
    found = judged(*carried, lean=np.deg2rad(degrees))
    assert found == tuple("drop" if name is None else name for name in expected)


def test_all_follow_the_rules_where_these_change(carried, monkeypatch):
    monkeypatch.setattr(rules, "FALLEN_M", 0.5)
    assert judged(*carried) == ("fall", "fall", "fall")
    monkeypatch.setattr(rules, "FALLEN_M", 0.1)
    monkeypatch.setattr(rules, "APART_M", 0.3)
    assert judged(*carried, shift=(0, 0, -0.3), object_shift=(0, 0, 0.25)) == ("", "", "")
    monkeypatch.setattr(rules, "LOW_M", 1.5)
    assert judged(*carried) == ("drop", "drop", "drop")


@pytest.mark.parametrize("kind", KINDS)
def test_right_values_of_either_kind(kind):
    height, up = kind([0.34, 0.36, 0.36, 0.36]), kind([1.0, 1.0, 0.49, 0.6])
    assert rules.fallen(height, up).tolist() == [True, False, True, False]
    assert rules.falling(height, up).tolist() == [True, False, True, True]
    assert rules.dropped(kind([0.14, 0.16, 0.0]), kind([0.26, 0.9, 0.24])).tolist() == [False, True, True]
    assert rules.arrived(kind([0.099, 0.101])).tolist() == [True, False]
    assert rules.arrived(kind([0.099, 0.101]), 0.2).tolist() == [True, True]
    qpos, qvel = np.zeros((6, 27)), np.zeros((6, 26))
    qpos[1, 20], qpos[2, 1], qvel[3, 9], qvel[4, 9], qpos[5, 20] = np.nan, 1.1e3, -1.1e3, np.inf, 2e3
    assert rules.diverged(kind(qpos), kind(qvel)).tolist() == [False, True, True, True, True, False]


@pytest.mark.parametrize("kind", KINDS)
def test_the_worse_of_two_events_counts(kind):
    for i, name in enumerate(rules.PRECEDENCE):
        seen = {other: kind([True, False]) for other in rules.PRECEDENCE[i:]}
        found = rules.outcome_code(kind([0, 0]), **seen)
        assert [rules.OUTCOMES[code] for code in found.tolist()] == [name, "running"]


def test_referees_decide_by_that_order():
    yes, far = np.ones((1, 1), dtype=bool), np.full((1, 1), 9.0)
    signals = {name: yes for name in ("unstable", "fall", "drop", "robot_hit", "object_hit")}
    gaps = dict(robot_gap_m=far, object_gap_m=far, self_depth_m=far, goal_m=np.zeros((1, 1)), met=~yes, way_m=far)
    for name in ("unstable", "fall", "drop", "robot_hit", "object_hit"):
        outcome = name.replace("hit", "collision")
        assert exact(Signals(**signals, **gaps), 1).outcome == (outcome,)
        signals[name] = ~yes
    assert exact(Signals(**signals, **gaps), 1).outcome == ("success",)
    assert exact(Signals(**signals, **(gaps | {"goal_m": far})), 1).outcome == ("timeout",)


def test_names_and_radii_agree():
    assert set(rules.PRECEDENCE) == set(rules.OUTCOMES) - {"running"} and rules.OUTCOMES[0] == "running"
    assert [row.name for row in TERMINATIONS] == [n for n in rules.PRECEDENCE if n in {r.name for r in TERMINATIONS}]
    assert TaskConfig().goal_radius_m == rules.GOAL_M == 0.1 and REACHED_M <= rules.GOAL_M


@pytest.mark.parametrize("name", ["config", "history", "judge", "perturbations", "policy_task", "protocols", "rules"])
def test_the_task_needs_neither_torch_nor_the_simulation(name):
    code = f"import sys, hotice.task.{name}; print(*(m for m in sys.modules if m == 'torch' or 'hotice.sim' in m))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"
