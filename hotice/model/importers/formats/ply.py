"""Vertices of Stanford PLY files: ascii and binary of both byte orders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hotice.errors import InvalidMap
from hotice.model.importers.formats.records import MAX_HEADER_BYTES, binary_columns, check_count, count_of, text_columns

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, kw_only=True)
class PlyHeader:
    """`elements`: name -> (count, property name -> numpy type, "" for a list); the data begin at byte `size`.

    `lists`: (element, property) -> numpy types of a list's length and of its items.
    """

    encoding: str
    elements: dict[str, tuple[int, dict[str, str]]]
    lists: dict[tuple[str, str], tuple[str, str]]
    size: int

    @property
    def faces(self) -> int:
        """Number of faces; a cloud has none. Raises `InvalidMap` for strips, which would be lost."""
        if self.elements.get("tristrips", (0, {}))[0]:
            raise InvalidMap("PLY holds triangle strips, which are not read: export its faces as triangles")
        return self.elements.get("face", (0, {}))[0]


def read_ply(content: bytes) -> NDArray[np.float64]:
    """Vertices of a PLY file, (n, 3) [the file's unit]; rows that are not finite are kept. Raises `InvalidMap`."""
    header = read_header(content)
    name, (count, properties) = next(iter(header.elements.items()))
    if name != "vertex" or "" in properties.values():
        raise InvalidMap("PLY vertices must come first and have no list properties")
    missing = [axis for axis in "xyz" if axis not in properties]
    if missing:
        raise InvalidMap(
            f"PLY vertices have {', '.join(properties) or 'no properties'}: {', '.join(missing)} are missing"
        )
    data = content[header.size :]
    if header.encoding == "ascii":
        places = list(properties)
        return text_columns(data, count, len(places), [places.index(axis) for axis in "xyz"])
    order = ORDERS[header.encoding]
    return binary_columns(data, count, np.dtype([(n, order + kind) for n, kind in properties.items()]), list("xyz"))


def read_header(content: bytes) -> PlyHeader:
    """The header. Raises `InvalidMap` for one that is cut, unknown or contradicts itself."""
    end = content.find(b"end_header", 0, MAX_HEADER_BYTES)
    stop = content.find(b"\n", end, MAX_HEADER_BYTES)
    if content[:3] != b"ply" or end < 0 or stop < 0:
        raise InvalidMap("is not a PLY file: its header does not run from 'ply' to 'end_header'")
    encoding, elements, lists = "", {}, {}
    for line in content[3:end].decode("ascii", "replace").splitlines():
        match line.split():
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", word, _] if word in ORDERS:
                encoding = word
            case ["element", name, count] if name not in elements:
                elements[name] = (count_of(f"PLY element {name[:40]!r}", count), {})
                check_count(elements[name][0])
            case ["property", "list", count, item, name] if (
                elements and _TYPES.get(count, "f")[0] != "f" and item in _TYPES
            ):
                _add(elements, name, "")
                lists[next(reversed(elements)), name] = (_TYPES[count], _TYPES[item])
            case ["property", kind, name] if elements and kind in _TYPES:
                _add(elements, name, _TYPES[kind])
            case _:
                raise InvalidMap(f"PLY header has the line {line.strip()[:60]!r}, which is unknown or out of place")
    if not encoding or not elements:
        raise InvalidMap(f"PLY header lacks {'its elements' if encoding else 'a known format'}")
    return PlyHeader(encoding=encoding, elements=elements, lists=lists, size=stop + 1)


def _add(elements: dict[str, tuple[int, dict[str, str]]], name: str, kind: str) -> None:
    properties = elements[next(reversed(elements))][1]
    if name in properties:
        raise InvalidMap(f"PLY property {name[:40]!r} occurs twice in one element")
    properties[name] = kind
