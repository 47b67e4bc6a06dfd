"""Where nothing can be written, or another process writes: status 2, one line, nothing left and nothing changed."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from hotice import demo
from hotice.commands.program import main
from hotice.errors import OutputError
from hotice.evaluate.trials import Trials, TrialStore
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.train.runner import Runner
from hotice.owner import LOCK

QUICK = ["--no-perturbed", "--rollouts", "2", "--objects", "1", "--threads", "1", "--horizon-s", "0.1"]
WAY = ["--start", "0", "0", "--goal", "2", "0"]
FILES = {
    "evaluate": ["evaluate", "--policy", "carry", "--scenes", "open_floor", *QUICK],
    "play": ["play", "--policy", "carry", "--rollouts", "1"],
    "benchmark": ["benchmark", "--num-envs", "2"],
    "import": ["scene", "import", "map.obj", *WAY],
}
"""Commands that write a file, of ending .json but for `play`; `--out` comes last."""


def left(folder=Path(".")):
    """What is in a folder: kinds and sizes by name."""
    return {str(p): (stat.S_IFMT(p.lstat().st_mode), p.lstat().st_size) for p in sorted(folder.rglob("*"))}


@pytest.fixture
def made(run):
    """A map and a run in the present folder, and where no file can be written."""
    Path("map.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    shutil.copytree(run, "run")
    os.mkfifo("fifo.json")
    Path("null.json").symlink_to("/dev/null")
    Path("to_fifo.json").symlink_to("fifo.json")
    Path("folder.json").mkdir()
    return ["fifo.json", "null.json", "to_fifo.json", "folder.json", "/dev/null.json/a.json", "none/a.json"]


@pytest.mark.parametrize("name", FILES)
def test_no_command_writes_to_what_is_no_file(name, made, capfd):
    before = left()
    for out in made:
        assert main([*FILES[name], "--out", out]) == 2, out
        said = capfd.readouterr().err.splitlines()
        assert len(said) == 1 and said[0].startswith("hotice: cannot write"), (out, said)
        assert left() == before, out


def test_nor_do_those_that_write_other_endings_or_a_second_file(made, capfd):
    for name in ("x.onnx", "x.html", "x.mp4", "x.png", "x.pdf"):
        os.mkfifo(name)
    before = left()
    for argv in (
        ["export", "--policy", "run", "--out", "x.onnx"],
        ["scene", "show", "open_floor", "--html", "x.html"],
        ["tags", "--box", "0.3", "0.3", "0.3", "--out", "x.pdf"],
        ["play", "--policy", "carry", "--out", "page.html", "--video", "x.mp4"],
        ["play", "--policy", "carry", "--out", "x.htm"],
        ["scene", "import", "map.obj", *WAY, "--out", "x.json"],
    ):
        assert main(argv) == 2, argv
        assert "device, pipe or socket" in capfd.readouterr().err, argv
        assert left() == before, argv


@pytest.mark.parametrize(
    "argv",
    [
        ["train"],
        ["merge", "--parts", "run", "run2"],
        ["reproduce", "table1", "--updates", "1"],
        ["scene", "generate", "family:gap:1"],
    ],
)
def test_no_command_makes_folders_in_what_is_none(argv, made, capfd):
    shutil.copytree("run", "run2")
    before = left()
    for out in ("fifo.json", "fifo.json/a", "/dev/null", "map.obj/a"):
        assert main([*argv, "--out", out]) == 2, out
        assert len(capfd.readouterr().err.splitlines()) == 1
        assert left() == before, out


@pytest.mark.parametrize(
    "argv",
    [
        ["evaluate", "--policy", "run", "--scenes", "open_floor", *QUICK, "--out", "report.json"],
        ["reproduce", "table1", "--policies", "dual_sgf=run", "--out", "tables"],
        ["train", "--out", "new", "--init", "nowhere"],
        ["distill", "--out", "new", "--teachers", "nowhere", "--num-envs", "4", "--carry-states", "2"],
        ["merge", "--out", "new", "--parts", "run", "nowhere"],
        ["play", "--policy", "run", "--scenes", "open_floor", "--rollouts", "1", "--out", "page.html"],
    ],
)
def test_nothing_is_left_of_a_command_that_is_refused(argv, made, capfd):
    """Also of one that is refused late: the run's policy is another's layout, or preset."""
    from hotice.learn.checkpoints import checkpoint

    tensors, meta = load_checkpoint(Path("run"))
    meta["layout"] = [["nonsense", sum(n for _, n in meta["layout"])]]
    kept = {k: v for k, v in meta.items() if k not in ("format", "sha256", "update")}
    shutil.rmtree("run")
    checkpoint.save_checkpoint(Path("run"), meta["update"], tensors, kept)
    before = left()
    assert main(argv) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1
    assert left() == before


def test_trials_of_other_settings_stay_until_new_ones_come(tmp_path):
    folder, trials = tmp_path / "t", Trials(outcome=("success",), distance_m=(0.1,), time_s=(1.0,))
    assert TrialStore(folder, {"seed": 0}, ["a"]).blocks == {} and not folder.exists()
    TrialStore(folder, {"seed": 0}, ["a"]).add(0, 0, trials)
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    other = TrialStore(folder, {"seed": 1}, ["a"])
    assert other.changed == ["seed"] and {p.name: p.read_bytes() for p in folder.iterdir()} == before
    assert TrialStore(folder, {"seed": 0}, ["a"]).blocks == {(0, 0): trials}
    other.add(0, 1, trials)
    assert TrialStore(folder, {"seed": 1}, ["a"]).blocks == {(0, 1): trials}


HOLD = """
import pathlib, sys
from hotice.owner import sole_owner
with sole_owner(pathlib.Path(sys.argv[1])):
    print("mine", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def owned():
    """Function: lets another process own a folder until the test ends."""
    holders = []

    def own(folder):
        pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        holders.append(subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], **pipes))
        assert holders[-1].stdout.readline() == "mine\n"

    yield own
    for holder in holders:
        holder.communicate()


