"""Mesh files read whole: polygons of any shape, indices as the format counts them, extensions followed or refused."""

import json
import struct

import numpy as np
import pytest

from hotice.errors import InvalidMap, InvalidScene
from hotice.model.geometry.meshes import load_mesh
from hotice.model.importers.formats.mesh_files import read_mesh
from hotice.model.importers.meshes import read_triangles, split_bodies
from hotice.model.importers.polygons import BadPolygon, fill
from hotice.model.importers.scene_import import ImportOptions, import_scene

CUBE = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FLOOR = np.array([(-1.0, -1.5, 0.0), (3.0, -1.5, 0.0), (3.0, 1.5, 0.0), (-1.0, 1.5, 0.0)])
WALL = np.array(
    [
        (1, y, z)
        for y, z in ((-1.5, 0), (-0.55, 0), (-0.55, 2.1), (0.55, 2.1), (0.55, 0), (1.5, 0), (1.5, 2.5), (-1.5, 2.5))
    ]
)
"""A wall with a doorway 1.1 m wide and 2.1 m high, as one polygon."""


def area(vertices, triangles):
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def obj(vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return "\n".join(lines + ["f " + " ".join(str(i + 1) for i in face) for face in faces]).encode() + b"\n"


def off(vertices, faces):
    lines = ["OFF # made here", f"{len(vertices)} {len(faces)} 0"] + [
        f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()
    ]
    return "\n".join(lines + [" ".join(map(str, (len(face), *face, 0.5, 0.5, 0.5))) for face in faces]).encode() + b"\n"


def ply(vertices, faces, encoding="ascii", kind="float", coloured=True):
    header = f"ply\nformat {encoding} 1.0\nelement vertex {len(vertices)}\n"
    header += "".join(f"property {kind} {axis}\n" for axis in "xyz") + f"element face {len(faces)}\n"
    header += "property list uchar uint vertex_indices\n" + "property uchar red\n" * coloured + "end_header\n"
    if encoding == "ascii":
        rows = [" ".join(map(repr, v)) for v in vertices.tolist()]
        rows += [" ".join(map(str, (len(f), *f, *[200] * coloured))) for f in faces]
        return header.encode() + "\n".join(rows).encode() + b"\n"
    order = "<" if "little" in encoding else ">"
    body = b"".join(struct.pack(order + "3" + ("f" if kind == "float" else "d"), *v) for v in vertices.tolist())
    for face in faces:
        body += struct.pack(f"{order}B{len(face)}I{'B' * coloured}", len(face), *face, *[200] * coloured)
    return header.encode() + body


# polygons


def test_a_concave_polygon_is_filled_as_it_is():
    triangles = fill(WALL, [list(range(8))])
    assert triangles.shape == (6, 3) and area(WALL, triangles).sum() == pytest.approx(3.0 * 2.5 - 1.1 * 2.1)
    centres = WALL[triangles].mean(axis=1)
    assert not ((np.abs(centres[:, 1]) < 0.55) & (centres[:, 2] < 2.1)).any()
    a, b, c = (WALL[triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 0] > 0.0).all()  # corners keep their order round the polygon


@pytest.mark.parametrize("seed", range(20))
def test_stars_of_any_direction_keep_their_area(seed):
    from hotice.model.frames import quat_to_mat

    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 40))
    angle, radius = np.sort(rng.uniform(0.0, 2 * np.pi, n)), rng.uniform(0.2, 2.0, n)
    angle = np.arange(n) * 2 * np.pi / n + 0.3 * (angle - angle.mean()) / n
    flat = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(n)])
    expected = 0.5 * np.cross(flat, np.roll(flat, -1, axis=0))[:, 2].sum()
    quat = rng.normal(size=4)
    star = flat @ quat_to_mat(quat / np.linalg.norm(quat)).T + rng.normal(size=3)
    triangles = fill(star, [list(range(n))])
    assert len(triangles) == n - 2 and area(star, triangles).sum() == pytest.approx(expected, rel=1e-9)


def test_straight_corners_do_not_open_a_body():
    """A corner half-way along an edge of a cube belongs to triangles with an area on both sides of it."""
    vertices = np.concatenate([CUBE, [[0.5, 0.0, 0.0]]])
    faces = [*QUADS[:2], (0, 8, 4, 5, 1), *QUADS[3:4], (0, 2, 6, 4, 8), *QUADS[5:]]
    bodies, loose = split_bodies(read_triangles(obj(vertices, faces), ".obj"))
    assert len(bodies) == 1 and len(loose) == 0


