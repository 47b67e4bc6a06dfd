"""Archives of arrays: read as they were written, and refused in words whatever was done to them."""

import io
import zipfile

import numpy as np
import pytest

from hotice.archives import read_arrays
from hotice.errors import InputError

MANY = 2**20


def npz(**arrays):
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()


def member(content):
    """An archive whose only array is of these bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as file:
        file.writestr("a.npy", content)
    return packed.getvalue()


def header(text):
    line = text.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(line).to_bytes(2, "little") + line


def shaped(shape):
    return member(header(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape},), }}"))


GOOD = npz(a=np.random.default_rng(0).normal(size=500))


def changed(at, value):
    content = bytearray(GOOD)
    content[at] = value
    return bytes(content)


CENTRAL = GOOD.rindex(b"PK\x01\x02")


def test_arrays_are_read_as_they_were_written(tmp_path):
    (tmp_path / "x.npz").write_bytes(npz(a=np.arange(3), b=np.eye(2)))
    read = read_arrays(tmp_path / "x.npz", MANY, MANY)
    assert read.keys() == {"a", "b"}
    np.testing.assert_array_equal(read["a"], [0, 1, 2])
    np.testing.assert_array_equal(read["b"], np.eye(2))


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(b"", id="empty"),
        pytest.param(GOOD[:100], id="cut"),
        pytest.param(changed(100, GOOD[100] ^ 255), id="changed"),
        pytest.param(changed(CENTRAL + 10, 99), id="packed in another way"),
        pytest.param(changed(CENTRAL + 8, 1), id="locked"),
        pytest.param(npz(a=np.array([None])), id="pickle"),
        pytest.param(shaped("1" + "0" * 14), id="larger than memory"),
        pytest.param(shaped("9" * 30), id="larger than a number"),
        pytest.param(shaped("-4"), id="negative"),
        pytest.param(member(header("{'descr': '<f8', 'shape'")), id="header without an end"),
    ],
)
def test_what_is_no_archive_of_arrays_is_refused(tmp_path, content):
    (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"x\.npz: is no archive of arrays"):
        read_arrays(tmp_path / "x.npz", MANY, MANY)


def test_any_changed_byte_is_read_or_refused(tmp_path):
    rng = np.random.default_rng(0)
    for at in rng.integers(0, len(GOOD), 300):
        (tmp_path / "x.npz").write_bytes(changed(at, int(rng.integers(256))))
        try:
            read_arrays(tmp_path / "x.npz", MANY, MANY)
        except InputError as error:
            assert "x.npz" in str(error)


def test_what_unpacks_to_too_much_is_refused(tmp_path):
    (tmp_path / "x.npz").write_bytes(npz(a=np.zeros(2**18)))
    with pytest.raises(InputError, match="unpacks to more than 1 MiB"):
        read_arrays(tmp_path / "x.npz", MANY, MANY)
