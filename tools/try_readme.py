"""Every command and snippet of the README, in order, as a reader would type them; the long ones with small numbers.

    python -m tools.try_readme [--venv .venv]

Runs in a folder of its own, with the environment that `make demo` or `make install` made. Whatever is typed there and
cannot be made small here is an error, so that nothing is left out silently.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
SMALL = (
    (r"--max-minutes \S+", "--max-minutes 0.05"),
    (r"--num-envs \S+", "--num-envs 16 --minibatches 4 --carry-states 4 --threads 1"),
    (r"(evaluate .*)--rollouts \S+", r"\1--rollouts 1 --objects 1 --threads 1"),
    # a live view ends by Ctrl-C
    (r"^(hotice play --view .*)", r"timeout --signal INT 20 \1 || [ $? = 124 ]"),
    (r"(play (?!--view).*--scene \S+)", r"\1 --rollouts 1"),
    (r"\bbench20\b", "gap"),
)
"""What stands in the README, and what is typed here instead."""


def blocks(text: str) -> Iterator[tuple[str, str]]:
    """Language and text of every block of code, in order. Raises `ValueError` for a language that is not run here."""
    for language, code in re.findall(r"^```(\w*)\n(.*?)^```", text, re.S | re.M):
        if language not in ("sh", "python"):
            raise ValueError(f"a block of {language or 'no language'}: sh and python are run")
        yield language, code


def small(command: str) -> str:
    """A command line with numbers for a quick try."""
    for pattern, instead in SMALL:
        command = re.sub(pattern, instead, command)
    return command


def script(text: str, venv: Path, folder: Path) -> str:
    """All blocks as one script of bash, which ends at the first command that fails."""
    demo = f"python -m hotice.demo --out {folder}/demo --rollouts 1 --shown 1"
    lines = [f"cd {folder}", f"source {venv}/bin/activate", f"make() {{ [ $1 = demo ] && {demo}; }}"]
    for number, (language, code) in enumerate(blocks(text), 1):
        if language == "python":
            (folder / f"block{number}.py").write_text(code, encoding="utf-8")
            lines.append(_told(f"python block{number}.py"))
            continue
        commands = (re.sub(r"\s+#.*", "", line).strip() for line in code.splitlines())
        lines += [_told(small(each)) for each in commands if each and each != "source .venv/bin/activate"]
    return "\n".join(["set -euo pipefail", *lines, ""])


def _told(command: str) -> str:
    return f"echo; echo {_quoted('$ ' + command)}\n{command}"


def _quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--venv", type=Path, default=ROOT / ".venv", help="environment that has hotice")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="hotice-readme-") as name:
        text = script(README.read_text(encoding="utf-8"), asked.venv.resolve(), Path(name).resolve())
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        return subprocess.run(["bash", "-c", text], env=environment, stdin=subprocess.DEVNULL).returncode


if __name__ == "__main__":
    sys.exit(main())