def test_a_hole_joined_by_a_bridge_stays_a_hole():
    outer, inner = [(0, 0), (4, 0), (4, 4), (0, 4)], [(1, 1), (1, 3), (3, 3), (3, 1)]
    p = np.array([(*q, 0.0) for q in outer + [outer[0]] + inner + [inner[0]]])
    ring = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    triangles = fill(p, [ring])
    assert area(p, triangles).sum() == pytest.approx(12.0)
    centres = p[triangles].mean(axis=1)
    assert not ((centres[:, :2] > 1.0) & (centres[:, :2] < 3.0)).all(axis=1).any()


@pytest.mark.parametrize(
    "p",
    [
        [(0, 0), (1, 1), (1, 0), (0, 1)],
        [(0, 0), (2, 2), (2, 0), (0, 1)],
        [(np.cos(k * 0.8 * np.pi), np.sin(k * 0.8 * np.pi)) for k in range(5)],
        [(0, 0), (3, 0), (3, 3), (-1, 3), (-1, 1), (4, 1), (4, 2), (0, 2)],
    ],
    ids=["even bow tie", "bow tie", "pentagram", "curl"],
)
def test_polygons_that_cross_themselves_are_named(p):
    vertices = np.array([(x, y, 0.0) for x, y in p])
    with pytest.raises(BadPolygon, match="crosses itself"):
        fill(vertices, [list(range(len(p)))])
    both = np.concatenate([CUBE, vertices])
    face = tuple(range(8, len(both)))
    for suffix, write, where in (
        (".obj", obj, f"line {len(both) + 7}: "),
        (".off", off, "face 7 "),
        (".ply", ply, "face 7 "),
    ):
        with pytest.raises(InvalidMap, match=f"^{where}.*crosses itself"):
            read_mesh(write(both, [*QUADS, face]), suffix)


@pytest.mark.parametrize("name", ["wall.ply", "wall.off", "wall.obj"])
def test_a_doorway_stays_open(name, tmp_path):
    write = {"ply": ply, "off": off, "obj": obj}[name[-3:]]
    content = write(np.concatenate([FLOOR, WALL]), [(0, 1, 2, 3), tuple(range(4, 12))])
    (tmp_path / name).write_bytes(content)
    scene = import_scene(tmp_path / name, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0))).scene
    assert scene.signed_distance([1.0, 0.0, 0.75]) == pytest.approx(0.55, abs=0.04)
    assert scene.signed_distance([1.02, 0.9, 0.75]) < 0.0


# OBJ


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 0 1 2\n", "line 5: face index 0: OBJ counts vertices from 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4/7\n", "line 4: face index 4 is beyond the 3 vertices"),
        ("v 0 0 0\nv 1 0 0\nf -3 1 2\nv 0 1 0\n", "line 3: face index -3: only 2 vertices come before"),
        ("v 0 0 0\nf 1 one 1\n", "line 2: 'one' is no vertex number"),
        ("# wall\nv 0 0\n", "line 2: a vertex needs x, y and z"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9999999999999999999999\n", "line 4: .* beyond"),
    ],
)
def test_bad_obj_lines_are_named(text, message, tmp_path):
    with pytest.raises(InvalidMap, match=message):
        read_mesh(text.encode(), ".obj")
    (tmp_path / "m.obj").write_text(text)
    with pytest.raises(InvalidScene, match=message):  # an obstacle of a scene file is read by the same reader
        load_mesh(tmp_path / "m.obj", 1.0)


def test_obj_as_exporters_write_it():
    text = b"v 0 0 0 1 0 0\r\nv 1 0 0 1 0 0\r\nv 0 1 0\r\n\r\nv 0 0 1 # top\r\n"
    text += b"f 1/1/1 2//2 \\\r\n3 # side\r\nl 1 2\r\nf -4 -3 -1\r\n"
    vertices, faces = read_mesh(text, ".obj")
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert faces.tolist() == [[0, 1, 2], [0, 1, 3]]


