"""Files that no loader should trust: of the wrong kind, endless, deep, huge, or with names that mean something else."""

from __future__ import annotations

import os
from pathlib import Path

LONG = "n" * 300
MARKUP = "[/bold][red]x"
DEEP = "[" * 100_000
DIGITS = "9" * 5000

ENDINGS = (".json", ".onnx", ".yaml", ".obj", ".ply", ".pcd", ".glb")
BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
"""Some 300 bytes that stand for a thousand million words."""


def contents(ending: str) -> dict[str, bytes]:
    """Contents by name, for a kind of file: text that its parser may stumble over."""
    found = {
        "empty": b"",
        "nul": b"\0" * 100,
        "text": b"hello",
        "binary": bytes(range(256)) * 20,
        "latin": "Stra\u00dfe".encode("latin-1"),
        "bom": b"\xff\xfe" + "{}".encode("utf-16-le"),
    }
    if ending in (".json", ".onnx"):
        found |= {
            "deep": DEEP.encode(),
            "deep_mapping": b'{"a":' * 100_000,
            "digits": b"[" + DIGITS.encode() + b"]",
            "list": b"[]",
            "null": b"null",
            "number": b"1",
        }
    if ending == ".yaml":
        found |= {
            "deep": DEEP.encode(),
            "deep_block": b"".join(b" " * i + b"a:\n" for i in range(2000)),
            "bomb": BOMB.encode(),
            "merge": b"a: &a {x: 1}\nb: {<<: *a}\n",
            "twice": b"seed: 1\nseed: 2\n",
            "digits": b"seed: " + DIGITS.encode(),
            "sexagesimal": b"seed: 1:" + b"59:" * 2000 + b"0\n",
            "tag": b"!!python/object/apply:os.system [touch executed]",
            "date": b"seed: 2001-99-99",
            "binary_tag": b"seed: !!binary x",
            "int_tag": b"seed: !!int x",
            "bool_tag": b"seed: !!bool x",
            "map_tag": b"seed: !!map [x]",
            "list": b"[]",
            "null": b"",
            "number": b"1",
            "key_list": b"? [a]\n: 1\n",
            "many": b"---\na: 1\n---\nb: 2\n",
        }
    return found


def make_places(folder: Path) -> dict[str, str]:
    """Paths that are no ordinary files, by name."""
    folder.mkdir(parents=True)
    fifo = folder / "fifo"
    os.mkfifo(fifo)
    loop = folder / "loop"
    loop.symlink_to(loop)
    huge = folder / "huge"
    with open(huge, "wb") as file:
        file.truncate(8 * 2**30)  # of holes: takes no room
    places = {
        "missing": folder / "missing",
        "folder": folder / "folder",
        "fifo": fifo,
        "zero": Path("/dev/zero"),
        "null": Path("/dev/null"),
        "loop": loop,
        "huge": huge,
        "long": Path(LONG),
        "deep": Path("/".join(["d" * 200] * 30)),
        "markup": folder / MARKUP,
        "tty": Path("/dev/tty"),
        "mem": Path("/proc/self/mem"),
        "under_file": Path("/etc/passwd/x"),
    }
    (folder / "folder").mkdir()
    return {name: str(path) for name, path in places.items()} | {"nul": "a\0b", "nothing": "", "newline": "a\nb"}


def linked(folder: Path, ending: str, places: dict[str, str]) -> dict[str, str]:
    """Links of this ending to the places that exist, so that no check of the ending keeps them from being read."""
    result = {}
    for name in ("folder", "fifo", "zero", "null", "loop", "huge", "mem"):
        link = folder / f"{name}{ending}"
        if not link.is_symlink():
            link.symlink_to(places[name])
        result[name] = str(link)
    return result


def write_contents(folder: Path, ending: str) -> dict[str, str]:
    """Files of `contents`, written."""
    result = {}
    for name, content in contents(ending).items():
        path = folder / f"content_{name}{ending}"
        path.write_bytes(content)
        result[name] = str(path)
    return result
