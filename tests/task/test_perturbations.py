from dataclasses import fields, replace

import pytest

from hotice.errors import UnknownName
from hotice.model.dynamics import DynamicsConfig
from hotice.sim import TaskConfig
from hotice.task.perturbations import SENSED, SOURCES, without
from hotice.task.sensing import SensingConfig


def test_every_field_of_sensing_belongs_to_one_source():
    assert sorted(name for names in SENSED.values() for name in names) == sorted(f.name for f in fields(SensingConfig))


@pytest.mark.parametrize("source", SOURCES)
def test_one_source_goes_and_the_others_stay(source):
    task = TaskConfig().perturbed()
    less = without(task, [source])
    gone = {name: getattr(SensingConfig(), name) for name in SENSED.get(source, ())}
    assert less.sensing == replace(task.sensing, **gone) and (less.sensing != task.sensing) == (source in SENSED)
    assert less.push_m_s == (0.0 if source == "pushes" else task.push_m_s)
    assert less.dynamics == (DynamicsConfig() if source == "dynamics" else task.dynamics)
    assert replace(less, sensing=task.sensing, push_m_s=task.push_m_s, dynamics=task.dynamics) == task


def test_without_all_of_them_the_task_is_that_of_a_teacher():
    task = TaskConfig().perturbed()
    assert without(task, SOURCES) == TaskConfig() and without(task, ()) == task


def test_an_unknown_source_lists_the_known():
    with pytest.raises(UnknownName, match="object-noise"):
        without(TaskConfig(), ["wind"])
