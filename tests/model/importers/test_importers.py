"""Point clouds to scenes: files, floor, voxels, boxes, and what must be refused."""

import struct

import numpy as np
import pytest

from hotice.errors import HoticeError, InvalidConfig, InvalidMap, InvalidScene
from hotice.model import Scene
from hotice.model.frames import quat_from_axis_angle, quat_to_mat
from hotice.model.importers import voxels
from hotice.model.importers.floor import fit_floor
from hotice.model.importers.formats import lzf, pcd, ply
from hotice.model.importers.map_obstacles import FLOOR, KEPT, NOISE
from hotice.model.importers.scene_import import ImportOptions, from_points, import_scene

ACROSS = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0))
DECIMALS = np.array([[0.125, -2.5, 3.75], [1e3, -1e-3, 0.0], [np.nan, 1.0, 2.0]])


# files


def lzf_pack(data):
    """A plain compressor: the longest repeat of up to 264 bytes that begins within the last 8,191, else literals."""
    out, literal, i = bytearray(), bytearray(), 0

    def flush():
        for k in range(0, len(literal), 32):
            out.extend(bytes([len(literal[k : k + 32]) - 1]) + literal[k : k + 32])
        literal.clear()

    while i < len(data):
        at = data.rfind(data[i : i + 3], max(0, i - 8191), i + 2) if i + 3 <= len(data) else -1
        if at < 0:
            literal.append(data[i])
            i += 1
            continue
        length = 3
        while length < 264 and i + length < len(data) and data[at + length] == data[i + length]:
            length += 1
        flush()
        back = i - at - 1
        if length < 9:
            out.extend([(length - 2) << 5 | back >> 8, back & 255])
        else:
            out.extend([7 << 5 | back >> 8, length - 9, back & 255])
        i += length
    flush()
    return bytes(out)


def pcd_bytes(points, encoding, dtype="<f4"):
    size = np.dtype(dtype).itemsize
    header = (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x _ y z\nSIZE 1 {size} 1 {size} {size}\nTYPE U F U F F\n"
        f"COUNT 1 1 3 1 1\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\n"
        f"POINTS {len(points)}\nDATA {encoding}\n"
    )
    rows = np.zeros(len(points), dtype=[("i", "u1"), ("x", dtype), ("_", "u1", (3,)), ("y", dtype), ("z", dtype)])
    rows["i"] = np.arange(len(points)) % 256
    for name, column in zip("xyz", points.T, strict=True):
        rows[name] = column
    if encoding == "ascii":
        body = "".join(f"{i} {x!r} 7 8 9 {y!r} {z!r}\n" for i, (x, y, z) in enumerate(points.tolist())).encode()
    elif encoding == "binary":
        body = rows.tobytes()
    else:
        flat = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
        packed = lzf_pack(flat)
        body = struct.pack("<II", len(packed), len(flat)) + packed
    return header.encode() + body


def ply_bytes(points, encoding):
    header = f"ply\nformat {encoding} 1.0\ncomment made here\nelement vertex {len(points)}\nproperty uchar red\n"
    header += "property float x\nproperty double y\nproperty float32 z\nelement face 0\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    if encoding == "ascii":
        return header.encode() + "".join(f"9 {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist()).encode()
    order = "<" if "little" in encoding else ">"
    return header.encode() + b"".join(struct.pack(f"{order}Bfdf", 9, *row) for row in points.tolist())


@pytest.mark.parametrize("encoding", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("dtype", ["<f4", "<f8"])
def test_pcd_encodings(encoding, dtype):
    points = np.random.default_rng(0).normal(size=(500, 3)).astype(np.float32).round(2).astype(np.float64)
    points = np.concatenate([DECIMALS, points])
    np.testing.assert_allclose(pcd.read_pcd(pcd_bytes(points, encoding, dtype)), points, rtol=1e-7)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_encodings(encoding):
    np.testing.assert_allclose(ply.read_ply(ply_bytes(DECIMALS, encoding)), DECIMALS, rtol=1e-7)


def test_lzf_overlapping_and_long_repeats():
    rng = np.random.default_rng(1)
    for data in (
        b"",
        b"a",
        b"abc" * 1000,
        b"\0" * 5000,
        rng.bytes(3000),
        bytes(rng.integers(0, 3, 9000, dtype=np.uint8)),
    ):
        assert lzf.decompress(lzf_pack(data), len(data)) == data


@pytest.mark.parametrize(
    ("packed", "size"),
    [
        (b"\x05abc", 6),
        (b"\x00a\x20\x05", 4),
        (b"\x00a", 2),
        (b"\x00a\xe0", 5),
        (b"\x00a\xe0\x01", 5),
        (b"\x03abcd", 2),
        (b"", 1),
    ],
)
def test_damaged_lzf(packed, size):
    with pytest.raises(InvalidMap):
        lzf.decompress(packed, size)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("POINTS 3", "POINTS 4", "must agree"),
        ("WIDTH 3\nHEIGHT 1", "#", None),
        ("WIDTH 3\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 3", "POINTS 1000", "cut short"),
        ("WIDTH 3\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 3", "POINTS 99999999999", "thin the cloud"),
        ("POINTS 3", "POINTS -3", "whole number"),
        ("SIZE 1 4", "SIZE 1 5", "no such numbers"),
        ("TYPE U F U", "TYPE U Q U", "no such numbers"),
        ("COUNT 1 1 3", "COUNT 1 1 0", "no such numbers"),
        ("COUNT 1 1 3 1 1", "COUNT 1 1 3 1", "as many of each"),
        ("FIELDS intensity x", "FIELDS intensity u", "x are missing"),
        ("DATA binary", "DATA zip", "known are ascii"),
        ("DATA binary", "DATUM binary", "no DATA line"),
    ],
)
def test_lying_pcd_headers(old, new, message):
    content = pcd_bytes(DECIMALS, "binary").replace(old.encode(), new.encode())
    if message is None:
        assert len(pcd.read_pcd(content)) == 3
        return
    with pytest.raises(InvalidMap, match=message):
        pcd.read_pcd(content)


