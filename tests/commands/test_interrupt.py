"""Ctrl-C: one line, status 130, or 75 where work was saved; no process is left, and no traceback."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from hotice import demo
from hotice.commands import table as commands
from hotice.commands.program import guarded, main
from hotice.evaluate import run as evaluation
from hotice.failures import INTERRUPTED, STOPPED
from hotice.learn.train.runner import Runner

QUICK = ["--no-perturbed", "--rollouts", "2", "--objects", "1", "--threads", "1", "--horizon-s", "0.1", "--batch", "1"]
EVALUATE = ["evaluate", "--policy", "carry", "--scenes", "open_floor", *QUICK]


def ctrl_c(*_, **__):
    signal.raise_signal(signal.SIGINT)
    time.sleep(1.0)


def test_statuses_are_those_of_shells_and_sysexits():
    assert (INTERRUPTED, STOPPED) == (128 + signal.SIGINT, 75)


def test_one_line_without_a_traceback(capsys):
    assert guarded(ctrl_c) == INTERRUPTED
    assert capsys.readouterr().err == "hotice: interrupted\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_what_fails_because_it_was_interrupted_is_no_defect(capsys):
    def swallowed():
        try:
            ctrl_c()
        except KeyboardInterrupt:
            raise RuntimeError("no compiled object yet") from None

    assert guarded(swallowed) == INTERRUPTED
    assert capsys.readouterr().err == "hotice: interrupted\n"
    with pytest.raises(RuntimeError, match="a defect"):
        guarded(lambda: (_ for _ in ()).throw(RuntimeError("a defect")))


def test_every_command_ends_so(monkeypatch, capsys, run):
    """Interrupted in the first thing that each does."""
    for path in ("hotice.commands.table.check_folder", "hotice.commands.table.check_writable"):
        monkeypatch.setattr(path, ctrl_c)
    for path in (
        "hotice.commands.pipeline.run.load_pipeline",
        "hotice.evaluate.run.load_carrier",
        "hotice.commands.reproduce.check_folder",
        "hotice.learn.checkpoints.merge.resolve",
        "hotice.commands.play.check_writable",
        "hotice.commands.warm.warm",
        "hotice.commands.tables.all_tables",
        "hotice.commands.benchmark.check_memory",
        "hotice.commands.scene.check_writable",
        "hotice.commands.picks.group.check_folder",
        "hotice.commands.picks.group.check_writable",
        "hotice.evaluate.pickups.evaluate_picks",
        "hotice.model.shipped.shipped_scenes",
        "hotice.model.shipped.resolve_scenes",
        "hotice.model.generate.families.generate_from_text",
        "hotice.model.importers.house_scenes.front3d_scenes",
        "hotice.files.check_folder",
    ):
        monkeypatch.setattr(path, ctrl_c)
    map_options = ["--start", "0", "0", "--goal", "1", "1"]
    asked = {
        "train": [],
        "distill": ["--generalist", run],
        "finetune": ["--init", run],
        "pipeline": ["x.yaml"],
        "evaluate": EVALUATE[1:],
        "reproduce": ["table1"],
        "merge": ["--parts", "a", "b", "--out", "c"],
        "export": ["--policy", run, "--out", "x.onnx"],
        "play": [],
        "tables": [],
        "warm": [],
        "benchmark": [],
        "tags": ["--box", "0.3", "0.3", "0.3", "--out", "x.pdf"],
        "pickup plan": ["--out", "picks.npz"],
        "pickup distill": ["--picks", "picks.npz"],
        "pickup train": ["--picks", "picks.npz", "--init", run],
        "pickup evaluate": ["--picks", "picks.npz"],
        "scene import": ["map.obj", *map_options],
        "scene import-front3d": ["--house", "house.json", "--models", "."],
        "scene show": ["open_floor", "--html", "x.html"],
        "scene scan": ["gap", "--out", "x.pcd"],
        "scene check": ["open_floor"],
        "scene list": [],
        "scene generate": ["family:gap:1"],
    }
    from hotice.commands import scene
    from hotice.commands.picks import group

    names = {*commands.COMMANDS, *(f"scene {name}" for name in scene.COMMANDS)}
    names |= {f"pickup {name}" for name in group.COMMANDS}
    names -= {
        "scene",
        "pickup",
        "robot-sim",
        "tag-camera",
        "deploy",
        "robot-check",
        "watch",
    }  # groups; and what Ctrl-C is the way to end
    assert set(asked) == names
    for name, options in asked.items():
        assert main([*name.split(), *map(str, options)]) == INTERRUPTED, name
        assert capsys.readouterr().err == "hotice: interrupted\n", name
    assert demo.main([]) == INTERRUPTED and capsys.readouterr().err == "hotice: interrupted\n"


def test_an_evaluation_says_what_is_kept_and_goes_on(monkeypatch, capsys, tmp_path):
    real = evaluation.score_blocks

    def one_and_stop(*args):
        scored = real(*args)
        yield next(scored)
        ctrl_c()

    argv = [*EVALUATE, "--out", str(tmp_path / "r.json")]
    assert main(argv) == 0
    whole = (tmp_path / "r.json").read_bytes()
    for left in (tmp_path / "r.json.trials").iterdir():
        left.unlink()
    (tmp_path / "r.json").unlink()
    capsys.readouterr()
    with monkeypatch.context() as patch:
        patch.setattr(evaluation, "score_blocks", one_and_stop)
        assert main(argv) == STOPPED
        kept = f"1 of 2 blocks are kept in {tmp_path / 'r.json.trials'}: the same command goes on"
        assert capsys.readouterr().err == f"hotice: stopped: {kept}\n"
        assert main(EVALUATE) == INTERRUPTED and capsys.readouterr().err == "hotice: interrupted\n"
        patch.setattr(evaluation, "score_blocks", ctrl_c)
        assert main([*EVALUATE, "--out", str(tmp_path / "none.json")]) == INTERRUPTED
    assert not (tmp_path / "none.json.trials").exists()
    assert main(argv) == 0 and "1 of 2 blocks" in capsys.readouterr().err
    same = [json.loads(text) for text in (whole, (tmp_path / "r.json").read_bytes())]
    assert same[0] == same[1]


def test_a_reproduction_whose_training_is_interrupted_goes_on(monkeypatch, capsys):
    monkeypatch.setattr("hotice.learn.train.runner.Runner", Interrupted)
    assert main(["reproduce", "table1", "--updates", "1", "--bench", "open_floor"]) == STOPPED
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("hotice: stopped: training of ") and last.endswith("the same command goes on")


class Interrupted:
    """A run that saves and ends."""

    def __init__(self, config):
        pass

    def train(self):
        return False


def test_a_run_that_is_stopped_has_saved(monkeypatch, tmp_path, tiny_options):
    collect = Runner.collect
    monkeypatch.setattr(Runner, "collect", lambda self: (signal.raise_signal(signal.SIGINT), collect(self))[1])
    assert main(["train", "--out", str(tmp_path / "run"), "--updates", "9", *tiny_options]) == STOPPED
    assert [p.name for p in (tmp_path / "run").glob("checkpoint-*")] == ["checkpoint-0000001"]


@pytest.mark.slow
def test_ctrl_c_reaches_a_whole_evaluation_once(tmp_path):
    """As a terminal sends it: to all processes of the group."""
    options = [
        "--policy",
        "carry",
        "--scenes",
        "gap",
        "--rollouts",
        "400",
        "--batch",
        "2",
        "--threads",
        "2",
        "--objects",
        "1",
    ]
    command = [sys.executable, "-m", "hotice.learn", "evaluate", *options, "--out", "r.json"]
    streams = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process = subprocess.Popen(command, cwd=tmp_path, start_new_session=True, **streams)
    while not (tmp_path / "r.json.trials" / "scene-000.json").exists():
        assert process.poll() is None
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=120)[1].splitlines()
    assert process.returncode == STOPPED
    assert said[-1].startswith("hotice: stopped: ") and said[-1].endswith("the same command goes on")
    assert all(line.startswith("trials: ") for line in said[:-1])
    with pytest.raises(ProcessLookupError):
        while True:
            os.killpg(process.pid, 0)
            time.sleep(0.1)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r.json.trials"]
    assert sorted(p.name for p in (tmp_path / "r.json.trials").iterdir()) == ["scene-000.json", "settings.json"]
