"""Every command where there is no home folder to write to: it works, or names the variable; and leaves nothing behind.

Each runs as one types it, in a process of its own whose HOME lies below a file: nobody can make it, root neither.
"""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from hotice.caches import cache_root
from hotice.commands import scene, table
from hotice.commands.picks import group

pytestmark = pytest.mark.slow
SMALL = "--num-envs 8 --carry-states 1 --threads 1 --hidden 8 --critic-hidden 8 --steps 4 --minibatches 2 --updates 1"
TRAIN = f"train --scenes open_floor {SMALL} --out run"
LINES = {
    "train": TRAIN,
    "distill": f"distill --scenes open_floor --generalist run {SMALL} --out student",
    "finetune": f"finetune --scenes open_floor --init run {SMALL} --out tuned",
    "pipeline": "pipeline small.yaml",
    "pickup": "pickup --help",
    "pickup plan": "pickup plan --count 0 --out picks.npz",
    "pickup distill": "pickup distill --picks nope.npz --out picker",
    "pickup train": "pickup train --picks nope.npz --init nope --out picker",
    "pickup evaluate": "pickup evaluate --policy nope --picks nope.npz",
    "evaluate": "evaluate --policy student --scenes open_floor --rollouts 1 --threads 1 --horizon-s 1.0 --out r.json",
    "reproduce": "reproduce table1 --policies dual_hodpf=student --bench nope --out paper",
    "merge": "merge --parts nope nope --out merged",
    "export": "export --policy run --out run.onnx",
    "play": "play --policy student --scenes open_floor --out play.html",
    "warm": "warm",
    "tables": "tables",
    "benchmark": "benchmark --scenes open_floor --num-envs 8 --threads 1 --updates 1 --steps 10",
    "robot-sim": "robot-sim --scene nope",
    "tags": "tags --box 0.3 0.3 0.3 --out tags.pdf",
    "tag-camera": "tag-camera --camera nope",
    "robot-check": "robot-check --scene nope",
    "deploy": "deploy --scene nope",
    "scene": "scene list",
    "scene import": "scene import tiny.obj --start 0 0 --goal 2 0 --out imported.json",
    "scene import-front3d": "scene import-front3d front.json --models . --out front",
    "scene scan": "scene scan beam --rays 1000 --out scan.pcd",
    "scene show": "scene show beam --html beam.html",
    "scene check": "scene check beam",
    "scene list": "scene list",
    "scene generate": "scene generate family:pipe:1 --out generated",
}
"""A short use of each command; `run` is a training that was made before."""
PICKUPS = ("pickup plan", "pickup distill", "pickup train", "pickup evaluate")
REFUSED = (
    *PICKUPS,
    "reproduce",
    "merge",
    "robot-sim",
    "tag-camera",
    "robot-check",
    "deploy",
    "scene import",
    "scene import-front3d",
)
"""Commands that would take long, or need what is not there: their lines are refused, for that and not for the home."""
PIPELINE = """
format: hotice-pipeline/1
out: jobs
jobs: {policy: {command: export, options: {policy: run}}}
"""


def homeless(folder):
    """Environment without a home that can be written, and nothing that stands in for it but compiled functions."""
    away = ("HOME", "HOTICE_CACHE", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "TORCHINDUCTOR_CACHE_DIR", "MPLCONFIGDIR")
    environment = {name: value for name, value in os.environ.items() if name not in away}
    (folder / "file").touch()
    (folder / "temporary").mkdir(exist_ok=True)
    environment |= {"HOME": str(folder / "file" / "home"), "TMPDIR": str(folder / "temporary")}
    if cache_root().name == "hotice":
        # compiling anew takes minutes; that nothing is kept without this is tested with the caches
        environment["NUMBA_CACHE_DIR"] = str(cache_root().parent)
    return environment


def run_line(line, folder, environment):
    return subprocess.run(
        [sys.executable, "-m", "hotice", *line.split()],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
    )


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    done = run_line(TRAIN, folder, dict(os.environ))
    assert done.returncode == 0, done.stderr
    return folder / "run"


def test_every_command_is_tried():
    commands = set(table.COMMANDS)
    for name, entries in (("scene", scene.COMMANDS), ("pickup", group.COMMANDS)):
        commands |= {f"{name} {entry}" for entry in entries}
    assert set(LINES) == commands, "a new command needs a line"


@pytest.mark.parametrize("name", LINES)
def test_a_command_without_a_home(name, tmp_path, request):
    if name == "tags":
        pytest.importorskip("cv2")
    folder = tmp_path / "work"
    folder.mkdir()
    if name in ("distill", "finetune", "pipeline", "export"):
        (folder / "run").symlink_to(request.getfixturevalue("made"))
    (folder / "small.yaml").write_text(PIPELINE)
    done = run_line(LINES[name], folder, homeless(tmp_path))
    said = done.stdout + done.stderr
    assert "Traceback" not in said, said
    if name in REFUSED:
        assert done.returncode == 2 and "HOTICE_CACHE" not in said, said
    else:
        assert done.returncode == 0 or (done.returncode == 2 and "set HOTICE_CACHE" in said), said
    assert not list((tmp_path / "temporary").iterdir())
    assert {p.name for p in tmp_path.iterdir()} == {"work", "file", "temporary"}
