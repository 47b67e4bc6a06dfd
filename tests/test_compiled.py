import numba
import numpy as np
import pytest
from numba.core import config

from hotice import compiled as module
from hotice.caches import NotKept
from hotice.compiled import compiled


def add(a, b):
    return a + b


def double(out):
    for i in numba.prange(len(out)):
        out[i] *= 2.0


def test_functions_compile_and_keep_their_options():
    assert compiled(add)(2, 3) == 5
    fast = compiled(error_model="numpy")(lambda a: 1.0 / a)
    assert fast(0.0) == float("inf")
    assert isinstance(compiled(add), numba.core.registry.CPUDispatcher)


def test_the_cache_lies_in_a_folder_of_this_state_of_the_sources(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delenv("HOTICE_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    module.kept_in.cache_clear()
    # numba looks at the changed environment when it compiles next; here it is to do so before
    config.reload_config()
    try:
        before = config.CACHE_DIR
        compiled(add)(1, 1)
        assert config.CACHE_DIR == before
        (folder,) = (tmp_path / "hotice").iterdir()
        assert folder.name == f"numba-{module._digest()}"
        assert list(folder.rglob("*.nbi"))
    finally:
        module.kept_in.cache_clear()


def test_a_function_for_one_thread_and_for_several_is_kept_twice(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    module.kept_in.cache_clear()
    try:
        one, many = compiled(double), compiled(double, parallel=True)
        for made in (one, many):
            out = np.arange(5.0)
            made(out)
            assert out.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0]
        assert len(list(tmp_path.rglob("*.nbi"))) == 2
        assert sum(one.stats.cache_hits.values()) == sum(many.stats.cache_hits.values()) == 0
    finally:
        module.kept_in.cache_clear()


def test_another_source_is_another_folder(tmp_path, monkeypatch):
    source = tmp_path / "kernel.py"
    source.write_text("from hotice.compiled import compiled\n")
    monkeypatch.setattr(module, "_PACKAGE", tmp_path)
    first = module._digest()
    source.write_text("from hotice.compiled import compiled  # changed\n")
    assert module._digest() != first


def test_without_a_folder_nothing_is_kept(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("HOTICE_CACHE", str(blocked))
    module.kept_in.cache_clear()
    try:
        with pytest.warns(NotKept, match="compiled anew in each process: .*set HOTICE_CACHE"):
            made = compiled(add)
        assert made(2, 3) == 5 and not made.stats.cache_path
    finally:
        module.kept_in.cache_clear()


def test_what_others_could_have_filled_is_not_run(tmp_path, monkeypatch):
    """An index of numba's is unpickled: whoever can write it runs code."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    module.kept_in.cache_clear()
    try:
        module.kept_in().chmod(0o777)
        module.kept_in.cache_clear()
        with pytest.warns(NotKept, match="can be written by other users"):
            assert module.kept_in() is None
    finally:
        module.kept_in.cache_clear()