def test_bomb_in_compressed_sizes():
    content = pcd_bytes(DECIMALS, "binary_compressed")
    at = content.index(b"binary_compressed\n") + 18
    for sizes in ((2**32 - 1, 48), (20, 2**32 - 1), (0, 48)):
        with pytest.raises(InvalidMap):
            pcd.read_pcd(content[:at] + struct.pack("<II", *sizes) + content[at + 8 :])
    header = content[:at].replace(b"WIDTH 3", b"WIDTH 3000000").replace(b"POINTS 3", b"POINTS 3000000")
    with pytest.raises(InvalidMap, match="88 times"):
        pcd.read_pcd(header + struct.pack("<II", 40, 48_000_000) + bytes(40))


# floor


def rectangle(rng, count, origin, u, v):
    a = rng.random((count, 2))
    return np.array(origin) + a[:, :1] * np.array(u) + a[:, 1:] * np.array(v)


def block(rng, count, low, high):
    """Points on the sides and the top of a block."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    faces = []
    for axis in range(3):
        for end in (0, 1) if axis < 2 else (1,):
            corner, u, v = low.copy(), np.zeros(3), np.zeros(3)
            corner[axis] = (low, high)[end][axis]
            for edge, other in ((u, (axis + 1) % 3), (v, (axis + 2) % 3)):
                edge[other] = high[other] - low[other]
            faces.append((corner, u, v))
    area = np.array([np.linalg.norm(np.cross(u, v)) for _, u, v in faces])
    counts = rng.multinomial(count, area / area.sum())
    return np.concatenate([rectangle(rng, n, *face) for n, face in zip(counts, faces, strict=True)])


TABLE_TOP, CABINET, BEAM, SILL = 0.72, ((0.8, 0.5, 0.0), (1.2, 0.9, 0.82)), 1.22, 0.08
"""Heights on the 4 cm lattice less or more than a voxel's middle, so that noise does not decide where a face lies."""


def room(rng, noise=0.004, ceiling=True):
    """A floor, ceiling and two walls with a cabinet, a table on one leg, a beam and a sill; z = 0 is the floor."""
    parts = [
        rectangle(rng, 60_000, (-2, -2, 0), (6, 0, 0), (0, 4, 0)),
        rectangle(rng, 20_000, (-2, -2, 0), (6, 0, 0), (0, 0, 2.4)),
        rectangle(rng, 20_000, (-2, 2, 0), (6, 0, 0), (0, 0, 2.4)),
        block(rng, 8_000, *CABINET),
        rectangle(rng, 6_000, (0.6, -0.9, TABLE_TOP), (0.8, 0, 0), (0, 0.4, 0)),
        block(rng, 1_500, (0.66, -0.86, 0), (0.70, -0.82, TABLE_TOP)),
        rectangle(rng, 6_000, (1.0, -1.5, BEAM), (0.2, 0, 0), (0, 3, 0)),
        block(rng, 6_000, (1.5, -1.5, 0), (1.56, 1.5, SILL)),
    ]
    if ceiling:
        parts.append(rectangle(rng, 80_000, (-2, -2, 2.4), (6, 0, 0), (0, 4, 0)))
    points = np.concatenate(parts)
    return points + rng.normal(0.0, noise, points.shape)


