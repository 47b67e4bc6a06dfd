"""Files appear whole or not at all."""

import os
import socket
import stat
from pathlib import Path

import pytest

from hotice.errors import InputError, OutputError
from hotice.files import (
    check_folder,
    check_writable,
    is_file,
    is_folder,
    make_folder,
    output_file,
    read_bytes,
    write_bytes,
    written_aside,
)


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


# what may stand where a file goes


@pytest.fixture
def places(tmp_path):
    """Paths at which nothing may be written, by what is there."""
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "folder").mkdir()
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
    found = {"device": Path("/dev/null"), **{name: tmp_path / name for name in ("fifo", "socket", "folder")}}
    for name, path in list(found.items()):
        (tmp_path / f"to_{name}").symlink_to(path)
        found[f"to_{name}"] = tmp_path / f"to_{name}"
    (tmp_path / "round").symlink_to("round")
    return found | {"round": tmp_path / "round"}


def kinds(folder):
    return {p.name: stat.S_IFMT(p.lstat().st_mode) for p in folder.iterdir()}


@pytest.mark.parametrize("write", [lambda p: write_bytes(p, b"x"), check_writable, output_file])
def test_devices_pipes_and_links_to_them_are_never_replaced(tmp_path, places, write):
    before, null = kinds(tmp_path), os.stat("/dev/null").st_mode
    for name, path in places.items():
        with pytest.raises(OutputError, match=f"^cannot write {path}: "):
            write(path)
        assert kinds(tmp_path) == before, name
    assert os.stat("/dev/null").st_mode == null


def test_what_becomes_a_pipe_meanwhile_is_not_replaced(tmp_path):
    path = tmp_path / "a"
    with pytest.raises(OutputError, match="device, pipe or socket"), written_aside(path) as aside:
        aside.write_bytes(b"x")
        os.mkfifo(path)
    assert [p.name for p in tmp_path.iterdir()] == ["a"] and stat.S_ISFIFO(path.stat().st_mode)


def test_a_link_to_a_file_stays_a_link(tmp_path):
    (tmp_path / "store").mkdir()
    for name, kept in (("there", True), ("new", False)):
        target, link = tmp_path / "store" / name, tmp_path / name
        if kept:
            target.write_bytes(b"old")
        link.symlink_to(target)
        check_writable(link)
        write_bytes(link, b"new")
        assert link.is_symlink() and target.read_bytes() == b"new"
    assert sorted(p.name for p in (tmp_path / "store").iterdir()) == ["new", "there"]


def test_names_that_are_none(tmp_path):
    for write in (lambda p: write_bytes(p, b"x"), check_writable, make_folder):
        with pytest.raises(OutputError, match="^cannot (write|create folder) 'a.x00b': "):
            write("a\0b")
        with pytest.raises(OutputError, match="File name too long"):
            write(tmp_path / ("n" * 300))
    assert not list(tmp_path.iterdir())


def test_a_folder_is_checked_before_it_is_made(tmp_path, monkeypatch):
    check_folder(tmp_path / "a" / "b")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()
    (tmp_path / "lost").symlink_to("nowhere")
    for place, there in (("file", "file"), ("file/a/b", "file"), ("lost/a", "lost")):
        with pytest.raises(OutputError, match=f"^cannot create folder {tmp_path / place}: {tmp_path / there} is no"):
            check_folder(tmp_path / place)
    with pytest.raises(OutputError, match="^cannot create folder /dev/null/a: /dev/null is no folder"):
        check_folder("/dev/null/a")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match=f"^cannot write to folder {tmp_path / 'a'}: {tmp_path} is not writable"):
        check_folder(tmp_path / "a")
