"""Every command where there is no home folder to write to: it works, or names the variable; and leaves nothing behind.

HOME lies below a file: nobody can make it, root neither. Commands that run for a while or start others run as one types
them; the rest share a process by what they need, in an order that changes from run to run.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from hotice.caches import cache_root
from hotice.commands import scene, table
from hotice.commands.picks import group
from tests.model.importers import front3d_fixture
from tests.samples import sample

pytestmark = pytest.mark.slow
SMALL = "--num-envs 8 --carry-states 1 --threads 1 --hidden 8 --critic-hidden 8 --steps 4 --minibatches 2 --updates 1"
FRONT = front3d_fixture.FOLDER
BOOK = Path(__file__).parents[1] / "sim" / "data" / "picks.npz"
PICKING = f"--picks {BOOK} --epochs 1 {SMALL.replace('--carry-states 1', '')}"
DOMAIN, POSE, TAGS = 40 + os.getpid() % 150, 46_000 + 2 * (os.getpid() % 900), 46_001 + 2 * (os.getpid() % 900)
TRAIN = f"train --scenes open_floor {SMALL} --out run"
LINES = {
    "train": TRAIN,
    "distill": f"distill --scenes open_floor --generalist run {SMALL} --out student",
    "finetune": f"finetune --scenes open_floor --init run {SMALL} --out tuned",
    "pipeline": "pipeline small.yaml",
    "pickup": "pickup --help",
    "pickup plan": "pickup plan --count 1 --out picks.npz",
    "pickup distill": f"pickup distill {PICKING} --aggregate 1 --out picked",
    "pickup train": f"pickup train {PICKING} --init picker --out better",
    "pickup evaluate": f"pickup evaluate --policy picker --picks {BOOK} --rollouts 1 --threads 1",
    "evaluate": "evaluate --policy student --scenes open_floor --rollouts 1 --threads 1 --horizon-s 1.0 --out r.json",
    "reproduce": "reproduce table1 --policies dual_hodpf=student --bench nope --out paper",
    "merge": "merge --parts run other --out merged",
    "export": "export --policy run --out run.onnx",
    "play": "play --policy student --scenes open_floor --out play.html",
    "watch": "watch nowhere",
    "warm": "warm",
    "tables": "tables",
    "benchmark": "benchmark --scenes open_floor --num-envs 8 --threads 1 --updates 1 --steps 10",
    "robot-sim": f"robot-sim --duration-s 0.5 --domain {DOMAIN} --pose-port {POSE} --tags-port {TAGS}",
    "tags": "tags --box 0.3 0.3 0.3 --out tags.pdf",
    "tag-camera": f"tag-camera --camera pictures --port {TAGS}",
    "robot-check": f"robot-check --seconds 1 --domain {DOMAIN} --pose-port {POSE} --tags-port {TAGS}",
    "deploy": f"deploy --dry-run --domain {DOMAIN} --pose-port {POSE} --tags-port {TAGS}",
    "scene": "scene list",
    "scene import": "scene import tiny.obj --floor given --start 0 0 --goal 2 0 --out imported.json",
    "scene import-front3d": f"scene import-front3d --house {FRONT}/house.json --models {FRONT}/models --count 1 "
    "--size-m 4.0 2.6 1.5 --out front",
    "scene scan": "scene scan beam --rays 1000 --out scan.pcd",
    "scene show": "scene show beam --html beam.html",
    "scene check": "scene check beam",
    "scene list": "scene list",
    "scene generate": "scene generate family:pipe:1 --out generated",
}
"""A short use of each command; `run` is a training that was made before."""
NEEDS = {"robot-sim": "cyclonedds", "robot-check": "cyclonedds", "tag-camera": "cv2", "tags": "cv2"}
"""Commands that say, where this package is not there, which extra it comes with."""
REFUSED = {
    "watch": "config.json: no such file",
    "robot-check": "rows failed",
    "tag-camera": "no picture",
    "reproduce": "nope",
}
"""Commands whose lines end with status 2 all the same: nobody sends anything, nobody took a picture, a real one would
take long, what is watched goes on until Ctrl-C."""
ALONE = ("pipeline", "warm", "benchmark", "robot-sim", "tag-camera", "robot-check", "deploy")
"""Commands that run as one types them."""
TOGETHER = {
    "policies": ("distill", "finetune", "merge", "export", "evaluate", "play"),
    "new runs": ("watch", "train", "reproduce", "tables", "tags"),
    "pick-ups": tuple(name for name in LINES if name.startswith("pickup")),
    "scenes": tuple(name for name in LINES if name.startswith("scene")),
}
"""Commands that share a process."""
MADE = {"distill": "run", "finetune": "run", "pipeline": "run", "export": "run", "merge": "run other"}
MADE |= {"pickup train": "picker", "pickup evaluate": "picker"}
PIPELINE = """
format: hotice-pipeline/1
out: jobs
jobs: {policy: {command: export, options: {policy: run}}}
"""


SHELF = """
v 0.9 0.6 0.0
v 1.1 0.6 0.0
v 1.1 0.8 0.0
v 0.9 0.8 0.0
v 0.9 0.6 0.8
v 1.1 0.6 0.8
v 1.1 0.8 0.8
v 0.9 0.8 0.8
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""
NOBODY = """
import pwd


def getpwuid(uid):
    raise KeyError(f"getpwuid(): uid not found: {uid}")


pwd.getpwuid = getpwuid
"""
"""Read by Python as it starts: a user whom no passwd knows."""
AWAY = ("HOME", "HOTICE_CACHE", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "TORCHINDUCTOR_CACHE_DIR", "MPLCONFIGDIR")


