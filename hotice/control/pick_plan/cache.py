"""Plans on disk, one file each, named by a hash of all that decides them.

A file is a NumPy archive without pickle, written aside and then renamed; a damaged one is made anew. The folder keeps
the newest `MOST_FILES` plans.
"""

from __future__ import annotations

import hashlib
import io
import json
import warnings
from dataclasses import fields
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from hotice.archives import read_arrays
from hotice.caches import cache_folder
from hotice.control.pick_plan.plan import Durations, PickPlan
from hotice.control.pick_plan.task import PickTask
from hotice.errors import InputError
from hotice.files import make_folder, write_bytes
from hotice.model import g1

MOST_FILES = 2000
MAX_BYTES, MAX_UNPACKED = 2**20, 2**24
SOLVERS = ("drake", "casadi", "adam-robotics", "pin", "mujoco")
_PACKAGE = Path(__file__).resolve().parent
_MODEL = ("builder", "carry", "frames", "g1", "least_squares", "objects", "self_contact")
SOURCES = (
    *sorted(_PACKAGE.rglob("*.py")),
    *(_PACKAGE.parent / "whole_body" / f"{name}.py" for name in ("terms", "contacts")),
    *(_PACKAGE.parents[1] / "model" / f"{name}.py" for name in _MODEL),
)
"""Files that decide what a plan is: when one of them changes, all picks are planned anew."""


class BrokenPlanFile(UserWarning):
    """A cached plan that was damaged and is made anew."""


def default_folder() -> Path:
    """Folder of plans, see `hotice.caches`. Raises `OutputError`."""
    return cache_folder("picks")


def plan_key(task: PickTask, durations: Durations) -> str:
    """Hash of robot, planner and solvers, object, support, stance, balance, pose of the object and durations."""
    grip = task.grip
    facts = [
        _planner(),
        grip.carried.to_dict(),
        vars(grip.support),
        grip.above_m,
        vars(durations),
        task.q_start.tolist(),
        task.pose.p_WO.tolist(),
        task.yaw,
        task.com_box_m.tolist(),
    ]
    return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:32]


def save(folder: Path, key: str, plan: PickPlan) -> None:
    """Writes a plan. Raises `OutputError`."""
    make_folder(folder)
    content = io.BytesIO()
    np.savez(content, **vars(plan))
    write_bytes(folder / f"{key}.npz", content.getvalue())
    files = sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime if path.exists() else 0.0)
    for path in files[: max(len(files) - MOST_FILES, 0)]:
        path.unlink(missing_ok=True)


def load(folder: Path, key: str) -> PickPlan | None:
    """The plan of that key; None where there is none or, with a warning, a damaged one."""
    path = folder / f"{key}.npz"
    if not path.exists():
        return None
    try:
        arrays = read_arrays(path, MAX_BYTES, MAX_UNPACKED)
        found = {field.name: arrays[field.name] for field in fields(PickPlan)}
        found["lift_knots"], found["back_m"] = int(found["lift_knots"]), float(found["back_m"])
        return PickPlan(**found)
    except (InputError, ValueError, KeyError, TypeError):
        warnings.warn(f"{path} is damaged: its pick is planned again", BrokenPlanFile, stacklevel=2)
        return None


@lru_cache(maxsize=1)
def _planner() -> str:
    """Hash of the robot's description, of the sources that plan, and the versions of the solvers."""
    digest = hashlib.sha256(Path(g1.xml_path()).read_bytes())
    for path in SOURCES:
        digest.update(path.read_bytes())
    for name in SOLVERS:
        try:
            digest.update(f"{name} {version(name)}".encode())
        except PackageNotFoundError:
            digest.update(name.encode())
    return digest.hexdigest()