def turned(points, axis, angle, lift):
    return points @ quat_to_mat(quat_from_axis_angle(axis, angle)).T + [0.0, 0.0, lift]


@pytest.mark.parametrize("ceiling", [True, False])
def test_floor_of_a_tilted_room(ceiling):
    points = turned(room(np.random.default_rng(2), ceiling=ceiling), (1.0, -0.5, 0.0), 0.08, -1.3)
    floor = fit_floor(points)
    assert floor.tilt_rad == pytest.approx(0.08, abs=1e-3)
    assert floor.height_m == pytest.approx(-1.3 * np.cos(0.08), abs=2e-3)
    assert floor.noise_m == pytest.approx(0.004, rel=0.2)
    np.testing.assert_allclose(floor.R_WM @ floor.R_WM.T, np.eye(3), atol=1e-12)
    z = floor.to_world(points)[:60_000, 2]
    assert abs(z.mean()) < 1e-3 and z.std() < 0.005


def test_places_of_the_map_land_on_the_floor():
    floor = fit_floor(turned(room(np.random.default_rng(3)), (0.0, 1.0, 0.0), 0.1, 0.7))
    x, y, yaw = floor.place_to_world((1.0, 0.5), 0.3)
    step = floor.place_to_world((1.0 + 1e-3 * np.cos(0.3), 0.5 + 1e-3 * np.sin(0.3)))
    assert yaw == pytest.approx(np.arctan2(step[1] - y, step[0] - x), abs=1e-6)
    normal = floor.R_WM[2]
    p_M = np.array([1.0, 0.5, (floor.height_m - normal[:2] @ [1.0, 0.5]) / normal[2]])
    np.testing.assert_allclose(floor.to_world(p_M), [x, y, 0.0], atol=1e-12)


def test_double_floor_is_one():
    rng = np.random.default_rng(12)
    layers = [rectangle(rng, 5000, (-2, -2, z), (6, 0, 0), (0, 4, 0)) for z in (0.0, 0.03)]
    assert 0.0 < fit_floor(np.concatenate(layers)).height_m < 0.03


def wall_only(rng):
    return rectangle(rng, 20_000, (-2, 1, 0), (6, 0, 0), (0, 0, 2.4))


@pytest.mark.parametrize(
    "points",
    [
        lambda rng: rng.normal(size=(20_000, 3)),
        wall_only,
        lambda rng: np.tile([[0.5, 0.0, 0.0]], (500, 1)),
        lambda rng: np.linspace((0, 0, 0), (2, 0, 0), 5000),
        lambda rng: rng.uniform(-3, 3, (200, 3)),
        lambda rng: turned(room(rng), (1, 0, 0), 1.0, 0.0),
    ],
    ids=["blob", "wall", "one place", "line", "outliers", "steep"],
)
def test_clouds_without_floor(points):
    with pytest.raises(InvalidMap, match="no floor found"):
        from_points(points(np.random.default_rng(4)), ACROSS, "x")


# scenes


@pytest.fixture(scope="module")
def imported():
    rng = np.random.default_rng(5)
    stray, far = rng.uniform((-2, -2, 0), (4, 2, 2.4), (500, 3)), rng.uniform(-1000, 1000, (20, 3))
    points = np.concatenate([room(rng), stray, far, np.full((50, 3), np.nan), np.full((1, 3), np.inf)])
    return from_points(rng.permutation(turned(points, (1.0, 0.5, 0.0), 0.05, -1.2)), ACROSS, "room")


def test_room_becomes_a_scene(imported):
    scene = imported.scene
    assert 5 <= len(scene.obstacles) <= 150
    assert scene.bounds_m == ((-1.0, -1.0, 0.0), (3.0, 1.0, 1.5))
    # W differs from the untilted room by the shift of the tilt: measure where the beam, which spans y, is
    shift = imported.floor.to_world(turned(np.array([[1.1, 0.0, 0.0]]), (1.0, 0.5, 0.0), 0.05, -1.2))[0] - [1.1, 0, 0]
    np.testing.assert_allclose(shift[2], 0.0, atol=2e-3)
    inside = np.array(
        [(1.0, 0.7, 0.4), (1.1, -0.1, BEAM), (0.9, -0.7, TABLE_TOP), (1.53, -0.1, 0.05), (0.68, -0.84, 0.3)]
    )
    assert (scene.signed_distance(inside + shift) < 0.0).all()
    free = np.array(
        [(1.1, -0.1, 1.1), (1.0, -0.7, 0.4), (1.0, -0.7, 0.95), (0.4, 0.3, 0.1), (1.53, -0.1, 0.25), (2.0, 0.0, 0.1)]
    )
    assert (scene.signed_distance(free + shift) > 0.04).all()


