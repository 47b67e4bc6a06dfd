import numba
from numba.core import config

from hotice import compiled as module
from hotice.compiled import compiled


def add(a, b):
    return a + b


def test_functions_compile_and_keep_their_options():
    assert compiled(add)(2, 3) == 5
    fast = compiled(error_model="numpy")(lambda a: 1.0 / a)
    assert fast(0.0) == float("inf")
    assert isinstance(compiled(add), numba.core.registry.CPUDispatcher)


def test_the_cache_lies_in_a_folder_of_this_state_of_the_sources(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    module._cache_folder.cache_clear()
    try:
        before = config.CACHE_DIR
        compiled(add)(1, 1)
        assert config.CACHE_DIR == before
        (folder,) = (tmp_path / "hotice").iterdir()
        assert folder.name == f"numba-{module._digest()}"
        assert list(folder.rglob("*.nbi"))
    finally:
        module._cache_folder.cache_clear()


def test_another_source_is_another_folder(tmp_path, monkeypatch):
    source = tmp_path / "kernel.py"
    source.write_text("from hotice.compiled import compiled\n")
    monkeypatch.setattr(module, "_PACKAGE", tmp_path)
    first = module._digest()
    source.write_text("from hotice.compiled import compiled  # changed\n")
    assert module._digest() != first


def test_without_a_home_each_process_compiles_for_itself(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    module._cache_folder.cache_clear()
    try:
        folder = module._cache_folder()
        assert folder.is_dir() and not folder.is_relative_to(blocked)
    finally:
        module._cache_folder.cache_clear()
