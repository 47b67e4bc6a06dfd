"""What a machine may do to a command: disks that fill up or may not be written, memory that runs out, numbers that
diverge."""

import contextlib
import errno
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading

import pytest
import torch
import yaml

from hotice.commands.line.options import OPTIONS, field_names
from hotice.commands.pipeline.file import load_pipeline
from hotice.commands.pipeline.jobs import LOCK, Job, JobProcess
from hotice.commands.program import main
from hotice.errors import CheckpointError, DivergedError, OutOfMemory, OutputError, SimulationError
from hotice.evaluate import scorer
from hotice.failures import LOWER, mendable
from hotice.learn.checkpoints.checkpoint import PREFIX, TENSORS, list_checkpoints, load_checkpoint, save_checkpoint
from hotice.learn.checkpoints.health import check_network, first_not_finite
from hotice.learn.distill import dagger
from hotice.learn.policy import torch_policy
from hotice.learn.ppo.dual_ppo import DualPpo
from hotice.learn.train import runner
from hotice.learn.train.progress import LOG, Progress, keep_rows
from hotice.learn.train.runner import Runner
from hotice.model.scene import Scene

FEW = ["--num-envs", "4", "--steps", "4", "--checkpoint-updates", "1"]


def refused(capfd, *argv):
    """Runs a command that must fail with status 2 and say why in its last line, without a traceback. Returns the
    line."""
    capfd.readouterr()
    assert main([str(a) for a in argv]) == 2
    out, err = capfd.readouterr()
    assert "Traceback" not in out + err and sum(line.startswith("hotice: ") for line in err.splitlines()) == 1, err
    return err.splitlines()[-1]


@contextlib.contextmanager
def files_up_to(size):
    """No file may grow beyond so many bytes: as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.fixture
def disk(tmp_path):
    """Function: a file system of its own of so many kilobytes. Needs the right to mount."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def mount(options):
        with contextlib.suppress(FileNotFoundError):
            if not subprocess.run(
                ["mount", "-t", "tmpfs", "-o", options, "none", folder], capture_output=True
            ).returncode:
                return folder
        pytest.skip("file systems cannot be mounted here")

    yield mount
    with contextlib.suppress(FileNotFoundError):
        subprocess.run(["umount", "-l", folder], capture_output=True)


def leftovers(folder):
    """What a failed write could have left."""
    return [p for p in folder.rglob("*") if p.name.startswith(".") or p.suffix == ".tmp"]


@pytest.fixture
def begun(run, tmp_path):
    """Function: folder of a training or distillation of one update, and the command that goes on with it."""

    def make(name, out, tiny_options):
        more = ["--generalist", str(run)] if name == "distill" else []
        argv = [name, "--out", str(out), *tiny_options, *FEW, *more, "--resume", "--updates"]
        assert main([*argv, "1"]) == 0
        return [*argv, "3"]

    return make


# the disk


