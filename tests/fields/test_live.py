"""Fields of scenes that change, `hotice.fields.live`."""

import gc
import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import hotice.fields.live as module
from hotice.errors import FieldsNotBuilt, InvalidScene, UnknownName
from hotice.fields import LiveField, build_hod_pf
from hotice.fields.live import MEMORY
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.geometry.shapes import MeshShape
from hotice.model.scene import MomentaryScene

STANDING = (1.0, 0.0, 0.0, 0.0)
COARSE = {"resolution_m": 0.1}


def post(x, y, name="post"):
    return Obstacle(name, "side", BoxShape((0.2, 0.2, 1.4)), (x, y, 0.7))


@pytest.fixture(scope="module")
def live():
    with LiveField(Scene("room", obstacles=(post(1.0, 0.3),)), **COARSE) as live:
        yield live


def expect_fresh(pf, obstacles):
    fresh = build_hod_pf(Scene("room", obstacles=tuple(obstacles)), **COARSE)
    p_W = np.random.default_rng(0).uniform((-0.4, -0.9, 0.1), (2.4, 0.9, 1.4), (500, 3))
    for a, b in ((pf.sgf, fresh.sgf), (pf.ogf, fresh.ogf)):
        for mine, theirs in zip(a.query(p_W), b.query(p_W), strict=True):
            np.testing.assert_array_equal(mine, theirs)
        np.testing.assert_array_equal(a.geodesic_distance(p_W), b.geodesic_distance(p_W))


def test_after_each_change_fields_are_those_of_a_fresh_build(live):
    live.show([post(1.0, 0.3)])
    expect_fresh(live.wait().fields, [post(1.0, 0.3)])
    live.move({"post": ((0.8, -0.2, 0.7), STANDING)})
    expect_fresh(live.wait().fields, [post(0.8, -0.2)])
    live.add(post(1.4, 0.5, "other"))
    expect_fresh(live.wait().fields, [post(0.8, -0.2), post(1.4, 0.5, "other")])
    live.remove("post")
    expect_fresh(live.wait().fields, [post(1.4, 0.5, "other")])
    assert [o.name for o in live.obstacles] == [o.name for o in live.scene.obstacles] == ["other"]
    assert (live.sgf, live.ogf, live.grid) == (live.fields.sgf, live.fields.ogf, live.fields.grid)


def test_an_older_pair_is_read_on(live):
    before = live.newest
    value = before.fields.sgf.sample(np.array([0.5, 0.1, 0.7]))
    for y in np.linspace(-0.5, 0.5, 5):
        live.show([post(1.0, float(y))])
        live.wait()
    gc.collect()
    np.testing.assert_array_equal(before.fields.sgf.sample(np.array([0.5, 0.1, 0.7])), value)
    assert live.newest.version == before.version + 5


def test_of_many_changes_the_last_is_built_and_those_between_are_skipped(live):
    first = live.newest.version
    versions = [live.show([post(1.0, y)]) for y in np.linspace(-0.5, 0.5, 200).tolist()]
    assert versions == list(range(first + 1, first + 201))
    shown = {live.newest.version}
    while live.newest.version < versions[-1]:
        shown.add(live.newest.version)
        time.sleep(0.001)
    assert len(shown) < 100
    expect_fresh(live.fields, [post(1.0, 0.5)])


def test_ages(live):
    live.show([post(1.0, 0.0)])
    built = live.wait()
    assert live.behind_s == 0.0
    assert 0.0 < built.ready_s - built.given_s <= live.age_s and built.cost_s > 0.0
    os.kill(live._worker.pid, signal.SIGSTOP)
    try:
        given = time.monotonic()
        for x in (1.0, 1.1, 1.2):
            live.show([post(x, 0.0)])
            time.sleep(0.05)
        assert live.newest is built
        assert 0.1 < live.behind_s <= time.monotonic() - given
        with pytest.raises(FieldsNotBuilt, match="not ready after 0.01 s"):
            live.wait(timeout_s=0.01)
    finally:
        os.kill(live._worker.pid, signal.SIGCONT)
    live.wait()
    assert live.behind_s == 0.0


def test_obstacles_may_cover_start_and_goal_and_block_the_way(live):
    wall = Obstacle("wall", "side", BoxShape((0.2, 2.4, 3.0)), (1.0, 0.0, 0.7))
    live.show([post(0.0, 0.0), post(2.0, 0.0, "on_goal"), wall])
    assert live.wait().joined == (False, False)
    assert isinstance(live.scene, MomentaryScene)
    force = live.sgf.sample(np.array([[0.5, 0.4, 0.7], [2.0, 0.0, 0.7]]))
    assert np.isfinite(force).all()
    live.show([])
    assert live.wait().joined == (True, True)


