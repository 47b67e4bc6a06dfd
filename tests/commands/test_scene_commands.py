import json
import threading
import urllib.request

import numpy as np
import pytest

from hotice.commands.program import main
from hotice.model import Scene

CROP = ["--start", "0", "0", "--goal", "2", "0"]


def run(*arguments):
    return main(["scene", *map(str, arguments)])


def refused(capsys, *arguments):
    """The one line that a bad request prints; nothing else happens."""
    assert run(*arguments) == 2
    out, err = capsys.readouterr()
    assert err.startswith("hotice: ") and err.count("\n") == 1, err
    assert not out.strip()
    return err


@pytest.fixture(scope="module")
def cloud(tmp_path_factory):
    """A floor with a block across half the way, as an ascii PCD."""
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(-2, 4, 40_000), rng.uniform(-2, 2, 40_000), np.zeros(40_000)])
    block = np.column_stack([np.full(4000, 1.0), rng.uniform(0.3, 0.9, 4000), rng.uniform(0, 1, 4000)])
    points = np.concatenate([floor, block]) + rng.normal(0, 0.003, (44_000, 3)) + [0.0, 0.0, 0.4]
    path = tmp_path_factory.mktemp("maps") / "hall.pcd"
    n = len(points)
    header = f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA ascii\n"
    path.write_text(header + "\n".join("{:.4f} {:.4f} {:.4f}".format(*p) for p in points))
    return path


@pytest.mark.parametrize("command", [[], ["import"], ["import-front3d"], ["show"], ["check"], ["list"], ["generate"]])
def test_help(command, capsys):
    if command:
        with pytest.raises(SystemExit) as done:
            run(*command, "--help")
        assert done.value.code == 0
    else:
        assert run("--help") == 0
    assert "usage: hotice scene" in capsys.readouterr().out


def test_import_writes_scene_and_picture(cloud, tmp_path, capsys):
    out = tmp_path / "scene.json"
    assert run("import", cloud, *CROP, "--out", out) == 0
    text = capsys.readouterr().out
    assert "noise" in text and "scene.json" in text and "scene.png" in text
    scene = Scene.load(out)
    assert scene.name == "hall" and {o.category for o in scene.obstacles} == {"side"}
    assert (tmp_path / "scene.png").read_bytes().startswith(b"\x89PNG")
    assert run("import", cloud, "--start", "0", "-0.2", "0.5", "--goal", "2", "0", "--out", out, "--name", "other") == 0
    assert Scene.load(out).start == (0.0, -0.2, 0.5) and Scene.load(out).name == "other"


def test_refused_imports_write_nothing(cloud, tmp_path, capsys):
    (tmp_path / "cut.pcd").write_bytes(cloud.read_bytes()[:1000])
    (tmp_path / "empty.ply").write_bytes(b"")
    (tmp_path / "words.obj").write_text("no mesh\n")
    out = tmp_path / "out" / "scene.json"
    out.parent.mkdir()
    for name in ("cut.pcd", "empty.ply", "words.obj", "none.pcd", "words.txt", "."):
        refused(capsys, "import", tmp_path / name, *CROP, "--out", out)
    refused(capsys, "import", cloud, "--start", "0", "--goal", "2", "0", "--out", out)
    refused(capsys, "import", cloud, "--start", "1", "0.6", "--goal", "2", "0", "--out", out)
    refused(capsys, "import", cloud, *CROP, "--out", out.with_suffix(".txt"))
    refused(capsys, "import", cloud, *CROP, "--out", tmp_path / "missing" / "scene.json")
    refused(capsys, "import", cloud, *CROP, "--voxel-m", "nan", "--out", out)
    assert list(out.parent.iterdir()) == []


def test_an_import_that_cannot_be_written_leaves_nothing(tmp_path, capsys):
    """Of two meshes the second is there already and another one: the first is not left behind."""
    import trimesh

    floor = [[(-2, -2, 0), (4, -2, 0), (4, 2, 0)], [(-2, -2, 0), (4, 2, 0), (-2, 2, 0)]]
    boxes = [
        trimesh.creation.box((0.3, 0.3, h), trimesh.transformations.translation_matrix((0.8 + h, 0.7, h / 2)))
        for h in (0.4, 0.8)
    ]
    corners = np.concatenate([floor, *(b.vertices[b.faces] for b in boxes)])
    lines = [f"v {x} {y} {z}" for x, y, z in corners.reshape(-1, 3)]
    lines += [f"f {k} {k + 1} {k + 2}" for k in range(1, len(lines), 3)]
    (tmp_path / "hall.obj").write_text("\n".join(lines))
    out = tmp_path / "out"
    out.mkdir()
    (out / "hall_002.obj").write_text("another")
    assert "is another mesh" in refused(capsys, "import", tmp_path / "hall.obj", *CROP, "--out", out / "scene.json")
    assert [p.name for p in out.iterdir()] == ["hall_002.obj"]
    (out / "hall_002.obj").unlink()
    (out / "scene.png").mkdir()
    assert "it is a folder" in refused(capsys, "import", tmp_path / "hall.obj", *CROP, "--out", out / "scene.json")
    assert [p.name for p in out.iterdir()] == ["scene.png"]
    (out / "scene.png").rmdir()
    assert run("import", tmp_path / "hall.obj", *CROP, "--out", out / "scene.json") == 0
    assert sorted(p.name for p in out.iterdir()) == ["hall_001.obj", "hall_002.obj", "scene.json", "scene.png"]
    assert Scene.load(out / "scene.json").source.file == "hall.obj"