def test_surfaces_err_outward_by_at_most_two_voxels(imported):
    rng = np.random.default_rng(6)
    shift = imported.floor.to_world(turned(np.zeros((1, 3)), (1.0, 0.5, 0.0), 0.05, -1.2))[0]
    surface = block(rng, 4000, *CABINET) + shift
    surface = surface[surface[:, 2] > 0.05]
    distance = imported.scene.signed_distance(surface)
    assert distance.max() < 0.02 and distance.min() > -0.08 and -0.04 < distance.mean() < 0.0


def test_categories_by_height(imported):
    found = {o.category for o in imported.scene.obstacles}
    assert found == {"ground", "side", "overhead"}
    for obstacle in imported.scene.obstacles:
        bottom, top = (obstacle.position_m[2] + s * 0.5 * obstacle.shape.size_m[2] for s in (-1, 1))
        if obstacle.category == "overhead":
            assert bottom > 0.99
        if obstacle.category == "ground":
            assert top < 0.16


def test_groups_of_points(imported):
    z = imported.points_W[:, 2]
    assert set(np.unique(imported.group)) == {KEPT, FLOOR, NOISE}
    assert z[imported.group == FLOOR].max() < 0.03 and z[imported.group == KEPT].min() > 0.0
    assert (imported.group == NOISE).sum() < 0.1 * len(z)
    distance = imported.scene.signed_distance(imported.points_W[imported.group == KEPT])
    assert distance.max() < 1e-6


def test_map_and_floor_frames_agree():
    points = turned(room(np.random.default_rng(7)), (0.0, 1.0, 0.0), 0.06, -1.0)
    given = ImportOptions(start=(0.0, 0.1, 0.2), goal=(2.0, 0.0), frame="map")
    scene = from_points(points, given, "a").scene
    same = from_points(points, ImportOptions(start=scene.start, goal=scene.goal), "a").scene
    assert same == scene
    assert np.hypot(scene.start[0] - 0.0, scene.start[1] - 0.1) == pytest.approx(0.06, abs=0.01)


def test_facing_the_goal_and_size():
    points = room(np.random.default_rng(8))
    given = ImportOptions(start=(-0.5, 0.0), goal=(0.5, 0.2), size_m=(3.0, 1.6, 1.4), floor="given")
    scene = from_points(points, given, "a").scene
    assert scene.start[2] == pytest.approx(np.arctan2(0.2, 1.0))
    np.testing.assert_allclose(scene.bounds_m, [[-1.5, -0.7, 0.0], [1.5, 0.9, 1.4]], atol=1e-9)


def test_start_in_an_obstacle_and_crops_that_are_none():
    points = room(np.random.default_rng(9))
    with pytest.raises(InvalidScene, match="start .* is inside obstacle 'box_"):
        from_points(points, ImportOptions(start=(1.0, 0.7), goal=(2.0, 0.0)), "a")
    with pytest.raises(InvalidScene, match="outside bounds_m"):
        from_points(points, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=(1.0, 1.0, 1.5)), "a")
    for size in ((0.0, 2.0, 1.5), (4.0, 2.0, -1.5), (9000.0, 9000.0, 1.5), (4.0, 2.0, 0.5)):
        with pytest.raises(InvalidScene, match="bounds_m"):
            from_points(points, ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), size_m=size), "a")


def test_empty_and_distant_clouds():
    for points in (np.empty((0, 3)), np.zeros((1, 3)), np.full((9, 3), np.nan), room(np.random.default_rng(0)) + 500.0):
        with pytest.raises(InvalidMap, match="at least 100 are needed"):
            from_points(points, ACROSS, "a")


@pytest.mark.parametrize(
    "change",
    [
        {"start": (0.0,)},
        {"start": (np.nan, 0.0)},
        {"goal": (np.inf, 0.0)},
        {"size_m": (np.nan, 1.0, 1.0)},
        {"voxel_m": 0.0},
        {"voxel_m": 5.0},
        {"scale": 0.0},
        {"scale": -1.0},
        {"scale": np.nan},
        {"min_points": -1},
        {"min_voxels": 0},
    ],
)
def test_impossible_options(change):
    with pytest.raises(InvalidConfig):
        ImportOptions(**{"start": (0.0, 0.0), "goal": (2.0, 0.0)} | change)


