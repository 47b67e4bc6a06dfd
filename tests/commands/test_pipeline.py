import contextlib
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
import yaml

import hotice
from hotice.commands.configs import PipelineConfig
from hotice.commands.pipeline import run as module
from hotice.commands.pipeline.file import load_pipeline
from hotice.commands.pipeline.jobs import LOCK, Job, JobProcess
from hotice.commands.pipeline.run import STATUS, LocalWorkers, run_pipeline
from hotice.commands.program import main
from hotice.errors import HoticeError, InvalidConfig
from hotice.learn.checkpoints.checkpoint import list_checkpoints, load_checkpoint
from hotice.learn.train.runner import Runner

SMALL = Path(hotice.__file__).parent / "pipelines" / "small.yaml"
TINY = {
    "num_envs": 8,
    "steps": 8,
    "minibatches": 2,
    "hidden": 16,
    "critic_hidden": 16,
    "carry_states": 2,
    "episode_s": 0.3,
    "checkpoint_updates": 1,
}


def graph(**jobs):
    """A pipeline of three teachers and what follows, with changes."""
    base = {
        "teacher": {"command": "train", "each": ["gap", "beam", ["pipe", "pillars"]], "options": {"scenes": "$each"}},
        "student": {
            "command": "distill",
            "options": {"scenes": ["gap", "beam"], "teachers": "$teacher", "init": "$teacher/gap"},
        },
        "policy": {"command": "export", "options": {"policy": "$student"}},
    }
    return {"format": "hotice-pipeline/1", "out": "out", "jobs": base | jobs}


@pytest.fixture
def write(tmp_path):
    """Function: a pipeline file of a document or of text."""

    def make(document):
        path = tmp_path / "pipeline.yaml"
        path.write_text(document if isinstance(document, str) else yaml.safe_dump(document, sort_keys=False))
        return path

    return make


def options(job):
    """The option values of a job's command line, by flag."""
    values: dict[str, list[str]] = {}
    for word in job.argv:
        if word.startswith("--"):
            current = values.setdefault(word, [])
        else:
            current.append(word)
    return values


# the file


def test_references_are_the_graph(write):
    jobs = {j.name: j for j in load_pipeline(write(graph())).jobs}
    teachers = ["teacher/gap", "teacher/beam", "teacher/pipe+pillars"]
    assert set(jobs) == {*teachers, "student", "policy"}
    assert options(jobs[teachers[2]])["--scenes"] == ["pipe", "pillars"]
    student = options(jobs["student"])
    assert student["--teachers"] == [str(jobs[t].folder) for t in teachers] and student["--init"] == [
        str(jobs["teacher/gap"].folder)
    ]
    assert set(jobs["student"].needs) == set(teachers) and jobs["policy"].needs == ("student",)
    assert jobs["policy"].output.name == "policy.onnx" and student["--resume"] == [] and student["--threads"] == ["1"]


def test_the_shipped_pipeline_and_whole_scene_sets(write):
    assert [j.command for j in load_pipeline(SMALL).jobs].count("train") == 2
    teacher = {"command": "train", "each": "bench20", "group": 6, "cpus": 3, "options": {"scenes": "$each"}}
    jobs = load_pipeline(write({"format": "hotice-pipeline/1", "out": "o", "jobs": {"teacher": teacher}})).jobs
    assert [len(options(j)["--scenes"]) for j in jobs] == [6, 6, 6, 2] and options(jobs[0])["--threads"] == ["3"]


def test_the_recipe_of_the_paper_in_the_documentation_can_run(write):
    text = (Path(__file__).parents[2] / "docs" / "training.md").read_text().split("```yaml\n")[1].split("```")[0]
    jobs = load_pipeline(write(text)).jobs
    assert [j.command for j in jobs].count("train") == 75 and len(options(jobs[75])["--teachers"]) == 75


def test_a_change_moves_the_job_and_what_needs_it_and_nothing_else(write):
    def folders(document):
        return {j.name: j.folder.name for j in load_pipeline(write(document)).jobs}

    before = folders(graph())
    after = folders(graph(policy={"command": "play", "options": {"policy": "$student"}}))
    assert {n for n in before if before[n] != after[n]} == {"policy"}
    changed = graph()
    changed["jobs"]["student"]["options"]["epochs"] = 2
    after = folders(changed)
    assert {n for n in before if before[n] != after[n]} == {"student", "policy"}
    assert folders(graph() | {"out": "elsewhere"}) == before