def test_obj_faces_that_count_backwards_mean_the_vertices_before_them(tmp_path):
    lines = []
    for shift in (0, 5):
        lines += [f"v {x + shift} {y} {z}" for x, y, z in CUBE]
        lines += ["f " + " ".join(str(i - 8) for i in quad) for quad in QUADS]
    (tmp_path / "cubes.obj").write_text("\n".join(lines) + "\n")
    p = np.array([[0.5, 0.5, 0.5], [5.5, 0.5, 0.5], [3.0, 0.5, 0.5]])
    np.testing.assert_allclose(load_mesh(tmp_path / "cubes.obj", 1.0).signed_distance(p), [-0.5, -0.5, 2.0])


# PLY and OFF


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["float", "double"])
@pytest.mark.parametrize("mixed", [False, True])
def test_ply_polygons_beside_colours(encoding, kind, mixed):
    faces = [*QUADS[:5], (1, 5, 7), (1, 7, 3)] if mixed else QUADS
    content = ply(CUBE, faces, encoding, kind)
    vertices, triangles = read_mesh(content, ".ply")
    np.testing.assert_array_equal(vertices, CUBE)
    assert area(vertices, triangles).sum() == pytest.approx(6.0) and len(triangles) == 12
    for end in range(len(content) - (30 if encoding == "ascii" else 4), 60, -37):
        with pytest.raises(InvalidMap):
            read_mesh(content[:end], ".ply")
    with pytest.raises(InvalidMap, match="face 1 names vertex 9 "):
        read_mesh(ply(CUBE, [(0, 1, 9), *faces], encoding, kind), ".ply")


def test_off_variants():
    for head in (b"OFF\n8 6 0\n", b"OFF 8 6 0\n", b"COFF\n8 6 0\n"):
        content = off(CUBE, QUADS).split(b"\n", 2)[2]
        vertices, triangles = read_mesh(head + content, ".off")
        assert area(vertices, triangles).sum() == pytest.approx(6.0)
    for bad in (b"OFF BINARY\n", b"4OFF\n1 1 1\n", b"OFF\n8 60000 0\n" + content, b"OFF\n", off(CUBE, [(0, 1, 8)])):
        with pytest.raises(InvalidMap):
            read_mesh(bad, ".off")


# GLB

TRIANGLES = np.array([t for a, b, c, d in QUADS for t in ((a, b, c), (a, c, d))])