def test_wrong_changes_are_refused_and_change_nothing(live):
    live.show([post(1.0, 0.0)])
    before = live.wait()
    with pytest.raises(UnknownName, match="'chair'"):
        live.move({"chair": ((0.0, 0.0, 0.0), STANDING)})
    with pytest.raises(UnknownName, match="'chair'"):
        live.remove("post", "chair")
    with pytest.raises(InvalidScene, match="post"):
        live.add(post(0.5, 0.0))
    with pytest.raises(InvalidScene, match="nan"):
        live.move({"post": ((float("nan"), 0.0, 0.0), STANDING)})
    assert live.newest is before and live.obstacles == before.fields.scene.obstacles and live.behind_s == 0.0


def test_a_scene_that_cannot_be_built_is_told_and_the_fields_stay(live, tmp_path):
    live.show([])
    before = live.wait()
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nf 1 2 3\n")
    table = Obstacle("table", "side", MeshShape("open.obj", folder=tmp_path), (1.0, 0.0, 0.0))
    live.show([table])
    with pytest.raises(FieldsNotBuilt, match="open.obj"):
        live.wait()
    assert live.newest is before and live.behind_s > 0.0
    live.show([])
    live.wait()
    assert live.behind_s == 0.0


def files(owner=None):
    """Folders that live fields of a process have in memory; other tests run beside this one."""
    return set(MEMORY.glob(f"hotice-{owner or os.getpid()}-*")) if MEMORY.is_dir() else set()


def test_a_worker_that_ends_is_told_and_nothing_is_left():
    known = files()
    live = LiveField(Scene("room"), **COARSE)
    live.add(post(1.0, 0.0))
    built = live.wait()
    os.kill(live._worker.pid, signal.SIGKILL)
    with pytest.raises(FieldsNotBuilt, match="make a new LiveField"):
        while True:
            live.add(post(1.0, 0.0, f"post{live.newest.version}{time.monotonic_ns()}"))
            time.sleep(0.01)
    with pytest.raises(FieldsNotBuilt):
        live.wait()
    assert live.newest is built and np.isfinite(live.sgf.sample(np.zeros(3))).all()
    assert live.behind_s > 0.0
    live.close()
    live.close()
    assert files() <= known


def test_a_field_that_nobody_holds_ends_its_worker():
    known = files()
    live = LiveField(Scene("room"), **COARSE)
    live.add(post(1.0, 0.0))
    live.wait()
    worker = live._worker
    del live
    gc.collect()
    worker.join(10.0)
    assert worker.exitcode == 0 and files() <= known


@pytest.mark.skipif(not MEMORY.is_dir(), reason="files are not memory here")
def test_where_files_find_no_room_the_scene_is_refused_and_the_next_one_is_built():
    known = files()
    with LiveField(Scene("room"), **COARSE) as live:
        (folder,) = files() - known
        shutil.rmtree(folder)
        live.show([post(1.0, 0.0)])
        with pytest.raises(FieldsNotBuilt, match="cannot be kept in .* No such file"):
            live.wait()
        folder.mkdir()
        live.show([post(1.0, 0.1)])
        expect_fresh(live.wait().fields, [post(1.0, 0.1)])
    assert files() <= known


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_nobody_waits_in_vain_when_answers_cannot_be_taken(monkeypatch):
    with LiveField(Scene("room"), **COARSE) as live:
        monkeypatch.setattr(module, "hod_pf_of", lambda *_: 1 / 0)
        live.show([])
        with pytest.raises(FieldsNotBuilt, match="make a new LiveField"):
            live.wait()


def test_changes_from_several_threads_are_all_kept(live):
    live.show([])
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        adding = [
            threading.Thread(target=lambda k=k: [live.add(post(1.0, 0.3, f"{k} {i}")) for i in range(100)])
            for k in range(4)
        ]
        for thread in adding:
            thread.start()
        for thread in adding:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    assert len(live.obstacles) == 400
    live.show([])
    live.wait()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_fork_leaves_worker_and_files_to_who_made_them(live):
    child = os.fork()
    if not child:
        try:
            live._close()
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    live.show([post(1.0, 0.2)])
    expect_fresh(live.wait().fields, [post(1.0, 0.2)])


KILLED = """
import os, signal
from hotice.fields import LiveField
from hotice.fields.live import MEMORY
from hotice.model import Scene
if __name__ == "__main__":
    live = LiveField(Scene("room"), resolution_m=0.1)
    live.show([])
    live.wait()
    print(*MEMORY.glob(f"hotice-{os.getpid()}-*"), flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_program_that_is_killed_leaves_nothing(tmp_path):
    (tmp_path / "program.py").write_text(KILLED)
    program = subprocess.Popen([sys.executable, tmp_path / "program.py"], stdout=subprocess.PIPE, text=True)
    told, _ = program.communicate()
    assert program.returncode == -signal.SIGKILL and told.strip().startswith(str(MEMORY / f"hotice-{program.pid}-"))
    end = time.monotonic() + 30.0
    while files(program.pid) and time.monotonic() < end:
        time.sleep(0.05)
    assert not files(program.pid)
