import time

import numba
import pytest

from hotice import compiling


def test_what_is_compiled_is_told_and_counted_apart(monkeypatch, capsys):
    monkeypatch.delenv("HOTICE_QUIET")
    monkeypatch.setattr(compiling.Compiling, "FIRST_S", 0.0)
    functions = compiling.COMPILING.functions
    monkeypatch.setattr(compiling.COMPILING, "spent_s", 0.0)
    compiling.COMPILING.watch()

    @numba.njit
    def inner(a):
        return a + 1

    @numba.njit
    def outer(a):
        return inner(a) + 1

    with compiling.apart() as took_s:
        begin = time.perf_counter()
        assert outer(1) == 3 and outer(2) == 4
        whole_s = time.perf_counter() - begin
    assert compiling.COMPILING.functions == functions + 1  # the inner one belongs to it
    assert 0.0 < compiling.COMPILING.spent_s <= whole_s
    assert took_s() == pytest.approx(whole_s - compiling.COMPILING.spent_s, abs=0.05)
    said = capsys.readouterr().err
    assert "compiling for this machine, once" in said and "now outer" in said


def test_it_is_not_said_where_every_line_is_read(monkeypatch, capsys):
    monkeypatch.setenv("HOTICE_QUIET", "1")
    monkeypatch.setattr(compiling.Compiling, "FIRST_S", 0.0)
    compiling.COMPILING.watch()
    assert numba.njit(lambda a: a + 1)(1) == 2
    assert capsys.readouterr().err == ""
