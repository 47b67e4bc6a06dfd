"""Wavefront OBJ text made plain before a library reads it."""

from __future__ import annotations


def absolute_indices(text: bytes) -> bytes:
    """Faces that count vertices backwards (`f -3 -2 -1`) rewritten to count from the first.

    trimesh 5 resolves such indices against the end of the file, which is right only when all vertices come before all faces.
    """
    if b"-" not in b"".join(line for line in text.splitlines() if line[:2] in (b"f ", b"f\t")):
        return text
    seen = {b"v": 0, b"vt": 0, b"vn": 0}
    lines = []
    for line in text.splitlines():
        key, *words = line.split() or [b""]
        if key in seen:
            seen[key] += 1
        elif key == b"f":
            line = b" ".join([b"f", *(_absolute(word, tuple(seen.values())) for word in words)])
        lines.append(line)
    return b"\n".join(lines) + b"\n"


def _absolute(word: bytes, counts: tuple[int, ...]) -> bytes:
    parts = [
        str(count + 1 + int(part)).encode() if part.startswith(b"-") else part
        for part, count in zip(word.split(b"/"), counts, strict=False)
    ]
    return b"/".join(parts)