def test_files_through_import(tmp_path):
    points = room(np.random.default_rng(10)) * 1000.0
    (tmp_path / "map.pcd").write_bytes(pcd_bytes(points, "binary"))
    rows = np.zeros(len(points), dtype=[("r", "u1"), ("x", "<f4"), ("y", "<f8"), ("z", "<f4")])
    rows["x"], rows["y"], rows["z"] = points.T
    header = ply_bytes(np.empty((0, 3)), "binary_little_endian").replace(b"vertex 0", b"vertex %d" % len(points))
    (tmp_path / "map.ply").write_bytes(header + rows.tobytes())
    millimetres = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0), scale=0.001)
    scenes = [import_scene(tmp_path / name, millimetres).scene for name in ("map.pcd", "map.ply")]
    assert scenes[0].name == "map" and len(scenes[0].obstacles) == pytest.approx(len(scenes[1].obstacles), abs=3)
    scenes[0].save(tmp_path / "scene.json")
    assert Scene.load(tmp_path / "scene.json") == scenes[0]
    with pytest.raises(HoticeError, match=r"map\.pcd: .*check start, goal and unit"):
        import_scene(tmp_path / "map.pcd", ACROSS)
    for name, message in (("none.pcd", "no such file"), ("map.txt", "is unknown"), (".", "unknown")):
        with pytest.raises(HoticeError, match=message):
            import_scene(tmp_path / name, ACROSS)
    for name in ("cut.pcd", "cut.ply"):
        (tmp_path / name).write_bytes((tmp_path / name.replace("cut", "map")).read_bytes()[:5000])
        with pytest.raises(InvalidMap, match="cut short"):
            import_scene(tmp_path / name, millimetres)


# voxels


def filled(shape, boxes):
    covered = np.zeros(shape, dtype=bool)
    for x0, y0, z0, x1, y1, z1 in boxes:
        covered[x0:x1, y0:y1, z0:z1] = True
    return covered


def test_boxes_cover_exactly_what_is_solid():
    rng = np.random.default_rng(11)
    for share in (0.05, 0.5, 0.95):
        solid = rng.random((14, 11, 9)) < share
        boxes = voxels.cover_by_boxes(solid)
        assert (filled(solid.shape, boxes) == solid).all() and len(boxes) <= solid.sum()
    assert len(voxels.cover_by_boxes(np.zeros((3, 3, 3), dtype=bool))) == 0


def test_overlapping_boxes_are_few():
    solid = filled((20, 20, 10), [(2, 2, 0, 18, 5, 10), (8, 2, 0, 11, 18, 10)])
    assert len(voxels.cover_by_boxes(solid)) == 2


def test_air_is_filled_only_where_it_is_enclosed():
    shell = filled((12, 12, 12), [(2, 2, 0, 8, 8, 7)]) & ~filled((12, 12, 12), [(3, 3, 0, 7, 7, 6)])
    assert (voxels.enclosed(shell) == filled((12, 12, 12), [(2, 2, 0, 8, 8, 7)])).all()
    pierced = shell.copy()
    pierced[2, 4:6, 1] = pierced[7, 2:4, 5] = False
    assert (voxels.enclosed(pierced) | ~filled((12, 12, 12), [(3, 3, 0, 7, 7, 6)])).all()
    table = filled((12, 12, 12), [(2, 2, 6, 8, 8, 7), (2, 2, 0, 3, 3, 6)])
    assert (voxels.enclosed(table) == table).all()


def test_specks_go_and_small_gaps_close():
    count = np.zeros((20, 20, 10), dtype=np.int64)
    count[2:4, 2:18, 0:8] = 9
    count[2:4, 8:10, :] = 0
    count[12, 12, 3:6] = 9
    grid = voxels.Voxels(low=np.zeros(3), size_m=0.04, count=count)
    solid = voxels.occupied(grid, 3, 6)
    assert not solid[10:].any() and solid[2:4, 2:18, 0:8].all()
    assert voxels.occupied(grid, 3, 3)[12, 12, 3:6].all()
    assert not voxels.occupied(grid, 10, 1).any()


def test_column_extent():
    solid = filled((6, 6, 30), [(0, 0, 0, 1, 1, 10), (0, 0, 10, 4, 4, 12), (5, 5, 26, 6, 6, 30)])
    assert voxels.column_extent(solid, np.array([0, 0, 0, 1, 1, 3])) == (0, 12)
    assert voxels.column_extent(solid, np.array([5, 5, 27, 6, 6, 30])) == (26, 30)
