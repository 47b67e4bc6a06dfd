"""Whatever a scene, PCD or PLY file holds, the answer is a scene, points, or an error of ours on one short line."""

import copy
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hotice.errors import HoticeError
from hotice.model import Scene, load_scene, load_scenes
from hotice.model.importers.formats.pcd import read_pcd
from hotice.model.importers.formats.ply import read_ply

BOX = {"type": "box", "size_m": [0.2, 2.0, 0.4]}
GOOD = {
    "format": "hotice-scene/1",
    "name": "fuzz",
    "bounds_m": [[-0.5, -1.0, 0.0], [2.5, 1.0, 1.5]],
    "start": {"position_m": [0.0, 0.0], "yaw_rad": 0.0},
    "goal": {"position_m": [2.0, 0.0]},
    "obstacles": [
        {
            "name": "beam",
            "category": "overhead",
            "shape": BOX,
            "position_m": [1.0, 0.0, 1.5],
            "quaternion_wxyz": [1, 0, 0, 0],
        },
        {
            "name": "pipe",
            "category": "ground",
            "shape": {"type": "cylinder", "radius_m": 0.04, "length_m": 2.0},
            "position_m": [1.5, 0.0, 0.04],
        },
        {
            "name": "rod",
            "category": "side",
            "shape": {"type": "capsule", "radius_m": 0.04, "length_m": 1.0},
            "position_m": [1, 0.9, 0.5],
            "motion": {
                "repeat": "loop",
                "between": "smooth",
                "way_points": [
                    {"time_s": 0.5, "position_m": [1, 0.9, 0.0]},
                    {"time_s": 1.5, "position_m": [1, 0.2, 0.0], "yaw_rad": 1.0},
                    {"time_s": 4, "position_m": [1, 0.9, 0], "yaw_rad": 0.0},
                ],
            },
        },
        {
            "name": "ball",
            "category": "side",
            "shape": {"type": "sphere", "radius_m": 0.1},
            "position_m": [1.0, -0.8, 0.1],
        },
        {
            "name": "mesh",
            "category": "side",
            "shape": {"type": "mesh", "file": "tetra.obj", "scale": 0.1},
            "position_m": [1.0, 0.7, 0.1],
        },
    ],
}
TETRA = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
PCD = b"VERSION 0.7\nFIELDS x y z i\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA "
PLY = (
    b"\nelement vertex 2\nproperty float x\nproperty double y\nproperty float z\n"
    b"property list uchar int k\nend_header\n"
)

numbers = st.one_of(
    st.floats(),
    st.integers(),
    st.sampled_from([0, -1, 1e300, -1e-300, 1e-300, 10**400, 5e-324, 2**63, True, 1e4, 0.04]),
)
words = st.one_of(
    st.text(max_size=20),
    st.sampled_from(
        ["", "\0", "\ud800.obj", "../tetra.obj", "/etc/passwd", "a" * 5000, "box", "mesh", "cylinder", ".obj"]
    ),
)
leaves = st.one_of(st.none(), st.booleans(), numbers, words)
values = st.recursive(
    leaves, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(words, inner, max_size=4), max_leaves=8
)


def places(data, path=()):
    yield path
    for key, inner in data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ():
        yield from places(inner, (*path, key))


@st.composite
def mutated(draw):
    data = copy.deepcopy(GOOD)
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from([p for p in places(data) if p]))
        inside = data
        for key in path[:-1]:
            inside = inside[key]
        match draw(st.sampled_from(["replace", "number", "remove", "double", "nest"])):
            case "replace":
                inside[path[-1]] = draw(values)
            case "number":
                inside[path[-1]] = draw(numbers)
            case "remove":
                del inside[path[-1]]
            case "double" if isinstance(inside, list):
                inside.append(inside[path[-1]])
            case "double":
                inside[draw(words)] = inside[path[-1]]
            case "nest":
                inside[path[-1]] = [inside[path[-1]]]
    return json.dumps(data).encode()


@st.composite
def damaged(draw, contents):
    """One of the contents with bytes cut, put in or overwritten."""
    data = bytearray(draw(st.sampled_from(contents)))
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(data)))
        put = draw(
            st.binary(max_size=6) | st.sampled_from([b"-1", b"999999999999", b"1e400", b"NaN", b'{"a":', b"\n", b" x"])
        )
        data[at : at + draw(st.integers(0, 8))] = put
    return bytes(data[: draw(st.integers(0, len(data)))] if draw(st.booleans()) else data)


def acceptable(error):
    text = str(error)
    return isinstance(error, HoticeError) and "\n" not in text and len(text) < 1000


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    (folder / "tetra.obj").write_text(TETRA)
    return folder


def load(folder, content):
    path = folder / "scene.json"
    path.write_bytes(content)
    try:
        scene = Scene.load(path)
        scene.signed_distance([[1.0, 0.0, 0.75]])
        assert Scene.from_dict(scene.to_dict(), folder) == scene
        for time_s in (0.0, 1.7, 1e9):
            assert (
                np.isfinite(scene.at(time_s).still().signed_distance([[1.0, 0.0, 0.75]])).all() or not scene.obstacles
            )
            assert all(np.isfinite(v.v_W).all() for v in scene.at(time_s).velocities)
    except HoticeError as error:
        assert acceptable(error), error