def test_show_writes_a_page_of_its_own(tmp_path, capsys):
    out = tmp_path / "page.html"
    assert run("show", "beam", "family:gap:2", "--html", out) == 0
    page = out.read_text()
    assert str(out) in capsys.readouterr().out
    assert page.count("', '") > 30  # drawing commands inline
    assert 'src="http' not in page
    refused(capsys, "show", "nothing", "--html", out)
    refused(capsys, "show", "--html", out)
    refused(capsys, "show", "beam", "--html", tmp_path / "missing" / "page.html")
    refused(capsys, "show", "beam", "--port", "99999")


def test_names_that_look_alike_are_all_shown(tmp_path, monkeypatch):
    from hotice.model import Obstacle
    from hotice.model.geometry.shapes import BoxShape
    from hotice.replay import scene_view

    names = ("shelf/left", "shelf left", "shelf left (2)", "shelf left")
    assert scene_view.viewer_names(names) == ["shelf left", "shelf left (3)", "shelf left (2)", "shelf left (4)"]
    boxes = tuple(
        Obstacle(name, "side", BoxShape((0.2, 0.2, 0.8)), (0.5 + 0.7 * k, 0.6, 0.4)) for k, name in enumerate(names[:3])
    )
    shown, add = [], scene_view._add_solid

    def noted(at, *arguments):
        shown.append(at.path.lower())
        add(at, *arguments)

    monkeypatch.setattr(scene_view, "_add_solid", noted)
    scene_view.scene_page([Scene("a/b", obstacles=boxes)], robot=True)
    assert len(set(shown)) == len(shown) and sum("obstacles" in path for path in shown) == 3


def test_page_is_served(tmp_path):
    from hotice.replay.scene_view import page_server

    server = page_server("<p>scene</p>", 0)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    with urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/") as answer:
        assert answer.read() == b"<p>scene</p>"
    from hotice.errors import HoticeError

    with pytest.raises(HoticeError, match="cannot be used"):
        page_server("", server.server_port)
    server.shutdown()
    thread.join()
    server.server_close()


def test_check_says_which_scene_is_bad(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    content = json.loads(json.dumps(Scene("walled").to_dict()))
    wall = {"type": "box", "size_m": [0.1, 2.2, 2.0]}
    content["obstacles"] = [{"name": "w", "category": "side", "shape": wall, "position_m": [1, 0, 1]}]
    (tmp_path / "walled.json").write_text(json.dumps(content))
    (tmp_path / "broken.json").write_text("{")
    assert run("check", "open_floor") == 0
    assert "ok" in capsys.readouterr().out
    assert run("check", "open_floor", tmp_path, "nothing") == 1
    out = " ".join(capsys.readouterr().out.split())
    for words in ("walled", "broken.json", "not JSON", "nothing", "unknown scene"):
        assert words in out
    refused(capsys, "check")


def moving_scene(speed):
    from hotice.model.moving.person import walking_person

    return Scene("walks", obstacles=walking_person("ann", [(1.0, -0.9), (1.0, 0.9)], speed))


def test_what_moves_is_checked_in_time(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "400")
    moving_scene(0.8).save(tmp_path / "walks.json")
    assert run("check", tmp_path / "walks.json") == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "2s 2m" in out and "ok, there in" in out
    from hotice.model import Obstacle
    from hotice.model.geometry.shapes import BoxShape
    from hotice.model.moving.motion import Motion, WayPoint

    shut = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(1.0, y, 0.0)) for t, y in ((0.0, 2.2), (0.9, 0.0))))
    Scene(
        "shuts", obstacles=(Obstacle("gate", "side", BoxShape((0.1, 3.0, 1.5)), (1.0, 2.2, 0.75), motion=shut),)
    ).save(tmp_path / "shuts.json")
    assert run("check", tmp_path / "shuts.json") == 1
    assert "no way in time: at 4.5 s" in " ".join(capsys.readouterr().out.split())
    assert "obstacle 'gate' moves, which a map does not know yet" in refused(capsys, "scan", tmp_path / "shuts.json")


def test_ways_of_what_moves_are_drawn(monkeypatch):
    from hotice.replay import scene_view

    drawn, add = {}, scene_view._add_segments
    monkeypatch.setattr(
        scene_view, "_add_segments", lambda at, *rest: (drawn.update({at.path.lower(): rest}), add(at, *rest))
    )
    scene_view.scene_page([moving_scene(0.9)], robot=False)
    (start, shaft, _), *others = [rest for path, rest in drawn.items() if "motions" in path]
    assert len(others) == 1 and len(start) == 10
    np.testing.assert_allclose(start[0, :2], (1.0, -0.9))
    np.testing.assert_allclose((start + shaft)[-1, :2], (1.0, 0.9))
    np.testing.assert_allclose(shaft, np.tile([0.0, 0.18, 0.0], (10, 1)), atol=1e-12)


def test_list_names_scenes_and_families(capsys):
    assert run("list") == 0
    out = capsys.readouterr().out
    assert "open_floor" in out and "bench20" in out and "mixed" in out


def test_generate_writes_files(tmp_path, capsys):
    out = tmp_path / "made"
    assert run("generate", "family:pipe:2:5", "family:gap:1", "--out", out) == 0
    files = sorted(out.iterdir())
    assert len(files) == 3 and all(Scene.load(f) for f in files)
    assert "3 scenes in" in capsys.readouterr().out
    refused(capsys, "generate", "--out", tmp_path / "none")
    refused(capsys, "generate", "beam", "--out", tmp_path / "none")
    refused(capsys, "generate", "family:nobody:2", "--out", tmp_path / "none")
    refused(capsys, "generate", "family:gap:1", "family:gap:1", "--out", tmp_path / "none")
    assert not (tmp_path / "none").exists()