@pytest.mark.parametrize(
    "argv",
    [
        ["train", "--out", "run"],
        ["train", "--out", "run", "--resume"],
        ["distill", "--out", "run", "--resume", "--teachers", "run"],
        ["finetune", "--out", "run", "--init", "run"],
        ["train", "--out", "new"],
        ["evaluate", "--policy", "carry", "--scenes", "open_floor", *QUICK, "--out", "new"],
    ],
)
def test_a_second_process_is_refused_before_it_writes(argv, made, owned, capfd):
    folder = "new.trials" if argv[0] == "evaluate" else argv[2]
    owned(folder)
    before, lock = left(), Path(folder, LOCK).read_text()
    assert main(argv) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"hotice: {folder}: {lock} is at work in it: wait") and said.count("\n") == 1
    assert left() == before and Path(folder, LOCK).read_text() == lock


def test_a_merge_into_the_folder_of_a_process_at_work(made, owned, capfd, run):
    shutil.copytree("run", "run2")
    owned("new")
    assert main(["merge", "--parts", "run", "run2", "--out", "new"]) == 2
    assert "is at work in it" in capfd.readouterr().err and [p.name for p in Path("new").iterdir()] == [LOCK]


def test_a_run_owns_its_folder_while_it_trains(tiny, tmp_path, owned):
    def second(runner):
        assert (tmp_path / "run" / LOCK).read_text().startswith(f"process {os.getpid()} on ")
        with pytest.raises(OutputError, match="is at work in it"):
            Runner(tiny(tmp_path / "run")).train()

    runner = Runner(tiny(tmp_path / "run"))
    collect = runner.collect
    runner.collect = lambda: (second(runner), collect())[1]
    assert runner.train()
    assert not (tmp_path / "run" / LOCK).exists() and load_checkpoint(tmp_path / "run")[1]["update"] == 2


def test_a_run_that_was_overtaken_does_not_go_back(tiny, tmp_path):
    Runner(tiny(tmp_path / "run", updates=1)).train()
    late = Runner(tiny(tmp_path / "run", updates=4, resume=True))
    Runner(tiny(tmp_path / "run", updates=3, resume=True)).train()
    with pytest.raises(OutputError, match="checkpoint-0000003 was written there after this run began: run the same"):
        late.train()
    assert load_checkpoint(tmp_path / "run")[1]["update"] == 3


def test_the_demo_makes_nothing_where_its_files_cannot_be(tmp_path, capsys):
    (tmp_path / "out").mkdir()
    os.mkfifo(tmp_path / "out" / "replay.html")
    before = left(tmp_path)
    assert demo.main(["--out", str(tmp_path / "out")]) == 2
    assert "device, pipe or socket" in capsys.readouterr().err and left(tmp_path) == before
