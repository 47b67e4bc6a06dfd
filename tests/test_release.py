"""What a release says about itself agrees, and its wheel holds what belongs there."""

import re
import tomllib
from pathlib import Path

from safetensors import safe_open

import hotice
from tools.try_wheel import strays

ROOT = Path(hotice.__file__).resolve().parent.parent


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (cited,) = re.findall(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    assert project["version"] == cited == hotice.__version__


def test_a_clone_carries_one_checkpoint_to_go_on_from():
    """Weights are in the history for ever: one set, without environments."""
    (tensors,) = (ROOT / "checkpoints").rglob("*.safetensors")
    assert tensors.stat().st_size <= 6_000_000 and tensors.relative_to(ROOT).parts[1] == "student"
    with safe_open(tensors, "np") as file:
        parts = {key.split(".")[0] for key in file.keys()}
    assert {"net", "average"} <= parts and "env" not in parts


def test_whatever_is_pinned_is_pinned_once():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    names = [re.sub(r"[-_.]+", "-", line.split("==")[0]).lower() for line in lines if line and not line.startswith("#")]
    assert len(names) == len(set(names)) > 100


def test_strays_are_seen():
    good = ["hotice/__init__.py", "hotice/scenes/gap.json", "hotice-0.1.0.dist-info/RECORD", "hotice/py.typed"]
    bad = ["tests/test_a.py", "hotice/__pycache__/a.pyc", "hotice/notes.txt", "hotice.egg-info/PKG-INFO"]
    assert strays([*good, *bad]) == bad
