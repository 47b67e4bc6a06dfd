"""The tool behind `make docs`: lost names are told, every warning of pdoc is an error."""

import sys
from types import ModuleType

import pytest

from tools import reference


@pytest.mark.parametrize(
    ("name", "there"),
    [
        ("hotice.model", True),
        ("hotice.model.scene.Scene.load", True),
        ("hotice.model.Box.size_m", True),
        ("hotice.fields.hod_pf.HodPf.sgf", True),
        ("hotice.model.scene.Scene.loads", False),
        ("hotice.model.scenery", False),
        ("hotice.nothing.at.all", False),
    ],
)
def test_names_are_looked_up(name, there):
    assert reference.exists(name) is there


def test_lost_names_are_told_with_their_place(tmp_path, monkeypatch):
    (tmp_path / "README.md").write_text("A `hotice.model.scenery` and\n`docs/nothing.md`, `hotice.model` is there.\n")
    (tmp_path / "docs").mkdir()
    monkeypatch.setattr(reference, "ROOT", tmp_path)
    monkeypatch.setattr(reference, "exists", lambda name: name == "hotice.model")
    assert reference.lost() == [
        "README.md:1: hotice.model.scenery does not exist",
        "README.md:2: no file docs/nothing.md",
    ]


def test_a_page_tells_what_a_face_holds(tmp_path, monkeypatch):
    pytest.importorskip("pdoc")
    monkeypatch.setattr(reference, "faces", lambda: ["hotice.fields"])
    reference.write(tmp_path)
    page = (tmp_path / "hotice" / "fields.html").read_text(encoding="utf-8")
    assert "build_hod_pf" in page and "influence_distance_m" in page and "FieldSample" in page


def test_a_warning_fails(tmp_path, monkeypatch):
    pytest.importorskip("pdoc")
    broken = ModuleType("broken_face", "A face.")
    exec("def f(x: 'NoSuchType'): 'One function.'\nf.__module__ = __name__\n__all__ = ['f']", vars(broken))
    monkeypatch.setitem(sys.modules, "broken_face", broken)
    broken.__spec__ = sys.modules["hotice.lazy"].__spec__
    monkeypatch.setattr(reference, "faces", lambda: ["broken_face"])
    with pytest.raises(UserWarning, match="NoSuchType"):
        reference.write(tmp_path)