@pytest.mark.parametrize("command", ["train", "distill"])
def test_a_checkpoint_that_does_not_fit_leaves_the_last_one(command, begun, tiny_options, tmp_path, capfd):
    out = tmp_path / "run"
    argv = begun(command, out, tiny_options)
    before = load_checkpoint(out)
    with files_up_to((list_checkpoints(out)[-1] / TENSORS).stat().st_size // 2):
        line = refused(capfd, *argv)
    assert "checkpoint cannot be written" in line and "File too large" in line
    after = load_checkpoint(out)
    assert after[1]["update"] == 1 and all(torch.equal(before[0][k], after[0][k]) for k in before[0])
    assert leftovers(out) == [] and main(argv) == 0 and load_checkpoint(out)[1]["update"] == 3


@pytest.mark.parametrize("command", ["train", "distill"])
def test_a_log_that_cannot_grow_ends_the_run(command, begun, tiny_options, tmp_path, capfd):
    out = tmp_path / "run"
    argv = begun(command, out, tiny_options)
    with files_up_to((out / LOG).stat().st_size + 200):
        assert "File too large" in refused(capfd, *argv)
    assert load_checkpoint(out)[1]["update"] == 1 and leftovers(out) == []
    assert main(argv) == 0
    rows = [json.loads(line)["update"] for line in (out / LOG).read_text().splitlines()]
    assert rows == [1, 2, 3], "the row that was cut short is gone, and none is there twice"


def test_a_disk_that_fills_up_while_training(begun, tiny_options, disk, capfd):
    out = disk("size=2m") / "run"
    argv = begun("train", out, tiny_options)
    before = load_checkpoint(out)[0]
    with open(out.parent / "filler", "wb") as filler, contextlib.suppress(OSError):
        while True:
            filler.write(bytes(1 << 16))
            filler.flush()
    line = refused(capfd, *argv)
    assert "No space left on device" in line
    after = load_checkpoint(out)
    assert after[1]["update"] == 1 and all(torch.equal(before[k], after[0][k]) for k in before) and leftovers(out) == []
    (out.parent / "filler").unlink()
    assert main(argv) == 0 and load_checkpoint(out)[1]["update"] == 3


@pytest.fixture
def near(tmp_path):
    """File of a scene whose goal is where the robot stands."""
    Scene("near", goal=(0.04, 0.0)).save(tmp_path / "near.json")
    return tmp_path / "near.json"


def test_reports_and_policies_that_do_not_fit(run, onnx_file, near, tmp_path, capfd):
    few = ["--rollouts", 1, "--objects", 1, "--threads", 1]
    folder = tmp_path / "results"
    folder.mkdir()
    with files_up_to(400):
        assert "File too large" in refused(
            capfd, "evaluate", "--policy", onnx_file, "--scenes", near, *few, "--out", folder / "r.json"
        )
        assert "File too large" in refused(capfd, "export", "--policy", run, "--out", folder / "p.onnx")
    assert not (folder / "r.json").exists() and not (folder / "p.onnx").exists() and leftovers(folder) == []


def test_a_policy_that_is_not_replaced_stays_whole(run, tmp_path, capfd):
    path = tmp_path / "p.onnx"
    path.write_bytes(b"the last one")
    with files_up_to(400):
        refused(capfd, "export", "--policy", run, "--out", path)
    assert path.read_bytes() == b"the last one"


def test_finished_blocks_outlive_a_full_disk(onnx_file, near, tmp_path, capfd, monkeypatch):
    out = tmp_path / "r.json"
    argv = ["evaluate", "--policy", onnx_file, "--scenes", near, "--rollouts", 3, "--batch", 1, "--objects", 1]
    argv += ["--threads", 1, "--out", out]
    score, calls = scorer.score_block, []

    def filling(*args, **kwargs):
        calls.append(kwargs["first"])
        if len(calls) == 2:
            one_block = (tmp_path / "r.json.trials" / "scene-000.json").stat().st_size
            resource.setrlimit(resource.RLIMIT_FSIZE, (one_block, before[1]))
        return score(*args, **kwargs)

    monkeypatch.setattr(scorer, "score_block", filling)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    capfd.readouterr()
    try:
        status = main([str(a) for a in argv])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert status == 2 and not out.exists() and leftovers(tmp_path) == []
    assert main([str(a) for a in argv]) == 0 and calls == [0, 1, 1, 2]


def test_places_that_may_only_be_read(run, onnx_file, near, disk, tiny_options, tmp_path, capfd):
    folder = disk("size=4k,ro")
    assert "read-only" in refused(capfd, "train", "--out", folder / "run", *tiny_options, *FEW, "--updates", 1)
    assert "read-only" in refused(
        capfd, "distill", "--out", folder / "run", *tiny_options, *FEW, "--updates", 1, "--generalist", run
    )
    refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", near, "--rollouts", 1, "--out", folder / "r.json")
    refused(capfd, "export", "--policy", run, "--out", folder / "p.onnx")
    path = tmp_path / "pipeline.yaml"
    jobs = {"policy": {"command": "export", "options": {"policy": str(run)}}}
    path.write_text(yaml.safe_dump({"format": "hotice-pipeline/1", "out": str(folder / "out"), "jobs": jobs}))
    assert "read-only" in refused(capfd, "pipeline", path)
    assert list(folder.iterdir()) == []


def test_a_run_whose_folder_became_read_only(begun, tiny_options, disk, capfd):
    folder = disk("size=4m")
    argv = begun("train", folder / "run", tiny_options)
    assert not subprocess.run(["mount", "-o", "remount,ro", folder]).returncode
    assert "read-only" in refused(capfd, *argv)
    assert load_checkpoint(folder / "run")[1]["update"] == 1


def test_a_terminal_that_cannot_be_written():
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "hotice.learn", "tables"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "hotice: cannot write the output: No space left on device: make room; checkpoints and finished results are kept"
    ]


@pytest.fixture
def sleeper(tmp_path, monkeypatch):
    """A job that would run for a minute, and the processes that were started for it."""
    started, start = [], subprocess.Popen

    def popen(argv, **kwargs):
        started.append(start([sys.executable, "-c", "import time; time.sleep(60)"], **kwargs))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", popen)
    yield Job(name="it", command="tables", argv=(), needs=(), folder=tmp_path / "it"), started
    for process in started:
        process.kill()
        process.wait()


def test_a_lock_that_cannot_be_written_leaves_no_process(sleeper):
    job, started = sleeper
    with files_up_to(0), pytest.raises(OutputError, match="File too large"):
        JobProcess(job)
    assert [p.poll() for p in started] == [-signal.SIGTERM] or [p.poll() for p in started] == [-signal.SIGKILL]
    waiting = JobProcess(job)
    assert waiting.process is not None, "the lock is free again"


