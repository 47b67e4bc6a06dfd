"""OctoMap's binary trees: cells by hand, damaged files, a hall seen through an octree."""

import numpy as np
import pytest

from hotice.errors import InvalidMap
from hotice.model.importers import ImportOptions, import_scene
from hotice.model.importers.floor import Floor
from hotice.model.importers.formats.octomap import DEPTH, MIDDLE, read_octomap
from hotice.model.importers.scene_import import from_points
from tests.model.importers.test_import_cases import PROBES, hall

HEADER = "# Octomap OcTree binary file\n# (feel free to add / change comments, but leave the first line as it is!)\n#\n"


def octree_bytes(cells, resolution, free=(), size=None, name="OcTree"):
    """A .bt file: sets of finest cells (x, y, z), counted from the root's lowest corner; eight of a kind are one."""
    kinds = {**dict.fromkeys(map(tuple, cells), 0b10), **dict.fromkeys(map(tuple, free), 0b01)}
    words, count = [], 1

    def kind(members, edge):
        """Code of a cube with these finest cells in it."""
        codes = {kinds[m] for m in members}
        return codes.pop() if len(members) == edge**3 and len(codes) == 1 else 0b11

    def write(low, edge, members):
        nonlocal count
        half, word, inner = edge // 2, 0, []
        for i in range(8):
            corner = tuple(low[axis] + half * (i >> axis & 1) for axis in range(3))
            mine = [m for m in members if all(corner[a] <= m[a] < corner[a] + half for a in range(3))]
            if mine:
                code = kind(mine, half)
                count, word = count + 1, word | code << 2 * i
                inner += [(corner, half, mine)] if code == 0b11 else []
        words.append(word.to_bytes(2, "little"))
        for node in inner:
            write(*node)

    write((0, 0, 0), 1 << DEPTH, list(kinds))
    size = count if size is None else size
    header = f"{HEADER}id {name}\nsize {size}\nres {resolution}\ndata\n"
    return header.encode() + b"".join(words)


def test_cells_by_hand():
    one = (MIDDLE, MIDDLE + 2, MIDDLE - 1)
    content = octree_bytes([one], 0.1, free=[(MIDDLE + 1, MIDDLE, MIDDLE)])
    points, edge = read_octomap(content, 0.1)
    assert edge == 0.1
    np.testing.assert_allclose(points, [[0.05, 0.25, -0.05]])
    finer, _ = read_octomap(content, 0.06)
    assert len(finer) == 8
    np.testing.assert_allclose(np.unique(finer[:, 0]), [0.025, 0.075])
    np.testing.assert_allclose(np.unique(finer[:, 2]), [-0.075, -0.025])


def test_eight_cells_that_are_one_leaf():
    block = MIDDLE + np.stack(np.meshgrid(*[range(2, 4)] * 3), -1).reshape(-1, 3)
    content = octree_bytes(block, 0.05)
    assert len(content) - content.index(b"data\n") - 5 == 2 * (DEPTH - 1)
    points, _ = read_octomap(content, 0.05)
    np.testing.assert_allclose(sorted(map(tuple, points)), sorted(map(tuple, 0.05 * (block - MIDDLE + 0.5))))


def test_random_trees_keep_every_cell():
    rng = np.random.default_rng(0)
    for _ in range(5):
        cells = np.unique(MIDDLE + rng.integers(-6, 6, (300, 3)), axis=0)
        points, _ = read_octomap(octree_bytes(cells[::2], 1.0, free=cells[1::2]), 1.0)
        assert sorted(map(tuple, points)) == sorted(map(tuple, cells[::2] - MIDDLE + 0.5))


GOOD = octree_bytes([(MIDDLE, MIDDLE, MIDDLE), (MIDDLE + 7, 3, 9)], 0.05)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a binary OctoMap"),
        (GOOD.replace(b"binary file", b"file"), "not a binary OctoMap.*convert"),
        (GOOD.replace(b"\ndata\n", b"\n"), "no line `data`"),
        (GOOD.replace(b"res 0.05", b"res nan"), "resolution is 'nan'"),
        (GOOD.replace(b"res 0.05", b"res -1"), "resolution"),
        (GOOD.replace(b"res 0.05\n", b""), "no res"),
        (GOOD.replace(b"id OcTree", b"id ColorOcTree"), "'ColorOcTree'"),
        (GOOD.replace(b"size ", b"size -"), "OctoMap size"),
        (octree_bytes([(0, 0, 0)], 0.05, size=3), "says 3 nodes"),
        (GOOD[:-1], "cut short"),
        (GOOD[:-20], "cut short"),
        (GOOD[: GOOD.index(b"data\n") + 5] + 40 * b"\x03\x00", "deeper than 16"),
        (octree_bytes([], 0.05).replace(b"\x00\x00", b"\x02\x00").replace(b"size 1", b"size 2"), "at most 50,000,000"),
    ],
)
def test_damaged_files_are_refused(content, message):
    with pytest.raises(InvalidMap, match=message):
        read_octomap(content, 0.05)


def test_random_bytes_never_crash():
    rng, start = np.random.default_rng(1), GOOD.index(b"data\n") + 5
    for _ in range(300):
        data = bytearray(GOOD)
        for k in rng.integers(0 if rng.random() < 0.3 else start, len(data), rng.integers(1, 6)):
            data[k] = rng.integers(256)
        try:
            points, _ = read_octomap(bytes(data), 0.05)
        except InvalidMap:
            continue
        assert np.isfinite(points).all()


def test_a_floor_between_layers_far_apart_stays():
    layers = np.array([[0.0, 0.0, -0.03], [1.0, 0.0, 0.03]])
    assert Floor.given().among_cells(layers, 0.01).height_m == 0.0
    assert Floor.given().among_cells(layers + [0.0, 0.0, 0.04], 0.01).height_m == pytest.approx(0.01)


@pytest.mark.parametrize("resolution", [0.05, 0.1])
def test_a_hall_through_an_octree(tmp_path, resolution):
    """The same obstacle as of the points, within a cell; no option is needed."""
    points = hall(np.random.default_rng(0), ceiling=False)
    cells = np.unique(np.floor(points / resolution).astype(int), axis=0) + MIDDLE
    (tmp_path / "hall.bt").write_bytes(octree_bytes(cells, resolution))
    options = ImportOptions(start=(0.0, 0.0), goal=(2.0, 0.0))
    of_tree, of_points = import_scene(tmp_path / "hall.bt", options), from_points(points, options, "hall")
    np.testing.assert_allclose(
        of_tree.scene.signed_distance(PROBES), of_points.scene.signed_distance(PROBES), atol=resolution + 0.04
    )
    assert abs(of_tree.scene.source.to_scene(np.zeros(3))[2] - 1.2) < 0.6 * resolution
    assert of_tree.scene.source.file == "hall.bt"
