"""What lets one formula serve NumPy and torch."""

import subprocess
import sys

import numpy as np
import pytest
import torch

from hotice.arrays import clip, length, namespace, picked


def test_namespace_is_that_of_the_array():
    assert namespace(np.zeros(3)) is np and namespace(np.float64(1.0)) is np and namespace(torch.zeros(3)) is torch
    code = "import sys, numpy, hotice.arrays as a; a.namespace(numpy.ones(2)); print('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


@pytest.mark.parametrize("limits", [(-0.2,), (None, 0.3), (-0.2, 0.3)])
def test_length_and_clip_are_the_same_for_both(limits):
    v = np.random.default_rng(0).normal(size=(5, 4, 3))
    np.testing.assert_allclose(length(v), length(torch.from_numpy(v)), rtol=1e-15)
    np.testing.assert_allclose(length(v), np.linalg.norm(v, axis=-1), rtol=1e-15)
    np.testing.assert_array_equal(clip(v, *limits), clip(torch.from_numpy(v), *limits))
    assert clip(np.float64(9.0), *limits) == min(9.0, limits[1] if len(limits) > 1 else 9.0)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_one_number_and_one_vector_are_bit_for_bit_what_many_are(kind):
    rng = np.random.default_rng(1)
    for x in (*rng.normal(size=50).astype(kind), kind("nan"), kind("inf"), kind("-inf")):
        for limits in ((-0.2,), (None, 0.3), (-0.2, 0.3), (0.1, -0.1)):
            got, among_many = clip(x, *limits), clip(np.array([x]), *limits)[0]
            assert type(got) is kind and got.tobytes() == among_many.tobytes(), (x, limits)
    for size in (2, 3, 20):
        v = rng.normal(size=(50, size)).astype(kind)
        assert np.array([length(row) for row in v]).tobytes() == length(v).tobytes()


def test_rows_are_picked_alike():
    rng, index = np.random.default_rng(2), np.array([0, 0, 3, 1])
    for x in (rng.normal(size=(4, 3)), rng.normal(size=(5, 4, 3))):
        expected = np.stack([x[..., i, :] for i in index], axis=-2)
        np.testing.assert_array_equal(picked(x, index), expected)
        np.testing.assert_array_equal(picked(torch.from_numpy(x), index), expected)
        picked(x, index)[:] = 0.0
        assert x.all(), "a copy"
