"""Files appear whole or not at all."""

import pytest

from hotice.errors import OutputError
from hotice.files import write_bytes, written_aside


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