BAD = {
    "not yaml": ("a: [", "no plain YAML"),
    "a tag": ("!!python/object/apply:os.system ['true']", "no plain YAML"),
    "an alias": ("a: &x [1]\nb: *x", "aliases"),
    "a key twice": ("format: a\nformat: b", "key 'format' twice"),
    "a list": ("[1]", "a mapping with format, out, jobs"),
    "no jobs": ({"format": "hotice-pipeline/1", "out": "o"}, "the file lacks 'jobs'"),
    "another format": (graph() | {"format": "x"}, "format is 'x'"),
    "unknown top": (graph() | {"job": {}}, "unknown key 'job'"),
    "unknown key": (graph(a={"command": "train", "option": {}}), "unknown key 'option'"),
    "unknown command": (graph(a={"command": "benchmark"}), "unknown command of a job 'benchmark'"),
    "unknown option": (graph(a={"command": "train", "options": {"num_env": 3}}), "unknown option of train 'num_env'"),
    "own option": (graph(a={"command": "train", "options": {"out": "x"}}), "chooses 'out' itself"),
    "bad value": (graph(a={"command": "train", "options": {"num_envs": "many"}}), "invalid literal"),
    "refused value": (
        graph(a={"command": "train", "options": {"num_envs": 0}}),
        "num_envs is 0: a whole number of at least 1",
    ),
    "a mapping": (graph(a={"command": "train", "options": {"num_envs": {"a": 1}}}), "a value or a list"),
    "loose reference": (graph(a={"command": "export", "options": {"policy": "$nobody"}}), "unknown job 'nobody'"),
    "loose copy": (graph(a={"command": "export", "options": {"policy": "$teacher/x"}}), "unknown job 'teacher/x'"),
    "no each": (graph(a={"command": "train", "options": {"scenes": "$each"}}), "which is missing"),
    "twice": (graph(a={"command": "train", "each": ["gap", "gap"], "options": {}}), "each has 'a/gap' twice"),
    "no set": (graph(a={"command": "train", "each": "bench21"}), "unknown scene set 'bench21'"),
    "no cores": (graph(a={"command": "train", "cpus": 0}), "cpus is 0"),
    "a circle": (
        graph(
            a={"command": "finetune", "options": {"init": "$b"}}, b={"command": "finetune", "options": {"init": "$a"}}
        ),
        "in a circle: ",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused(name, write):
    document, message = BAD[name]
    with pytest.raises(InvalidConfig) as caught:
        load_pipeline(write(document))
    assert message in str(caught.value) and "pipeline.yaml" in str(caught.value)


def test_deep_nesting_is_refused(write):
    with pytest.raises(InvalidConfig):
        load_pipeline(write("[" * 5000 + "]" * 5000))


def test_the_command_line(write, capfd, tmp_path):
    for name in ("distill", "finetune", "pipeline"):
        with pytest.raises(SystemExit) as caught:
            main([name, "--help"])
        assert not caught.value.code
    capfd.readouterr()
    assert main(["pipeline", str(tmp_path / "nowhere.yaml")]) == 2
    assert main(["pipeline", str(write(graph())), "--workers", "0"]) == 2
    assert main(["pipeline", str(write(graph() | {"out": "pipeline.yaml/x"}))]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 3 and "no such file" in lines[0] and "workers is 0" in lines[1] and "cannot create" in lines[2]


# the schedule


class Pretence:
    """Workers that do nothing but end as told: `fate(job, attempt)` gives the status."""

    def __init__(self, fate, room=2):
        self.fate, self.room, self.running, self.log = fate, room, [], []

    def has_room(self):
        return len(self.running) < self.room

    def start(self, job):
        self.running.append(job)
        self.log.append(job.name)

    def ended(self):
        ended, self.running = self.running, []
        return [(job, self.fate(job, self.log.count(job.name))) for job in ended]

    def stop(self):
        self.running = []


@pytest.fixture
def pretend(write, monkeypatch, tmp_path):
    """Function: runs a pipeline with workers that pretend; returns what they started and the states at the end."""
    monkeypatch.setattr(module, "POLL_S", 0.0)

    def make(fate, **changes):
        workers = Pretence(fate)
        monkeypatch.setattr(module, "make_workers", lambda config: workers)
        error = done = None
        try:
            done = run_pipeline(PipelineConfig(config=write(graph()), **changes))
        except HoticeError as caught:
            error = str(caught)
        rows = json.loads((tmp_path / "out" / STATUS).read_text())["jobs"]
        return workers.log, {r["name"]: r["state"] for r in rows}, error, done

    return make


def test_jobs_wait_for_those_they_need(pretend):
    log, states, error, done = pretend(lambda job, attempt: 0)
    assert log == ["teacher/gap", "teacher/beam", "teacher/pipe+pillars", "student", "policy"]
    assert set(states.values()) == {"done"} and error is None and done


def test_who_dies_is_tried_again_but_not_for_ever(pretend):
    log, states, error, _ = pretend(lambda job, attempt: -9 if job.name == "teacher/beam" and attempt < 3 else 0)
    assert log.count("teacher/beam") == 3 and set(states.values()) == {"done"}
    log, states, error, _ = pretend(lambda job, attempt: -9 if job.name == "student" else 0, retries=1)
    assert log.count("student") == 2 and states["student"] == "failed" and "1 of 5 jobs failed (student)" in error


def test_errors_of_the_user_are_final_and_leave_out_what_needs_them(pretend):
    log, states, _, _ = pretend(lambda job, attempt: 2 if job.name == "teacher/gap" else 0)
    assert states == {
        "teacher/gap": "failed",
        "teacher/beam": "done",
        "teacher/pipe+pillars": "done",
        "student": "left out",
        "policy": "left out",
    }
    assert log.count("teacher/gap") == 1


def test_a_signal_stops_it(pretend):
    def fate(job, attempt):
        if job.name == "teacher/gap":
            signal.raise_signal(signal.SIGTERM)
        return 75

    log, states, error, done = pretend(fate)
    assert error is None and done is False and "student" not in log


def test_without_ray_the_cluster_is_refused(write, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(HoticeError, match="needs Ray"):
        run_pipeline(PipelineConfig(config=write(graph()), cluster="auto"))


# with processes


def training(updates):
    return {
        "format": "hotice-pipeline/1",
        "out": "out",
        "defaults": {"train": TINY},
        "jobs": {
            "teacher": {"command": "train", "options": {"updates": updates, "threads": 1}},
            "policy": {"command": "export", "options": {"policy": "$teacher"}},
        },
    }


def is_like_undisturbed(job, tiny, out, updates, **changes):
    """Whether a training job ended bit for bit where an undisturbed run ends."""
    config = tiny(out, updates=updates, **changes)
    Runner(dataclasses.replace(config, checkpoint_updates=1)).train()
    a, b = load_checkpoint(job.folder)[0], load_checkpoint(out)[0]
    return all(torch.equal(a[key], b[key]) for key in b)


@pytest.mark.slow
def test_a_killed_job_goes_on_and_finished_ones_are_not_repeated(write, tiny, tmp_path, monkeypatch):
    class Murderous(LocalWorkers):
        killed = 0

        def ended(self):
            for it in self.running:
                if not self.killed and it.process and list_checkpoints(it.job.folder):
                    it.process.kill()
                    Murderous.killed += 1
            return super().ended()

    path = write(training(updates=8))
    monkeypatch.setattr(module, "make_workers", lambda config: Murderous(1))
    assert run_pipeline(PipelineConfig(config=path))
    rows = json.loads((tmp_path / "out" / STATUS).read_text())["jobs"]
    assert [(r["state"], r["attempts"]) for r in rows] == [("done", 2), ("done", 1)]
    teacher, policy = load_pipeline(path).jobs
    assert policy.output.is_file() and is_like_undisturbed(teacher, tiny, tmp_path / "whole", 8)
    workers = Pretence(lambda job, attempt: 0)
    monkeypatch.setattr(module, "make_workers", lambda config: workers)
    assert run_pipeline(PipelineConfig(config=path)) and workers.log == []


@pytest.mark.slow
def test_a_killed_pipeline_goes_on_when_its_orphan_has_ended(write, tiny, tmp_path):
    document = training(updates=12)
    del document["jobs"]["policy"]
    path = write(document)
    (teacher,) = load_pipeline(path).jobs
    with open(tmp_path / "output", "wb") as sink:
        process = subprocess.Popen(
            [sys.executable, "-m", "hotice.learn", "pipeline", str(path)], stdout=sink, stderr=sink
        )
    deadline = time.monotonic() + 240
    while not list_checkpoints(teacher.folder):
        assert time.monotonic() < deadline and process.poll() is None, (tmp_path / "output").read_text()
        time.sleep(0.02)
    process.kill()
    process.wait()
    assert run_pipeline(PipelineConfig(config=path))
    rows = json.loads((tmp_path / "out" / STATUS).read_text())["jobs"]
    assert [(r["state"], r["attempts"]) for r in rows] == [("done", 1)]
    assert is_like_undisturbed(teacher, tiny, tmp_path / "whole", 12)
    updates = [json.loads(line)["update"] for line in (teacher.folder / "log.jsonl").open()]
    assert updates == list(range(1, 13)), "two processes of one job never ran side by side"


@pytest.mark.slow
def test_a_second_process_of_a_job_waits_for_the_first(tmp_path):
    job = Job(name="it", command="tables", argv=(), needs=(), folder=tmp_path / "it")
    first, second = JobProcess(job), JobProcess(job)
    assert second.process is None and int((job.folder / LOCK).read_text()) == first.process.pid
    assert first.process.wait(120) == 0 and not job.done
    while (status := second.poll()) is None:
        time.sleep(0.05)
    assert status == 0 and job.done and "sgf" in (job.folder / "log.txt").read_text()


@pytest.mark.slow
def test_one_of_two_nodes_of_a_ray_cluster_dies(write, tiny, tmp_path, monkeypatch):
    """Two teachers side by side: one loses its machine when both have got on, and goes on elsewhere; the other is left
    alone."""
    pytest.importorskip("ray")
    from ray.cluster_utils import Cluster

    from hotice.commands.pipeline.cluster import RayWorkers

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]

    class Unlucky(RayWorkers):
        lost = False

        def ended(self):
            if not self.lost and len(self.running) == 2:
                Unlucky.lost = True
                self.lose("teacher/open_floor")
            return super().ended()

        def lose(self, name):
            pids, deadline = {}, time.monotonic() + 240
            while len(pids) < 2:
                assert time.monotonic() < deadline, "no progress"
                for job in self.running.values():
                    if job.name not in pids and list_checkpoints(job.folder):
                        pids[job.name] = int((job.folder / LOCK).read_text())
                        os.kill(pids[job.name], signal.SIGSTOP)  # else it might end before the node is seen to be gone
                time.sleep(0.01)
            victim = pids.pop(name)
            cluster.add_node(num_cpus=1)
            cluster.remove_node(next(node for node in nodes if runs_on(node, victim)), allow_graceful=False)
            with contextlib.suppress(ProcessLookupError):
                os.kill(victim, signal.SIGKILL)  # here, unlike there, it would live on
            os.kill(*pids.values(), signal.SIGCONT)

    monkeypatch.setattr(module, "make_workers", lambda config: Unlucky(config.cluster))
    document = training(updates=30)
    document["jobs"]["teacher"]["each"] = ["open_floor", "gap"]
    document["jobs"]["teacher"]["options"]["scenes"] = "$each"
    del document["jobs"]["policy"]
    path = write(document)
    try:
        assert run_pipeline(PipelineConfig(config=path, cluster=cluster.address))
    finally:
        import ray

        ray.shutdown()
        cluster.shutdown()
    rows = json.loads((tmp_path / "out" / STATUS).read_text())["jobs"]
    assert [(r["name"], r["state"], r["attempts"]) for r in rows] == [
        ("teacher/open_floor", "done", 2),
        ("teacher/gap", "done", 1),
    ]
    for job, scene in zip(load_pipeline(path).jobs, ("open_floor", "gap"), strict=False):
        assert is_like_undisturbed(job, tiny, tmp_path / scene, 30, scenes=(scene,)), scene


def runs_on(node, pid):
    """Whether a process descends from the raylet of a Ray node."""
    raylets = {info.process.pid for info in node.all_processes["raylet"]}
    while pid > 1 and pid not in raylets:
        pid = int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
    return pid in raylets
