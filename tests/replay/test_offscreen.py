import pytest

from hotice.replay import offscreen
from hotice.replay.offscreen import NoRenderer, find_renderer
from hotice.replay.video import check_film


@pytest.fixture(autouse=True)
def looked_for_anew(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    find_renderer.cache_clear()
    yield
    find_renderer.cache_clear()


def test_a_second_choice_is_told(monkeypatch):
    """`mujoco.none` stands for a library that is not there, `json` for one without a context."""
    try:
        name, faults = find_renderer()
    except NoRenderer as error:
        pytest.skip(str(error))
    assert faults == "" and check_film() == ""
    find_renderer.cache_clear()
    monkeypatch.setattr(offscreen, "CHOICES", {"none": "mujoco.none", "bare": "json", name: offscreen.CHOICES[name]})
    found, faults = find_renderer()
    assert found == name and "none: ModuleNotFoundError: No module named 'mujoco.none'" in faults
    assert "bare: AttributeError: module 'json' has no attribute 'GLContext'" in faults
    assert check_film() == f"the film is drawn by {name} ({faults})"


def test_none_at_all_is_an_error_that_says_what_to_install(monkeypatch):
    monkeypatch.setattr(offscreen, "CHOICES", {"egl": "mujoco.none"})
    with pytest.raises(NoRenderer, match=r"nothing draws without a screen here \(egl: .*apt install libegl1"):
        find_renderer()


def test_the_one_that_is_asked_for_is_the_only_one_tried(monkeypatch):
    monkeypatch.setattr(offscreen, "CHOICES", {"egl": "mujoco.egl", "osmesa": "mujoco.none"})
    monkeypatch.setattr(offscreen, "LIBRARIES", {"osmesa": "no_library_of_this_name"})
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(NoRenderer, match=r"\(osmesa: libno_library_of_this_name is not found\)"):
        find_renderer()


def test_a_driver_that_ends_its_process_is_a_fault(monkeypatch):
    monkeypatch.setattr(offscreen, "CHOICES", {"own": "mujoco.none"})
    monkeypatch.setattr(offscreen, "_PROBE", "import os; os.abort()")
    with pytest.raises(NoRenderer, match="own: ends with -6"):
        find_renderer()