@pytest.mark.parametrize("name", [LOCK, "log.txt"])
def test_a_job_whose_files_cannot_be_opened_does_not_begin(sleeper, name):
    job, started = sleeper
    (job.folder / name).mkdir(parents=True)
    with pytest.raises(OutputError, match="is a folder, the name of a file is needed"):
        JobProcess(job)
    assert started == []


def test_a_pipeline_that_cannot_write_its_status_stops_its_jobs(run, tmp_path, capfd):
    path = tmp_path / "pipeline.yaml"
    options = {"num_envs": 4, "updates": 100_000}
    jobs = {"teacher": {"command": "train", "options": options}}
    path.write_text(yaml.safe_dump({"format": "hotice-pipeline/1", "out": str(tmp_path / "out"), "jobs": jobs}))
    with files_up_to(260):
        assert "status.json" in refused(capfd, "pipeline", path)
    (job,) = load_pipeline(path).jobs
    with pytest.raises(ProcessLookupError):
        os.kill(int((job.folder / LOCK).read_text()), 0)
    assert not (tmp_path / "out" / "status.json").exists() and leftovers(tmp_path / "out") == []


def test_the_same_update_saved_again_replaces_it(tmp_path):
    for value in (1.0, 2.0):
        save_checkpoint(tmp_path, 5, {"a": torch.tensor(value)}, {})
    assert load_checkpoint(tmp_path)[0]["a"] == 2.0 and len(list(tmp_path.iterdir())) == 1


def test_rows_that_will_be_made_anew_go(tmp_path):
    path = tmp_path / LOG
    keep_rows(path, 3)
    path.write_text('{"update": 1}\n{"update": 2}\n{"update": 3}\n[]\n{"upd')
    keep_rows(path, 2)
    assert path.read_text() == '{"update": 1}\n{"update": 2}\n'


def test_a_thread_of_tensorboard_that_fails_says_nothing_twice(tiny, tmp_path, capfd):
    before = threading.excepthook
    with files_up_to(1 << 20), Progress(tiny(tmp_path / "run"), 0) as progress:
        progress.report(1, 8, 0.1, {"steps_per_s": 1.0})
    assert threading.excepthook is before
    capfd.readouterr()
    with pytest.raises(OutputError), files_up_to(60), Progress(tiny(tmp_path / "other"), 0) as progress:
        for update in range(1, 50):
            progress.report(update, 8, 0.1, {"steps_per_s": 1.0})
    assert "Traceback" not in capfd.readouterr().err and threading.excepthook is before


# memory

EXHAUSTED = {
    "python": MemoryError(),
    "torch": RuntimeError(
        "[enforce fail at alloc_cpu.cpp:127] err == 0. DefaultCPUAllocator: can't allocate memory: ..."
    ),
    "cuda": torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB.\nGPU 0 has ..."),
    "warp": RuntimeError("Failed to allocate 1073741824 bytes on device 'cuda:0'"),
    "mujoco": ValueError("Could not allocate memory"),
    "kernel": OSError(errno.ENOMEM, "Cannot allocate memory"),
}


@pytest.mark.parametrize("kind", EXHAUSTED)
@pytest.mark.parametrize("command", ["train", "distill"])
def test_memory_that_runs_out(command, kind, begun, tiny_options, tmp_path, capfd, monkeypatch):
    argv = begun(command, tmp_path / "run", tiny_options)

    def exhausted(self):
        raise EXHAUSTED[kind]

    monkeypatch.setattr(runner.Runner if command == "train" else dagger.DistillRunner, "collect", exhausted)
    line = refused(capfd, *argv)
    assert "out of memory" in line and "--num-envs" in line and ("on the GPU" in line) == (kind in ("cuda", "warp"))
    assert load_checkpoint(tmp_path / "run")[1]["update"] == 1


def test_memory_of_an_evaluation(onnx_file, near, capfd, monkeypatch):
    def exhausted(*args, **kwargs):
        raise MemoryError

    monkeypatch.setattr(scorer, "score_block", exhausted)
    assert "--batch or --threads" in refused(
        capfd, "evaluate", "--policy", onnx_file, "--scenes", near, "--rollouts", 1, "--objects", 1, "--threads", 1
    )


def test_errors_that_no_user_can_mend_keep_their_traceback():
    assert mendable(KeyError("x")) is None and mendable(RuntimeError("shapes differ")) is None
    assert mendable(OSError(errno.ENOTCONN, "x")) is None and mendable(ValueError("out of range")) is None
    assert isinstance(mendable(MemoryError(), "train"), OutOfMemory) and "--num-envs" in str(
        mendable(MemoryError(), "train")
    )
    assert isinstance(mendable(PermissionError(errno.EACCES, "Permission denied", "x")), OutputError)