def homeless(folder, *, known=True):
    """Environment without a home that can be written, and nothing that stands in for it but compiled functions.

    `known`: it is a place that cannot be made; otherwise there is none, and no entry of the user in passwd.
    """
    away = AWAY if known else (*AWAY, "USER", "LOGNAME", "LNAME", "USERNAME")
    environment = {name: value for name, value in os.environ.items() if name not in away}
    (folder / "file").touch()
    (folder / "temporary").mkdir(exist_ok=True)
    environment |= {"TMPDIR": str(folder / "temporary")}
    if known:
        environment["HOME"] = str(folder / "file" / "home")
    else:
        (folder / "file").unlink()
        (folder / "file").mkdir()
        (folder / "file" / "sitecustomize.py").write_text(NOBODY)
        environment["PYTHONPATH"] = os.pathsep.join([str(folder / "file"), os.environ.get("PYTHONPATH", "")])
    if cache_root().name == "hotice":
        # compiling anew takes minutes; that nothing is kept without this is tested with the caches
        environment["NUMBA_CACHE_DIR"] = str(cache_root().parent)
    return environment


ONE_AFTER_ANOTHER = """
import json, os, sys
from hotice.commands.program import main

endings, said = {}, os.dup(1)
for name, line in json.loads(sys.argv[1]).items():
    words = os.open(f"../{name}.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(words, 1), os.dup2(words, 2)
    try:
        status = main(line.split())
    except SystemExit as ended:
        status = ended.code or 0
    sys.stdout.flush(), sys.stderr.flush()
    endings[name] = status
os.write(said, json.dumps(endings).encode())
"""
"""Runs lines by their names; what each says goes into a file beside the folder."""


def run_lines(names, folder, environment):
    """How each of some commands ended, in one process."""
    lines = {name: LINES[name] for name in sample(names, len(names))}
    done = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER, json.dumps(lines)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
    )
    files = {name: folder.parent / f"{name}.txt" for name in names}
    said = {name: file.read_text() if file.exists() else "" for name, file in files.items()}
    for file in files.values():
        file.unlink(missing_ok=True)
    assert done.returncode == 0, (done.stderr, said)
    endings = json.loads(done.stdout)
    return {name: subprocess.CompletedProcess(lines[name], endings[name], said[name], "") for name in lines}


def run_line(line, folder, environment, door="hotice"):
    return subprocess.run(
        [sys.executable, "-m", door, *line.split()],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Function: the folder of a training that was made before."""
    folder, lines = (
        tmp_path_factory.mktemp("made"),
        {"run": TRAIN, "picker": LINES["pickup distill"].replace("picked", "picker")},
    )

    def find(name):
        if name == "other":
            return shutil.copytree(find("run"), folder / "other", dirs_exist_ok=True)
        if not (folder / name).exists():
            done = run_line(lines[name], folder, dict(os.environ))
            assert done.returncode == 0, done.stderr
        return folder / name

    return find


def test_every_command_is_tried():
    commands = set(table.COMMANDS)
    for name, entries in (("scene", scene.COMMANDS), ("pickup", group.COMMANDS)):
        commands |= {f"{name} {entry}" for entry in entries}
    assert set(LINES) == commands, "a new command needs a line"
    assert sorted([*ALONE, *(name for names in TOGETHER.values() for name in names)]) == sorted(LINES)


def works(done, name):
    """Says what is wrong with how a command ended; a variable may be asked for."""
    said = done.stdout + done.stderr
    assert "Traceback" not in said, said
    if name in NEEDS and find_spec(NEEDS[name]) is None:
        assert done.returncode == 2 and "pip install 'hotice[deploy]'" in said, said
    elif name in REFUSED:
        assert done.returncode == 2 and REFUSED[name] in said, said
    else:
        assert done.returncode == 0 or (done.returncode == 2 and "set HOTICE_CACHE" in said), said


def leaves_nothing(folder):
    assert not list((folder / "temporary").iterdir())
    assert {p.name for p in folder.iterdir()} == {"work", "file", "temporary"}


@pytest.fixture
def stage(tmp_path, made):
    """Function: the folder in which commands run, with what they are given."""

    def make(names):
        folder = tmp_path / "work"
        folder.mkdir()
        for given in sorted({given for name in names for given in MADE.get(name, "").split()}):
            (folder / given).symlink_to(made(given))
        (folder / "small.yaml").write_text(PIPELINE)
        (folder / "tiny.obj").write_text(SHELF)
        (folder / "pictures").mkdir()
        return folder

    return make


@pytest.mark.parametrize("name", ALONE)
def test_a_command_without_a_home(name, tmp_path, stage):
    works(run_line(LINES[name], stage([name]), homeless(tmp_path)), name)
    leaves_nothing(tmp_path)


@pytest.mark.parametrize("names", TOGETHER.values(), ids=TOGETHER)
def test_commands_without_a_home(names, tmp_path, stage):
    for name, done in run_lines(names, stage(names), homeless(tmp_path)).items():
        works(done, name)
    leaves_nothing(tmp_path)


@pytest.mark.parametrize("name", ["train", "evaluate", "tags", "scene show", "deploy"])
def test_the_other_door_of_a_user_whom_nobody_knows(name, tmp_path):
    """`python -m hotice.learn`, without a home and without an entry in passwd."""
    (tmp_path / "work").mkdir()
    works(run_line(LINES[name], tmp_path / "work", homeless(tmp_path, known=False), "hotice.learn"), name)
    leaves_nothing(tmp_path)


def test_the_user_whom_nobody_knows_has_no_home(tmp_path):
    code = "from pathlib import Path; Path.home()"
    environment = homeless(tmp_path, known=False)
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert "Could not determine home directory" in done.stderr
