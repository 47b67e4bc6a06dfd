"""Files appear whole or not at all."""

import os

import pytest

from hotice.errors import InputError, OutputError
from hotice.files import is_file, is_folder, read_bytes, write_bytes, written_aside


def test_a_file_written_aside_appears_at_the_end(tmp_path):
    path = tmp_path / "film.mp4"
    with written_aside(path) as aside:
        assert aside.parent == tmp_path and aside.suffix == ".mp4" and aside.name.startswith(".")
        aside.write_bytes(b"new")
        assert not path.exists()
    assert [p.name for p in tmp_path.iterdir()] == ["film.mp4"] and path.read_bytes() == b"new"


def test_after_an_error_all_is_as_before(tmp_path):
    path = write_bytes(tmp_path / "a", b"old")
    with pytest.raises(KeyError), written_aside(path) as aside:
        aside.write_bytes(b"half")
        raise KeyError
    with pytest.raises(OutputError, match=f"^cannot write {path}: No space left"), written_aside(path) as aside:
        aside.write_bytes(b"half")
        raise OSError(28, "No space left on device")
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and path.read_bytes() == b"old"


@pytest.mark.parametrize("place", ["none/a", "file/a", "folder"])
def test_places_that_cannot_be_written(tmp_path, place):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="^cannot write .*: "):
        write_bytes(tmp_path / place, b"x")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder"]


@pytest.fixture
def fifo(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    return tmp_path / "fifo"


def test_only_so_much_of_a_regular_file_is_read(tmp_path, fifo):
    path = write_bytes(tmp_path / "a", b"x" * 10)
    assert read_bytes(path, 10) == b"x" * 10
    for bad, message in (
        (path, "larger than"),
        (fifo, "regular file"),
        ("/dev/zero", "regular file"),
        (tmp_path, "regular file"),
        (tmp_path / "none", "no such file"),
        ("a\0b", "cannot be read"),
        ("n" * 300, "File name too long"),
        ("/proc/self/environ" if os.environ else path, "larger than"),
    ):
        with pytest.raises(InputError, match=message):
            read_bytes(bad, 9)


def test_questions_about_what_no_path_can_be(tmp_path):
    for text in ("n" * 300, "a\0b", ""):
        assert not is_file(text) and not is_folder(text)
    assert is_folder(tmp_path) and is_folder(".") and not is_file(tmp_path)