def glb(positions, indices, *, accessor=None, view=None, primitive=None, node=None, **document):
    """One mesh of one primitive; what is given replaces or adds to the parts of the document."""
    data, corners = positions.tobytes(), np.asarray(indices, dtype="<u4").tobytes()
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0} | (node or {})],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1} | (primitive or {})]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(positions), "type": "VEC3"} | (accessor or {}),
            {"bufferView": 1, "componentType": 5125, "count": np.size(indices), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(data)} | (view or {}),
            {"buffer": 0, "byteOffset": len(data), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(data) + len(corners)}],
    } | document
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = data + corners
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(body), b"BIN\0") + body
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_glb_places_what_its_nodes_say():
    turn = {
        "rotation": [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)],
        "scale": [1.0, 2.0, 3.0],
        "translation": [5.0, 0.0, 0.0],
    }
    vertices, faces = read_mesh(glb(CUBE.astype("<f4"), TRIANGLES, node=turn), ".glb")
    np.testing.assert_allclose(vertices.min(axis=0), [3.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(vertices.max(axis=0), [5.0, 1.0, 3.0], atol=1e-6)
    mirrored = glb(CUBE.astype("<f4"), TRIANGLES, node={"matrix": np.diag([-1.0, 1, 1, 1]).T.ravel().tolist()})
    v, f = read_mesh(mirrored, ".glb")
    p, q, r = (v[f[:, k]] for k in range(3))
    assert np.einsum("ij,ij->", p, np.cross(q, r)) / 6 == pytest.approx(1.0)  # still seen from outside


@pytest.mark.parametrize("normalized", [True, False])
def test_glb_quantized(normalized):
    steps = 32767 if normalized else 1
    padded = np.zeros((8, 4), "<i2")
    padded[:, :3] = CUBE * steps
    content = glb(
        padded,
        TRIANGLES,
        accessor={"componentType": 5122, "normalized": normalized},
        view={"byteStride": 8},
        node={"scale": [2.0, 2.0, 2.0]},
        extensionsRequired=["KHR_mesh_quantization"],
    )
    np.testing.assert_allclose(read_mesh(content, ".glb")[0], 2.0 * CUBE)


def test_glb_strips_fans_and_sparse_positions():
    flat = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], "<f4")
    for mode, corners in ((5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])):
        vertices, faces = read_mesh(glb(flat, corners, primitive={"mode": mode}), ".glb")
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        np.testing.assert_array_equal(np.cross(b - a, c - a)[:, 2], [1.0, 1.0])
    assert len(read_mesh(glb(flat, [0, 1], primitive={"mode": 1}), ".glb")[1]) == 0
    moved = {
        "count": 1,
        "indices": {"bufferView": 1, "componentType": 5125},
        "values": {"bufferView": 0, "byteOffset": 36},
    }
    vertices, _ = read_mesh(glb(flat, [0, 1, 2], accessor={"sparse": moved}), ".glb")
    np.testing.assert_array_equal(vertices[0], [1.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"extensionsRequired": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression, which is not read"),
        ({"extensionsRequired": ["KHR_materials_unlit", "ACME_shape"]}, "extension ACME_shape"),
        ({"node": {"extensions": {"EXT_mesh_gpu_instancing": {}}}}, "EXT_mesh_gpu_instancing"),
        (
            {"accessor": {"bufferView": None}, "primitive": {"extensions": {"KHR_draco_mesh_compression": {}}}},
            "not a valid GLB",
        ),
        ({"buffers": [{"uri": "../secret.bin", "byteLength": 9}]}, "another file"),
        ({"accessor": {"count": 10**12}}, "at most"),
        ({"accessor": {"count": 9000}}, "cut short"),
        ({"node": {"children": [0]}}, "its own child"),
        ({"scenes": [{"nodes": [3]}]}, "not a valid GLB"),
    ],
)
def test_glb_that_cannot_be_read_whole_is_refused(change, message):
    with pytest.raises(InvalidMap, match=message):
        read_mesh(glb(CUBE.astype("<f4"), TRIANGLES, **change), ".glb")


def test_glb_with_a_part_compressed_is_refused_by_name():
    content = glb(CUBE.astype("<f4"), TRIANGLES)
    size = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + size])
    del document["accessors"][0]["bufferView"]
    document["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {}}
    document["extensionsUsed"] = ["KHR_draco_mesh_compression"]  # not said to be required
    text = json.dumps(document).encode()
    content = struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON") + text
    with pytest.raises(InvalidMap, match="KHR_draco_mesh_compression"):
        read_mesh(content, ".glb")


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply", ".plyb", ".glb", ".stl"])
def test_damaged_files_are_read_or_refused(suffix, count=150):
    """Seeded bytes changed, dropped and repeated: a mesh, or one line of `InvalidMap`."""
    stl = (
        b"\0" * 80
        + struct.pack("<I", 12)
        + b"".join(struct.pack("<12fH", 0, 0, 0, *CUBE[t].ravel().tolist(), 0) for t in TRIANGLES)
    )
    whole = {
        ".obj": obj(CUBE, QUADS),
        ".off": off(CUBE, QUADS),
        ".ply": ply(CUBE, QUADS),
        ".plyb": ply(CUBE, QUADS, "binary_big_endian"),
        ".glb": glb(CUBE.astype("<f4"), TRIANGLES),
        ".stl": stl,
    }[suffix]
    rng = np.random.default_rng(len(suffix))
    for _ in range(count):
        content = bytearray(whole)
        for _ in range(rng.integers(1, 6)):
            at, length = rng.integers(len(content)), rng.integers(1, 9)
            what = (
                rng.bytes(length),
                b"",
                bytes(content[at : at + length]) * 3,
                b"-",
                b"9e9",
                b"1e400",
                b"[]",
                b"null",
            )
            content[at : at + length] = what[rng.integers(len(what))]
        with np.errstate(all="ignore"):
            try:
                vertices, faces = read_mesh(bytes(content), suffix[:4])
            except InvalidMap as error:
                assert "\n" not in str(error) and len(str(error)) < 400
                continue
        assert faces.shape[1:] == (3,) and (not len(faces) or 0 <= faces.min() <= faces.max() < len(vertices))
