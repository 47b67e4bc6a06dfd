"""Cores that a process may use: affinity and fake control groups of both versions."""

import ast
import os
from pathlib import Path

import pytest

import hotice
from hotice import machine
from hotice.evaluate import processes
from hotice.fields import bank
from hotice.machine import usable_cores
from hotice.sim.physics import threads

PACKAGE = Path(hotice.__file__).parent


@pytest.fixture
def eight(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)


def write(root, files):
    for name, content in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(content)
    return root


V2 = {"proc/self/cgroup": "0::/system.slice/job_7\n"}
V1 = {"proc/self/cgroup": "9:name=systemd:/\n4:memory:/pod\n3:cpu,cpuacct:/pod/job\n0::/\n"}
CPU, POD = "sys/fs/cgroup/system.slice", "sys/fs/cgroup/cpu,cpuacct/pod"


@pytest.mark.parametrize(
    "files, cores",
    [
        ({}, 8),
        (V2, 8),
        ({**V2, f"{CPU}/job_7/cpu.max": "max 100000\n"}, 8),
        ({**V2, f"{CPU}/job_7/cpu.max": "300000 100000\n"}, 3),
        ({**V2, f"{CPU}/job_7/cpu.max": "150000 100000\n"}, 2),
        ({**V2, f"{CPU}/job_7/cpu.max": "20000 100000\n"}, 1),
        ({**V2, f"{CPU}/job_7/cpu.max": "9900000 100000\n"}, 8),
        ({**V2, f"{CPU}/job_7/cpu.max": "max 100000\n", f"{CPU}/cpu.max": "200000 50000\n"}, 4),
        ({**V2, f"{CPU}/job_7/cpu.max": "600000 100000\n", f"{CPU}/cpu.max": "200000 100000\n"}, 2),
        ({"proc/self/cgroup": "0::/\n", "sys/fs/cgroup/cpu.max": "500000 100000\n"}, 5),
        ({"proc/self/cgroup": "0::/../..\n", "sys/fs/cgroup/cpu.max": "500000 100000\n"}, 5),
        ({**V2, f"{CPU}/job_7/cpu.max": "many few\n"}, 8),
        ({**V2, f"{CPU}/job_7/cpu.max": ""}, 8),
        (V1, 8),
        (
            {
                **V1,
                f"{POD}/job/cpu.cfs_quota_us": "-1",
                f"{POD}/job/cpu.cfs_period_us": "1",
            },
            8,
        ),
        ({**V1, f"{POD}/job/cpu.cfs_quota_us": "350000\n", f"{POD}/job/cpu.cfs_period_us": "100000\n"}, 4),
        ({**V1, f"{POD}/cpu.cfs_quota_us": "200000\n", f"{POD}/cpu.cfs_period_us": "100000\n"}, 2),
        ({**V1, "sys/fs/cgroup/cpu/cpu.cfs_quota_us": "60000", "sys/fs/cgroup/cpu/cpu.cfs_period_us": "10000"}, 6),
    ],
)
def test_quotas_of_control_groups(tmp_path, eight, files, cores):
    assert usable_cores(write(tmp_path, files)) == cores


def test_affinity_limits_too(tmp_path, monkeypatch):
    write(tmp_path, {**V2, f"{CPU}/job_7/cpu.max": "300000 100000\n"})
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {5}, raising=False)
    assert usable_cores(tmp_path) == 1


def test_a_process_held_to_one_core_says_one(tmp_path):
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        assert usable_cores() == 1
    finally:
        os.sched_setaffinity(0, before)


def test_nobody_else_counts_the_cores_of_the_machine():
    counting = {"cpu_count", "sched_getaffinity", "process_cpu_count"}
    found = {
        file.name
        for file in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if (isinstance(node, ast.Attribute) and node.attr in counting)
        or (isinstance(node, ast.ImportFrom) and counting & {alias.name for alias in node.names})
    }
    assert found == {Path(machine.__file__).name}


def test_who_asks_for_all_cores_gets_the_usable_ones(monkeypatch):
    import mujoco
    import onnxruntime
    import torch

    from hotice.model import Box
    from hotice.model.builder import build_model
    from hotice.policy.policy_file import open_policy
    from hotice.sim.physics import mujoco_batch

    given = {}
    batch, session = mujoco.batch.Batch, onnxruntime.InferenceSession

    def noted_batch(*args, **options):
        given["mujoco"] = options["nthread"]
        return batch(*args, **options)

    def noted_session(content, options, **rest):
        given["onnx"] = options.intra_op_num_threads
        return session(content, options, **rest)

    monkeypatch.setattr(mujoco.batch, "Batch", noted_batch)
    monkeypatch.setattr(onnxruntime, "InferenceSession", noted_session)
    monkeypatch.setattr("hotice.policy.policy_file.usable_cores", lambda: 2)
    monkeypatch.setattr(mujoco_batch, "usable_cores", lambda: 2)
    mujoco_batch.MujocoBatch([build_model(Box((0.3, 0.3, 0.3), 1.0))], 3)
    open_policy("carry", threads=0)
    assert given == {"mujoco": 2, "onnx": 2}
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(4)
        monkeypatch.setattr(threads, "usable_cores", lambda: 3)
        threads.use_threads(0)
        assert torch.get_num_threads() == 3
        torch.set_num_threads(2)
        threads.use_threads(0)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_processes_of_an_evaluation_and_workers_of_a_bank(monkeypatch):
    monkeypatch.setattr(processes, "usable_cores", lambda: 1)
    monkeypatch.setattr(processes, "ProcessPoolExecutor", lambda *_, **__: pytest.fail("more than one process"))
    assert list(processes.score_blocks(Scores(), None, [(0, 0), (0, 1)], 0, lambda _: None)) == [
        ((0, 0), 0),
        ((0, 1), 1),
    ]
    asked = []
    monkeypatch.setattr(bank, "usable_cores", lambda: asked.append(True) or 1)
    from hotice.model.shipped import load_scene

    bank.FieldBank.build([load_scene("open_floor")])
    assert asked == [True]


class Scores:
    def score(self, carrier, scene, block, add):
        return block
