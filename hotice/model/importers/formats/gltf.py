"""Binary glTF 2.0 (GLB): the triangles of its default scene, with every node's transform.

Extensions that change geometry are followed (quantization) or refused by name: a scene without the part that one of
them holds would look complete.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hotice.documents import parse_json
from hotice.errors import InvalidMap
from hotice.model.frames import quat_to_mat
from hotice.model.importers.formats.records import MAX_POINTS

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
MAX_NODES = 100_000
MAX_FACES = 5_000_000
_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "EXT_lights_", "KHR_xmp")
"""Extensions of these names change how a thing looks, not its shape."""
_FOLLOWED = ("KHR_mesh_quantization",)
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_glb(content: bytes) -> Mesh:
    """Vertices (V, 3) [m], y up, and triangles (F, 3), all nodes joined. Raises `InvalidMap`."""
    try:
        return _Document(content).mesh()
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError, OverflowError, struct.error) as error:
        reason = " ".join(str(error).split())[:100]  # a structure that contradicts itself
        raise InvalidMap(f"is not a valid GLB file: {type(error).__name__} {reason}") from None


class _Document:
    """The parsed file: `json`, and `buffers` by number."""

    def __init__(self, content: bytes) -> None:
        magic, version, _ = struct.unpack_from("<4sII", content)
        if magic != b"glTF" or version != 2:
            raise InvalidMap("is not a binary glTF 2.0 file")
        chunks, at = {}, 12
        while at + 8 <= len(content):
            size, kind = struct.unpack_from("<I4s", content, at)
            if size > len(content) - at - 8:
                raise InvalidMap(f"is cut short: a part of {size:,} bytes announced, {len(content) - at - 8:,} there")
            chunks.setdefault(kind, content[at + 8 : at + 8 + size])
            at += 8 + size
        self.json: Any = parse_json("its JSON part", chunks[b"JSON"], InvalidMap)
        self._refuse(self.json.get("extensionsRequired", ()))
        self._binary = chunks.get(b"BIN\0")

    def _refuse(self, names: Any) -> None:
        unknown = [n for n in names if not (isinstance(n, str) and (n.startswith(_LOOKS) or n in _FOLLOWED))]
        if unknown:
            listed = ", ".join(str(n)[:60] for n in unknown[:5])
            raise InvalidMap(f"needs the glTF extension {listed}, which is not read: export the mesh without it")

    def mesh(self) -> Mesh:
        """All triangles of the scene."""
        parts: list[Mesh] = []
        total = 0
        for matrix, node in self._nodes():
            if "mesh" not in node:
                continue
            for vertices, faces in self._primitives(self.json["meshes"][node["mesh"]]):
                total += len(faces)
                if total > MAX_FACES:
                    raise InvalidMap(f"has more than {MAX_FACES:,} faces: decimate it")
                placed = vertices @ matrix[:3, :3].T + matrix[:3, 3]
                parts.append((placed, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else faces))
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
        return (
            np.concatenate([np.empty((0, 3)), *(vertices for vertices, _ in parts)]),
            np.concatenate(
                [np.empty((0, 3), np.int64), *(f + n for (_, f), n in zip(parts, starts[:-1], strict=True))]
            ),
        )

    def _nodes(self) -> Iterator[tuple[NDArray[np.float64], Mapping[str, Any]]]:
        """The nodes of the default scene with their transforms (4, 4) to it."""
        nodes = self.json.get("nodes", [])
        if self.json.get("scenes"):
            roots = self.json["scenes"][self.json.get("scene", 0)].get("nodes", [])
        else:
            inner = {child for node in nodes for child in node.get("children", ())}
            roots = [k for k in range(len(nodes)) if k not in inner]
        todo, seen = [(np.eye(4), k) for k in roots], 0
        while todo:
            matrix, k = todo.pop()
            seen += 1
            if seen > min(len(nodes), MAX_NODES):
                raise InvalidMap(f"has a node that is its own child or has two parents, or over {MAX_NODES:,} nodes")
            matrix = matrix @ _transform(nodes[k])
            if "EXT_mesh_gpu_instancing" in nodes[k].get("extensions", {}):
                self._refuse(["EXT_mesh_gpu_instancing"])
            yield matrix, nodes[k]
            todo += [(matrix, child) for child in nodes[k].get("children", ())]

    def _primitives(self, mesh: Mapping[str, Any]) -> Iterator[Mesh]:
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in primitive["attributes"]:
                continue  # points and lines
            accessor = self.json["accessors"][primitive["attributes"]["POSITION"]]
            if "bufferView" not in accessor and "sparse" not in accessor:
                self._refuse(primitive.get("extensions") or ["of a mesh without positions"])
                raise InvalidMap("has a mesh without positions")
            vertices = self._values(accessor).astype(np.float64)
            if "indices" in primitive:
                corners = self._values(self.json["accessors"][primitive["indices"]])[:, 0].astype(np.int64)
            else:
                corners = np.arange(len(vertices))
            if vertices.shape[1] != 3 or len(corners) and not 0 <= corners.min() <= corners.max() < len(vertices):
                raise InvalidMap(f"has faces that name vertices beyond its {len(vertices):,}")
            yield vertices, _triangles(corners, mode)

    def _values(self, accessor: Mapping[str, Any]) -> NDArray:
        """The values of an accessor, (count, width); integers that stand for fractions as such."""
        kind, width, count = _COMPONENTS[accessor["componentType"]], _WIDTHS[accessor["type"]], accessor["count"]
        if not 0 <= count <= MAX_POINTS:
            raise InvalidMap(f"has a mesh of {count:,} vertices or corners: at most {MAX_POINTS:,} are read")
        dtype = np.dtype(kind)
        if "bufferView" in accessor:
            values = self._view(accessor, dtype, width, count).copy()
        else:
            values = np.zeros((count, width), dtype)
        if sparse := accessor.get("sparse"):
            where = self._view(
                sparse["indices"], np.dtype(_COMPONENTS[sparse["indices"]["componentType"]]), 1, sparse["count"]
            )
            values[where[:, 0]] = self._view(sparse["values"], dtype, width, sparse["count"])
        if accessor.get("normalized") and dtype.kind in "iu":
            return np.maximum(values.astype(np.float64) / np.iinfo(dtype).max, -1.0)
        return values

    def _view(self, place: Mapping[str, Any], dtype: np.dtype, width: int, count: int) -> NDArray:
        view = self.json["bufferViews"][place["bufferView"]]
        start = view.get("byteOffset", 0) + place.get("byteOffset", 0)
        size = dtype.itemsize * width
        stride = view.get("byteStride", size)
        data = self._buffer(view["buffer"])
        end = start + (count - 1) * stride + size if count else start
        if not (
            0 <= start and size <= stride and end <= min(len(data), view.get("byteOffset", 0) + view["byteLength"])
        ):
            raise InvalidMap(f"is cut short: {count:,} values reach beyond their part of the file")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def _buffer(self, k: int) -> bytes:
        buffer = self.json["buffers"][k]
        uri = buffer.get("uri")
        if uri is None and k == 0 and self._binary is not None:
            return self._binary
        if isinstance(uri, str) and uri.startswith("data:") and ";base64," in uri[:100]:
            return base64.b64decode(uri.partition(",")[2])
        raise InvalidMap("keeps data in another file, which is not read: export it as one .glb file")


def _transform(node: Mapping[str, Any]) -> NDArray[np.float64]:
    """(4, 4) of a node to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    matrix = np.eye(4)
    matrix[:3, :3] = quat_to_mat(np.array([w, x, y, z], dtype=np.float64)) * np.array(
        node.get("scale", (1.0, 1.0, 1.0))
    )
    matrix[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return matrix


def _triangles(corners: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    if mode == _TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode == _FAN:
        return np.stack([np.broadcast_to(corners[:1], len(corners) - 2), corners[1:-1], corners[2:]], axis=1)
    strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    strip[1::2] = strip[1::2, [1, 0, 2]]
    return strip