def test_every_option_to_lower_exists():
    for command, text in LOWER.items():
        for word in text.replace(",", " ").split():
            if word.startswith("--"):
                assert word[2:].replace("-", "_") in field_names(OPTIONS[command]), (command, word)


# numbers


def test_weights_that_are_not_finite_are_never_saved(begun, tiny_options, tmp_path, capfd, monkeypatch):
    out = tmp_path / "run"
    argv = begun("train", out, tiny_options)
    update = DualPpo.update

    def diverging(self, rollout):
        log = update(self, rollout)
        with torch.no_grad():
            self.net.nets["low"].actor[0].weight[0, 0] = float("inf")
        return log

    with monkeypatch.context() as patch:
        patch.setattr(DualPpo, "update", diverging)
        line = refused(capfd, *argv)
    assert "nets.low.actor.0.weight is not finite after update 2" in line and "--max-learning-rate" in line
    tensors, meta = load_checkpoint(out)
    assert meta["update"] == 1 and first_not_finite(tensors) is None
    assert main(argv) == 0 and load_checkpoint(out)[1]["update"] == 3


def test_minibatches_that_are_left_out_are_told(begun, tiny_options, tmp_path, capfd, monkeypatch):
    argv = begun("train", tmp_path / "run", tiny_options)
    collect = runner.Runner.collect

    def bad(self):
        collect(self)
        if self.update == 1:
            self.rollout.advantage[0, 0, 0] = float("nan")

    monkeypatch.setattr(runner.Runner, "collect", bad)
    capfd.readouterr()
    assert main(argv) == 0
    assert capfd.readouterr().err.count("gradients were not finite") == 1
    tensors, meta = load_checkpoint(tmp_path / "run")
    assert meta["skipped"] > 0 and meta["skipped_in_a_row"] == 0 and first_not_finite(tensors) is None


@pytest.mark.parametrize("where", ["net.nets.low.actor.0.weight", "net.obs_norm.mean"])
def test_checkpoints_that_are_not_finite_are_refused(where, run, tiny, tmp_path):
    tensors, meta = load_checkpoint(run)
    tensors[where].view(-1)[0] = float("nan")
    meta = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    save_checkpoint(tmp_path / "bad", 2, tensors, meta)
    for use in (
        lambda: torch_policy(tmp_path / "bad"),
        lambda: Runner(tiny(tmp_path / "bad", resume=True)),
        lambda: Runner(tiny(tmp_path / "new", init=tmp_path / "bad")),
    ):
        with pytest.raises(CheckpointError, match=f"{where.removeprefix('net.')} is not finite"):
            use()


def test_counters_of_whole_numbers_are_finite():
    net = torch.nn.Linear(2, 2)
    net.register_buffer("count", torch.tensor(3))
    check_network(net, 1, "run")
    net.bias.data[1] = float("nan")
    with pytest.raises(DivergedError, match="^bias is not finite"):
        check_network(net, 1, "run")


def exploding(env, ids):
    """From now on simulations `ids` diverge in every step."""
    step = env.physics.step

    def explode(substeps, before=None):
        step(substeps, before)
        env.physics.qvel[ids] = float("inf")

    env.physics.step = explode


def test_a_simulation_that_explodes_is_counted_and_started_anew(tiny, tmp_path):
    trained = Runner(tiny(tmp_path / "run"))
    exploding(trained.env, [3])
    with pytest.raises(SimulationError, match="diverged 8 times in 8 environments"):
        trained.learn_once()
    few = Runner(tiny(tmp_path / "few", ppo=trained.config.ppo))
    step, calls = few.env.physics.step, []

    def once(substeps, before=None):
        step(substeps, before)
        calls.append(1)
        if len(calls) == 2:
            few.env.physics.qvel[5] = float("nan")

    few.env.physics.step = once
    few.stats.whole[:] = True  # the first episodes of a run count nowhere, having begun at any step
    log = few.learn_once()
    assert log["unstable"] == 1 and log["share/unstable"] > 0 and torch.isfinite(few.env.physics.qpos).all()
    assert first_not_finite(few.net.state_dict()) is None


def test_a_run_whose_simulations_explode_ends_with_its_last_checkpoint(
    begun, tiny_options, tmp_path, capfd, monkeypatch
):
    out = tmp_path / "run"
    argv = begun("train", out, tiny_options)
    collect = runner.Runner.collect

    def bad(self):
        exploding(self.env, slice(None))
        collect(self)

    monkeypatch.setattr(runner.Runner, "collect", bad)
    line = refused(capfd, *argv)
    assert "simulations diverged" in line and "--physics-dt-s" in line and load_checkpoint(out)[1]["update"] == 1
    assert [p.name for p in list_checkpoints(out)] == [f"{PREFIX}0000001"]
    shutil.rmtree(out)
