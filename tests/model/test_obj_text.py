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
