"""The wheel as a stranger has it: built, looked into, installed alone into an empty environment, and used elsewhere.

    python -m tools.try_wheel [--index URL] [--kept FOLDER]

Needs `pip` and an index to install from. Home is read-only, the folder is another one, the checkout is out of reach.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KINDS = {".py", ".xml", ".json", ".obj", ".yaml", ".onnx", ".md", ".js", ".css", ".html", ".typed", ".LICENSE", ""}
"""Endings of what belongs into the wheel."""
COMMANDS = (
    ("--version",),
    ("scene", "list"),
    ("evaluate", "--policy", "student", "--scenes", "gap", "--rollouts", "1", "--objects", "1", "--threads", "1"),
    ("play", "--policy", "student", "--scenes", "gap", "--rollouts", "1", "--out", "page.html"),
)


def strays(names: Sequence[str]) -> list[str]:
    """What does not belong into a wheel: other packages than ours, caches, kinds of files that we do not ship."""
    return [
        name
        for name in names
        if name.split("/")[0] not in ("hotice",)
        and not name.split("/")[0].endswith(".dist-info")
        or "__pycache__" in name
        or (name.startswith("hotice/") and Path(name).suffix not in KINDS)
    ]


def build(folder: Path) -> Path:
    """The wheel of the checkout. Raises `CalledProcessError`."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    subprocess.run(pip, check=True)
    (wheel,) = folder.glob("hotice-*.whl")
    return wheel


def install(wheel: Path, folder: Path, more: Sequence[str]) -> Path:
    """An environment with the wheel and what it depends on; returns its folder of programs."""
    venv.create(folder, with_pip=True, clear=True)
    pip = [str(folder / "bin" / "python"), "-m", "pip", "install", "--quiet", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, *more, str(wheel)], check=True)
    return folder / "bin"


def use(programs: Path, folder: Path) -> None:
    """Runs the commands in `folder`, with a home that cannot be written. Raises `CalledProcessError`."""
    home, work = folder / "home", folder / "work"
    home.mkdir()
    work.mkdir()
    home.chmod(0o500)
    kept = {name: value for name, value in os.environ.items() if name in ("PATH", "LANG", "TMPDIR")}
    for command in COMMANDS:
        print("hotice", *command, flush=True)
        # /proc cannot be written by anyone, root included
        for where in (str(home), "/proc/nowhere") if command == COMMANDS[0] else ("/proc/nowhere",):
            environment = {**kept, "HOME": where, "OMP_NUM_THREADS": "1"}
            subprocess.run([str(programs / "hotice"), *command], check=True, cwd=work, env=environment)
    if not (work / "page.html").stat().st_size > 10_000:
        raise RuntimeError("the replay page is empty")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--index", help="further index of packages, for example that of PyTorch without CUDA")
    parser.add_argument("--kept", type=Path, help="environment to keep, and to use again where it is there")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hotice-wheel-") as name:
        folder = Path(name)
        wheel = build(folder)
        with zipfile.ZipFile(wheel) as packed:
            names = packed.namelist()
        if found := strays(names):
            print("in the wheel, but of no use there:", *found, sep="\n  ", file=sys.stderr)
            return 1
        print(f"{wheel.name}: {len(names)} files, {wheel.stat().st_size / 1e6:.1f} MB", flush=True)
        more = ["--extra-index-url", asked.index] if asked.index else []
        use(install(wheel, asked.kept or folder / "venv", more), folder)
    print("all is well")
    return 0


if __name__ == "__main__":
    sys.exit(main())
