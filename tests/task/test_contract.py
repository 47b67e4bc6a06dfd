"""The numbers of the task, each defined once: whoever takes them by default takes the same."""

import inspect
import subprocess
import sys
from dataclasses import fields, replace

import pytest

from hotice.errors import InvalidConfig
from hotice.evaluate.conditions import KEPT, Conditions
from hotice.fields import FieldParams, build_hod_pf, defaults, query
from hotice.fields.bank import FieldBank
from hotice.fields.reachability import check_reachable
from hotice.learn.distill.teachers import contract
from hotice.systems.setup.config import StationConfig
from hotice.task.config import TaskConfig
from hotice.task.contract import ROWS, STEP, UNITS, Contract
from hotice.task.policy_task import PolicyTask
from hotice.task.presets import PRESETS

OTHER = dict(
    physics_dt_s=0.0025,
    substeps=6,
    leg_scale_rad=0.25,
    arm_scale_rad=0.2,
    action_limit=3.0,
    speed_m_s=0.5,
    stop_gain_hz=2.0,
    gait_hz=1.2,
    resolution_m=0.05,
    margin_m=0.1,
    scan=True,
    history=3,
)
"""A contract that differs from the default everywhere."""


def test_the_paper_and_the_defaults():
    """The paper's numbers, and ours, as a reader expects them."""
    task = TaskConfig()
    assert (FieldParams().attraction, task.margin_m, task.goal_radius_m, task.episode_s) == (0.6, 0.08, 0.1, 5.0)
    assert (task.resolution_m, task.speed_m_s, task.stop_gain_hz, task.control_dt_s) == (0.04, 0.7, 3.0, 0.02)
    assert PolicyTask() == PolicyTask(**{f.name: getattr(task, f.name) for f in fields(Contract)})


def test_a_contract_has_three_parts():
    names = [f.name for f in fields(Contract)]
    assert sorted([*STEP, *ROWS, *UNITS]) == sorted(names) == sorted(OTHER) and len(UNITS) == 8


@pytest.mark.parametrize("function", [build_hod_pf, FieldBank.build, check_reachable])
def test_fields_are_built_as_for_the_task(function):
    taken = {name: p.default for name, p in inspect.signature(function).parameters.items()}
    assert (taken["margin_m"], taken["resolution_m"]) == (TaskConfig().margin_m, TaskConfig().resolution_m)


def test_commands_as_for_the_task():
    taken = {name: p.default for name, p in inspect.signature(query).parameters.items()}
    assert (taken["speed_m_s"], taken["stop_gain_hz"]) == (TaskConfig().speed_m_s, TaskConfig().stop_gain_hz)
    assert FieldParams().attraction == defaults.ETA
    assert StationConfig().push_interval_s == TaskConfig().push_interval_s


@pytest.mark.parametrize("preset", PRESETS)
def test_a_policy_file_keeps_the_whole_contract(preset):
    """Also where every number differs from the default."""
    task = PolicyTask.from_meta({"preset": preset, "task": vars(replace(TaskConfig(), **OTHER))})
    assert {name: getattr(task, name) for name in OTHER} == OTHER
    assert task.object_field == PRESETS[preset].object_field and task.control_dt_s == pytest.approx(0.015)


def test_an_evaluation_keeps_the_contract():
    """Of the step it keeps the period, and simulates it as its protocol does."""
    task = Conditions(protocol="robot", perturbed=False).task(OTHER)
    assert set(OTHER) <= set(KEPT)
    assert {name: getattr(task, name) for name in (*UNITS, *ROWS)} == {name: OTHER[name] for name in (*UNITS, *ROWS)}
    assert task.control_dt_s == pytest.approx(0.015) and task.physics_dt_s <= 0.002


@pytest.mark.parametrize("name", OTHER)
def test_teachers_must_share_what_is_not_free(name):
    ours, theirs = vars(TaskConfig()), vars(TaskConfig()) | {name: OTHER[name]}
    assert (contract(ours) == contract(theirs)) == (name in ROWS)
    finer = ours | {"physics_dt_s": 0.0025, "substeps": 8}
    assert contract(ours) == contract(finer)


def test_numbers_cost_no_compiler():
    code = "import sys, hotice.task.policy_task, hotice.task.contract; print('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


@pytest.mark.parametrize("name", ["scan", "collisions", "end_at_goal"])
def test_switches_are_true_or_false(name):
    with pytest.raises(InvalidConfig, match=f"^{name} is 'no': true or false is needed$"):
        TaskConfig(**{name: "no"})
