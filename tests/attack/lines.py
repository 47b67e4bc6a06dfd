"""Tables of bad command lines, all of which must end before any work begins.

Each takes a bad file or a bad number; what it names beside that does not exist, so that a line whose file or number is
accepted ends as well, in another message.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import get_type_hints

from hotice.commands.line.options import OPTIONS
from tests.attack.bad_files import LONG

Line = tuple[str, tuple[str, ...], tuple[int, ...]]
"""Name, arguments, allowed exit statuses."""

FILE_LINES: Mapping[str, tuple[tuple[str, ...], ...]] = {
    ".json": (
        ("scene", "show", "FILE", "--html", "o.html"),
        ("scene", "check", "FILE"),
        ("scene", "import-front3d", "FILE", "--models", "."),
        ("evaluate", "--policy", "carry", "--scenes", "FILE", "nope.json"),
        ("play", "--scenes", "FILE", "nope.json"),
        ("train", "--scenes", "FILE", "nope.json", "--out", "r", "--num-envs", "8"),
        ("benchmark", "--scenes", "FILE", "nope.json", "--num-envs", "8"),
    ),
    ".onnx": (
        ("evaluate", "--policy", "FILE", "--scenes", "nope.json"),
        ("play", "--policy", "FILE", "--scenes", "open_floor", "--out", "no/o.html"),
        ("export", "--policy", "FILE", "--out", "o.onnx"),
        ("merge", "--parts", "FILE", "nope", "--out", "m"),
        ("train", "--init", "FILE", "--out", "r", "--num-envs", "8"),
        ("distill", "--teachers", "FILE", "--out", "r", "--num-envs", "8"),
        ("finetune", "--init", "FILE", "--out", "r", "--num-envs", "8"),
        ("reproduce", "table1", "--policies", "dual_hodpf=FILE", "--out", "r", "--bench", "nope"),
    ),
    ".yaml": (("pipeline", "FILE"), ("load:station", "FILE")),
    **{
        ending: (("scene", "import", "FILE", "--start", "0", "0", "--goal", "2", "0", "--out", "o.json"),)
        for ending in (".obj", ".ply", ".pcd", ".glb")
    },
}
"""By the ending of the file that stands for FILE."""

MISSING = "nope"
"""What `NUMBER_LINES` name and is not there: a line that says it has accepted its number."""
NUMBER_LINES: Mapping[str, tuple[str, ...]] = {
    "train": ("--scenes", "nope", "--out", "r"),
    "distill": ("--scenes", "gap", "--generalist", "nope/x", "--out", "r"),
    "evaluate": ("--policy", "carry", "--scenes", "nope"),
    "play": ("--scenes", "nope"),
    "watch": ("nope",),
    "benchmark": ("--scenes", "nope"),
    "pipeline": ("nope.yaml",),
    "reproduce": ("table1", "--policies", "dual_hodpf=nope/x", "--bench", "nope", "--out", "r"),
    "robot-check": ("--scene", "nope"),
    "deploy": ("--scene", "nope"),
    "tag-camera": ("--camera", "nope"),
}
"""What stands before the option with a bad number; `finetune` has the options of `train`."""
BAD_NUMBERS = ("nan", "inf", "-inf", "-1", "1e308", "1e-308", "9" * 30, "9" * 5000, "", "x", "0x10")
ODD_NUMBERS = ("1_0", "٣")
"""Numbers to Python, which may be accepted."""

WORDS: tuple[tuple[str, ...], ...] = (
    ("",),
    ("nope",),
    ("[/bold]",),
    ("train", "--nope"),
    ("train", "[/bold]"),
    ("train", "--preset", "[/bold]"),
    ("train", "--preset", "n" * 10_000),
    ("train", "--scenes"),
    ("train", "--device", "[/bold]"),
    ("train", "--physics", "\x1b[31m"),
    ("train", "--scenes", "family:pipe:0", "--out", "r"),
    ("train", "--scenes", "family:pipe:" + "9" * 5000, "--out", "r"),
    ("train", "--scenes", "family:[/bold]:1", "--out", "r"),
    ("train", "--objects.shapes", "cube"),
    ("train", "--shapes", "cube"),
    ("train", "--scan", "maybe"),
    ("evaluate",),
    ("evaluate", "--policy", "carry"),
    ("evaluate", "--policy", "[/bold]", "--scenes", "gap"),
    ("evaluate", "--policy", "carry", "--scenes", "[/bold]"),
    ("evaluate", "--policy", "carry", "--scenes", "gap", "--without", "[/bold]"),
    ("evaluate", "--policy", "carry", "--scenes", "gap", "--referees", "[/bold]"),
    ("evaluate", "--policy", "carry", "--scenes", "gap", "--out", "no/[/bold]/o.json"),
    ("evaluate", "--policy", "carry", "--scenes", "gap", "--size-m", "0.4", "0.2"),
    ("evaluate", "--policy", "carry", "--scenes", "gap", "--shapes", "[/bold]"),
    ("scene", "list", "x"),
    ("scene", "[/bold]"),
    ("scene", "check", "family:[/bold]:1"),
    ("scene", "generate", "family:pipe:99999", "--out", "o"),
    ("scene", "generate", "pipe", "--out", "o"),
    ("scene", "generate", "family:pipe:2", "family:pipe:2", "--out", "o"),
    ("scene", "show", "gap", "--html", "no/[/bold]/o.html"),
    ("scene", "show", "gap", "--port", "70000"),
    ("scene", "show", "gap", "--port", "nan"),
    ("scene", "import", "nope.obj", "--start", "nan", "0", "--goal", "2", "0"),
    ("scene", "import", "nope.obj", "--start", "0", "0", "--goal", "inf", "0"),
    ("scene", "import", "nope.obj", "--start", "0", "0", "--goal", "2", "0", "--voxel-m", "1e-9"),
    ("scene", "import", "nope.obj", "--start", "0", "0", "--goal", "2", "0", "--scale", "1e308"),
    ("scene", "import", "nope.obj", "--start", "0", "0", "--goal", "2", "0", "--size-m", "1e300", "1", "1"),
    ("merge", "--out", "m"),
    ("merge", "--parts", "--out", "m"),
    ("export", "--policy", "carry", "--out", "o.onnx"),
    ("play", "--out", "x.png"),
    ("play", "--out", "."),
    ("play", "--out", "/"),
    ("play", "--video", "x.gif"),
    ("play", "--video-of", "2"),
    ("play", "--controller", "[/bold]"),
    ("watch",),
    ("watch", "[/bold]"),
    ("watch", LONG),
    ("watch", "a\0b"),
    ("train", "--view-port", "8000"),
    ("pickup", "train", "--picks", "nope", "--view"),
    ("deploy", "replay", LONG),
    ("deploy", "replay", "a\0b"),
    ("deploy", "replay", "nope", "--html", "."),
    ("reproduce", "table9"),
    ("reproduce", "table1", "--policies", "=x"),
    ("reproduce", "table1", "--policies", "[/bold]=x"),
    ("pipeline", "a", "b"),
    ("pipeline", "nope.yaml", "--cluster", "[/bold]"),
)


def file_lines(bad: Mapping[str, Mapping[str, str]]) -> Iterator[Line]:
    """All `FILE_LINES` with all bad files."""
    for ending, lines in FILE_LINES.items():
        for name, path in bad[ending].items():
            for line in lines:
                argv = tuple(word.replace("FILE", path) for word in line)
                yield f"{' '.join(line[:2])} {ending} {name}", argv, _allowed(argv)


def number_lines(numbers: Sequence[str]) -> Iterator[Line]:
    """All `NUMBER_LINES` with all of these numbers in all options that take a number."""
    for command, start in NUMBER_LINES.items():
        for option, count in _numeric(OPTIONS[command]):
            for number in numbers:
                argv = (command, *start, f"--{option}", *[number] * count)
                yield f"{command} --{option} {number[:20]}", argv, (2,)


def word_lines() -> Iterator[Line]:
    """`WORDS`, as lines."""
    for words in WORDS:
        yield " ".join(words)[:80], words, _allowed(words)


def _allowed(argv: tuple[str, ...]) -> tuple[int, ...]:
    """Statuses; `scene check` says what is wrong with a scene in its table, with status 1."""
    return (1, 2) if argv[:2] == ("scene", "check") else (2,)


def _numeric(kind: type) -> Iterator[tuple[str, int]]:
    """Options of a configuration that take numbers, and how many."""
    hints = get_type_hints(kind)
    for field in fields(kind):
        hint = hints[field.name]
        if is_dataclass(hint) and isinstance(hint, type):
            yield from _numeric(hint)
        elif any(word in str(hint) for word in ("int", "float")):
            yield field.name.replace("_", "-"), 2 if "float, float" in str(hint) else 1
