import numpy as np
import pytest

from hotice.model.importers.meshes import read_triangles
from hotice.model.obj_text import absolute_indices

TWO = b"""v 0 0 0
v 1 0 0
v 0 1 0
f -3 -2 -1
v 0 0 1
v 1 0 1
v 0 1 1
vn 0 0 1
f -3//-1 -2//-1 -1//-1
"""


def test_faces_that_count_backwards_mean_the_vertices_before_them():
    corners = read_triangles(TWO, ".obj")
    np.testing.assert_array_equal(np.sort(corners[:, :, 2].mean(axis=1)), [0.0, 1.0])


def test_each_kind_of_index_counts_its_own():
    assert absolute_indices(TWO).splitlines()[3] == b"f 1 2 3"
    assert absolute_indices(TWO).splitlines()[-1] == b"f 4//1 5//1 6//1"


@pytest.mark.parametrize("text", [b"v 0 0 -1\nf 1 2 3\n", b"", b"# - f -1\n"])
def test_other_text_is_left_alone(text):
    assert absolute_indices(text) is text


def test_a_mesh_obstacle_reads_them_too(tmp_path):
    from hotice.model.meshes import load_mesh

    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = []
    for shift in (0, 5):  # the second cube's faces count back from the vertices before them, the first's too
        lines += [f"v {x + shift} {y} {z}" for x, y, z in corners]
        lines += ["f " + " ".join(str(i - 8) for i in quad) for quad in quads]
    path = tmp_path / "cubes.obj"
    path.write_text("\n".join(lines) + "\n")
    mesh = load_mesh(path, 1.0)
    np.testing.assert_allclose(
        mesh.signed_distance(np.array([[0.5, 0.5, 0.5], [5.5, 0.5, 0.5], [3.0, 0.5, 0.5]])), [-0.5, -0.5, 2.0]
    )
