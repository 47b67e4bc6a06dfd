"""What is kept between calls lies where nobody else can write."""

import os
import stat
import subprocess
import sys

import pytest

from hotice.caches import NotKept, cache_folder, cache_root, kept_or_temporary
from hotice.errors import OutputError


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.setenv("HOTICE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_folders_are_made_for_their_owner_alone(own):
    folder = cache_folder("fields")
    assert folder == own / "fields" and cache_folder("fields") == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_what_others_can_write_is_not_used(own, mode):
    cache_folder("fields").chmod(mode)
    with pytest.raises(OutputError, match="can be written by other users.*chmod 700.*set HOTICE_CACHE"):
        cache_folder("fields")
    with pytest.warns(NotKept, match="made anew in each process"):
        other = kept_or_temporary("fields")
    assert other.is_dir() and not other.is_relative_to(own) and stat.S_IMODE(other.stat().st_mode) == 0o700


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_what_another_user_made_is_not_used(own):
    os.chown(cache_folder("fields"), 12345, 12345)
    with pytest.raises(OutputError, match="belongs to another user"):
        cache_folder("fields")


def test_which_variable_counts(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", "/home/x")
    monkeypatch.delenv("HOTICE_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert str(cache_root()) == "/home/x/.cache/hotice"
    monkeypatch.setenv("XDG_CACHE_HOME", "/xdg")
    assert str(cache_root()) == "/xdg/hotice"
    monkeypatch.setenv("HOTICE_CACHE", "/own")
    assert str(cache_root()) == "/own"


def test_a_folder_that_cannot_be_made_names_the_variable(own):
    own.write_text("")
    with pytest.raises(OutputError, match="cannot keep anything in .*cache/fields: .*set HOTICE_CACHE to a folder"):
        cache_folder("fields")


def test_without_a_home(monkeypatch):
    for name in ("HOTICE_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pwd.getpwuid", lambda uid: {}[uid])
    with pytest.raises(OutputError, match="no home folder: set HOTICE_CACHE"):
        cache_folder("fields")


def test_a_process_without_a_home_works_and_leaves_nothing(tmp_path):
    """Compiled functions are not kept; torch's folder, made at an import, is removed at the end."""
    (tmp_path / "file").touch()
    code = (
        "from hotice.compiled import compiled\nassert compiled(lambda a: a + 1)(1) == 2\n"
        "from hotice.caches import settle_torch\nsettle_torch()\n"
        "import os, onnxruntime\nassert os.listdir(os.environ['TMPDIR'])\n"
    )
    (tmp_path / "code.py").write_text(code)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    environment = {
        k: v
        for k, v in os.environ.items()
        if k not in ("NUMBA_CACHE_DIR", "TORCHINDUCTOR_CACHE_DIR", "ORT_DISABLE_TELEMETRY")
    }
    environment |= {"HOTICE_CACHE": str(tmp_path / "file"), "TMPDIR": str(temporary)}
    done = subprocess.run(
        [sys.executable, str(tmp_path / "code.py")], env=environment, capture_output=True, text=True, check=True
    )
    assert "NotKept" in done.stderr and "set HOTICE_CACHE" in done.stderr
    assert not list(temporary.iterdir())