quick = settings(max_examples=500, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@quick
@given(
    content=st.one_of(
        mutated(),
        mutated(),
        damaged([json.dumps(GOOD).encode()]),
        values.map(lambda v: json.dumps(v).encode()),
        st.binary(),
    )
)
def test_scene_files(folder, content):
    load(folder, content)


def clouds(reader, encodings, header):
    row = b"\0\0\x80\x3f" * 6
    contents = [
        header(e) + tail for e in encodings for tail in (b"1 2 3 4\n5 6 7 8\n", row, b"\x08\0\0\0\x1a\0\0\0" + row)
    ]

    @settings(max_examples=200, deadline=None, derandomize=True)
    @given(content=damaged(contents))
    def run(content):
        try:
            assert reader(content).shape[1] == 3
        except HoticeError as error:
            assert acceptable(error), error

    run()


def test_pcd_files():
    clouds(read_pcd, [b"ascii", b"binary", b"binary_compressed"], lambda e: PCD + e + b"\n")


def test_ply_files():
    encodings = [b"ascii", b"binary_little_endian", b"binary_big_endian"]
    clouds(
        read_ply, encodings, lambda e: b"ply\nformat " + e + b" 1.0" + PLY.replace(b"property list uchar int k\n", b"")
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[" * 200_000, "nested too deeply"),
        (b'{"a":' * 900 + b"1" + b"}" * 900, "nested more than 50 deep"),
        (b'{"a":' * 40 + b"1" + b"}" * 40, "format is None"),
        (b"[" * 900 + b"]" * 900, "nested more than 50 deep"),
        (b"[" * 40 + b"]" * 40, "scene is"),
        (json.dumps(GOOD | {"name": "x" * 10**6}).encode(), "1 to 200 printable"),
        (json.dumps(GOOD | {"name": "\ud800"}).encode(), "1 to 200 printable"),
        (json.dumps(GOOD | {"bounds_m": [[0] * 10**5] * 2}).encode(), "list of 3 numbers"),
        (json.dumps(GOOD).replace("2.5", "1e400").encode(), "holds '1e400': numbers must be finite"),
        (json.dumps(GOOD).replace("2.5", "9" * 5000).encode(), "5000 digits"),
        (json.dumps(GOOD).replace("2.5", "9" * 400).encode(), "an integer"),
        (json.dumps(GOOD).replace("0.1}", "1e-300}").encode(), "a finite number from 1e-06 to 10000 is needed"),
        (json.dumps(GOOD).replace("0.9, 0.5", "1e300, 0.5").encode(), "within ±10000"),
        (json.dumps(GOOD | {"bounds_m": [[-9000, -9000, 0], [9000, 9000, 1.5]]}).encode(), "grid nodes"),
        (json.dumps(GOOD | {"bounds_m": [[0, 0, 0], [2, 0, 1.5]]}).encode(), "must grow"),
        (json.dumps(GOOD | {"obstacles": [{}] * 5001}).encode(), "lacks"),
        (
            json.dumps(GOOD | {"obstacles": [GOOD["obstacles"][3] | {"name": f"{i}"} for i in range(5001)]}).encode(),
            "at most 5,000",
        ),
        (json.dumps(GOOD).encode("utf-16"), "not JSON"),
        (b"{" + b",".join(b'"%d": 1' % i for i in range(200_000)) + b"}", "format is None"),
        (b" " * (2**24 + 1), "larger than 16 MiB"),
    ],
)
def test_bombs(folder, content, message):
    path = folder / "bomb.json"
    path.write_bytes(content)
    with pytest.raises(HoticeError, match=message) as caught:
        Scene.load(path)
    assert acceptable(caught.value)


def test_what_is_no_regular_file(tmp_path):
    os.mkfifo(tmp_path / "pipe.json")
    (tmp_path / "loop.json").symlink_to("loop.json")
    (tmp_path / "folder.json").mkdir()
    for path in (
        *tmp_path.iterdir(),
        "/dev/zero",
        "/dev/null",
        tmp_path / "a\0.json",
        tmp_path / ("a" * 5000 + ".json"),
    ):
        with pytest.raises(HoticeError) as caught:
            Scene.load(path)
        assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_forbidden_file(tmp_path):
    path = tmp_path / "scene.json"
    path.write_text("{}")
    path.chmod(0)
    with pytest.raises(HoticeError, match="Permission denied"):
        Scene.load(path)


@pytest.mark.parametrize("name", ["", "a\0b", "x" * 5000, "\ud800", "a/b\0.json", ".", "..", "~", "*"])
def test_names_that_are_none(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for load_any in (load_scene, lambda n: load_scenes([n])):
        with pytest.raises(HoticeError) as caught:
            load_any(name)
        assert "\n" not in str(caught.value)


def test_deep_nesting_at_any_depth_ends_no_process(tmp_path):
    """Also close to the interpreter's limit, where building a message could overflow."""
    code = (
        "import sys, json; from hotice.model import Scene; from hotice.errors import HoticeError\n"
        "for n in range(900, 1100, 7):\n"
        "    for text in ('[' * n + ']' * n, '{\"format\": \"hotice-scene/1\", \"a\": ' + '[' * n + ']' * n + '}'):\n"
        "        open(sys.argv[1], 'w').write(text)\n"
        "        try: Scene.load(sys.argv[1])\n"
        "        except HoticeError: pass\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "deep.json")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
