"""Valid files with a fault: accepted where that does no harm, else refused on one line. Never anything else."""

import hashlib
import json
import os
import shutil
import zlib

import numpy as np
import onnx
import pytest
import trimesh
import yaml
from onnx import TensorProto, helper

from hotice.deploy.log.frames import MAGIC, LogHeader, frame
from hotice.model.importers.formats.octomap import MIDDLE
from hotice.model.shipped import SHIPPED
from hotice.policy.policy_file import ACTION, KEY, OBSERVATION, content_hash
from tests.attack.mutations import of_bytes, of_value
from tests.model.importers.test_importers import pcd_bytes
from tests.model.importers.test_octomap import octree_bytes

SEED = int(os.environ.get("HOTICE_ATTACK_SEED", "0"))
COUNT = int(os.environ.get("HOTICE_ATTACK_MUTATIONS", "15"))
"""Spoilt files of each kind."""

STATION = {
    "scene": "beam",
    "policy": "student",
    "carried": {"shape": "box", "size_m": [0.3, 0.3, 0.3], "mass_kg": 1.5},
    "physics_dt_s": 0.002,
    "servo": "pd",
    "sensing": {"gravity": 0.05, "root_hz": 10.0, "root_tracking": True, "sensor_delay_steps": 1},
    "dynamics": {"gain": 0.25, "palm_friction": [0.6, 1.2]},
    "safety": {"tilt_rad": 0.8},
    "seed": 3,
    "log_hz": 50.0,
}
PIPELINE = {
    "format": "hotice-pipeline/1",
    "out": "made",
    "defaults": {"train": {"num_envs": 8}},
    "jobs": {
        "teacher": {"command": "train", "each": ["gap", "beam"], "group": 1, "options": {"scenes": "$each"}, "cpus": 1},
        "student": {"command": "distill", "options": {"teachers": "$teacher", "scenes": ["gap"]}, "gpus": 0.5},
        "report": {"command": "evaluate", "options": {"policy": "$student", "scenes": "gap", "rollouts": 10}},
    },
}
MESH = b"""o box
v 0.8 -1 0\nv 1.2 -1 0\nv 1.2 1 0\nv 0.8 1 0\nv 0.8 -1 0.1\nv 1.2 -1 0.1\nv 1.2 1 0.1\nv 0.8 1 0.1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
v -1 -2 0\nv 3 -2 0\nv 3 2 0\nv -1 2 0\nf 9 10 11 12
"""


@pytest.fixture
def rng():
    return np.random.default_rng(SEED)


@pytest.fixture
def files(tmp_path):
    """Function: writes content to a new file of this name."""
    folder = tmp_path / "files"

    def write(name, content):
        path = folder / str(sum(1 for _ in folder.glob("*"))) / name
        path.parent.mkdir(parents=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def spoilt(document, rng, dump, count=None):
    """Texts of a document: half with a value changed, half with bytes changed."""
    for number in range(count or COUNT):
        if number % 2:
            yield of_bytes(dump(document).encode(), rng)
        else:
            yield dump(of_value(document, rng)).encode()


def yaml_text(document):
    # what YAML writes as a number of thousands of digits, Python does not
    return yaml.safe_dump(json.loads(json.dumps(document)), sort_keys=False)


def test_scenes(attack, rng, files):
    content = json.loads((SHIPPED / "pillars.json").read_text())
    paths = [files("scene.json", text) for text in spoilt(content, rng, json.dumps, 2 * COUNT)]
    attack([(str(p), ("scene", "show", p, "--no-robot", "--html", "o.html"), (0, 2)) for p in paths])


@pytest.mark.parametrize("kind, document", [("station", STATION), ("pipeline", PIPELINE)])
def test_configurations(attack, rng, files, kind, document):
    paths = [files("x.yaml", text) for text in spoilt(document, rng, yaml_text, 3 * COUNT)]
    attack([(str(p), (f"load:{kind}", p), (0, 2)) for p in [files("x.yaml", yaml_text(document)), *paths]])


def test_maps(attack, rng, files):
    paths = [files("map.obj", of_bytes(MESH, rng)) for _ in range(max(COUNT // 5, 1))]
    options = ("--start", "0", "0", "--goal", "2", "0", "--out", "o.json")
    attack([(str(p), ("scene", "import", p, *options), (0, 2)) for p in paths])


def clouds(rng):
    """Small files of each format of points and meshes, by ending."""
    points = rng.normal(size=(50, 3))
    cells = np.unique(MIDDLE + rng.integers(-3, 3, (30, 3)), axis=0)
    cloud, box = trimesh.PointCloud(points), trimesh.creation.box((1, 2, 3))
    yield "cloud.pcd", pcd_bytes(points, "ascii")
    yield "cloud.pcd", pcd_bytes(points, "binary")
    yield "cloud.pcd", pcd_bytes(points, "binary_compressed")
    yield "cloud.ply", cloud.export(file_type="ply")
    yield "cloud.bt", octree_bytes(cells[::2], 0.1, free=cells[1::2])
    for ending in ("glb", "stl", "off", "ply"):
        content = box.export(file_type=ending)
        yield f"mesh.{ending}", content if isinstance(content, bytes) else content.encode()


def test_clouds_and_meshes(attack, rng, files):
    """Read only: what a scene is made of them is tried with few, above."""
    lines = []
    for name, content in clouds(rng):
        kind, _, ending = name.partition(".")
        for spoilt_content in (content, *(of_bytes(content, rng) for _ in range(COUNT))):
            lines.append((name, (f"load:{kind}", files(f"x.{ending}", spoilt_content)), (0, 2)))
    attack(lines)


def test_trials(attack, rng, files):
    """Trials that an evaluation kept, and the settings beside them, which may claim any number of blocks."""
    settings = {"rollouts": 6, "batch": 3}
    block = {"outcome": ["success", "fall", "timeout"], "distance_m": [0.1, 1.0, 0.5], "time_s": [3.0, 1.0, 5.0]}
    scene = {"name": "gap", "blocks": {"0": block, "1": {**block, "standing": [True, False, False]}}}
    lines = []
    for number in range(4 * COUNT):
        texts = [json.dumps(settings).encode(), json.dumps(scene).encode()]
        texts[number % 4 > 0] = next(spoilt((settings, scene)[number % 4 > 0], rng, json.dumps, 1))
        path = files("settings.json", texts[0])
        path.with_name("scene-000.json").write_bytes(texts[1])
        lines.append((str(path), ("load:trials", path), (0, 2)))
    for huge in (10**9, 10**400):
        path = files("settings.json", json.dumps({"rollouts": huge, "batch": 1}))
        path.with_name("scene-000.json").write_text(json.dumps(scene))
        lines.append(("huge", ("load:trials", path), (0, 2)))
    attack(lines)


def test_logs_of_robots(attack, rng, files):
    dtype = np.dtype([("number", "<u8"), ("q", "<f8", (29,))])
    header = LogHeader(writer="guard", segment=0, kinds={"target": dtype, "note": None}, about={"scene": "gap"})
    content = header.to_bytes() + b"".join(frame(k % 2, 0.1 * k, bytes(240 if k % 2 == 0 else k)) for k in range(20))
    beginnings = [of_bytes(content[:400], rng) + content[400:] for _ in range(COUNT)]
    for text in (b"[" * 100_000, b'{"kinds": {"x": [["a", "|O"]]}}', b'{"kinds": {"x": [["a", "<f8", [1000000000]]]}}'):
        size, check = (n.to_bytes(4, "little") for n in (len(text), zlib.crc32(text)))
        beginnings.append(MAGIC + size + text + check)
    contents = [content, *beginnings, *(of_bytes(content, rng) for _ in range(COUNT))]
    attack([("log", ("load:log", files("guard-000000.log", each)), (0, 2)) for each in contents])


@pytest.fixture(scope="session")
def policy():
    """The content of a shipped policy and what it says of itself."""
    from hotice.policy.policy_file import POLICIES, read_onnx_meta

    path = POLICIES / "carry.onnx"
    return path.read_bytes(), read_onnx_meta(path.read_bytes(), path)


def scored(path):
    """A line that opens a policy and then ends: there is no such scene."""
    return str(path), ("evaluate", "--policy", path, "--scenes", "nope.json"), (2,)


def test_policies_with_other_bytes(attack, rng, files, policy):
    attack([scored(files("p.onnx", of_bytes(policy[0], rng))) for _ in range(COUNT)])


def test_policies_that_say_something_else_of_themselves(attack, rng, files, policy):
    """With a hash that is right again, as whoever makes such a file would give it."""
    lines = []
    for text in ["[" * 100_000, "{}", '{"format": "hotice-policy/1"}', *spoilt(policy[1], rng, json.dumps, 3 * COUNT)]:
        model = onnx.load_model_from_string(policy[0])
        del model.metadata_props[:]
        text = text if isinstance(text, str) else text.decode(errors="replace")
        try:
            meta = json.loads(text)
            text = json.dumps({**meta, "sha256": content_hash(model, {k: v for k, v in meta.items() if k != "sha256"})})
        except (ValueError, RecursionError, AttributeError, TypeError):
            pass
        model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=text))
        lines.append(scored(files("p.onnx", model.SerializeToString())))
    attack(lines)


def programs():
    """Graphs that no policy has, by name: nodes and tensors between `observation` (N, 201) and `action` (N, 20)."""
    weight = helper.make_tensor("w", TensorProto.FLOAT, (201, 20), np.zeros(4020, np.float32))
    good = helper.make_node("MatMul", [OBSERVATION, "w"], [ACTION])
    elsewhere = onnx.TensorProto()
    elsewhere.CopyFrom(weight)
    elsewhere.ClearField("float_data")
    elsewhere.data_location = TensorProto.EXTERNAL
    elsewhere.external_data.append(onnx.StringStringEntryProto(key="location", value="/etc/passwd"))
    short = onnx.TensorProto()
    short.CopyFrom(weight)
    short.ClearField("float_data")
    short.raw_data = b"\0" * 16
    huge = helper.make_tensor("big", TensorProto.INT64, (2,), [131072, 131072])
    body = helper.make_graph(
        [helper.make_node("Identity", ["c"], ["d"])],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, ()),
            helper.make_tensor_value_info("c", TensorProto.BOOL, ()),
        ],
        [helper.make_tensor_value_info("d", TensorProto.BOOL, ())],
    )
    true = helper.make_tensor("true", TensorProto.BOOL, (), [True])
    yield "sound", [good], [weight]
    yield "unknown", [helper.make_node("Nonsense", [OBSERVATION], [ACTION])], []
    yield "other domain", [helper.make_node("MatMul", [OBSERVATION, "w"], [ACTION], domain="x.y")], [weight]
    yield "other file", [good], [elsewhere]
    yield "cut short", [good], [short]
    yield "no tensor", [good], []
    yield "no node", [], [weight]
    yield "circle", [helper.make_node("Add", ["a", OBSERVATION], ["a"]), good], [weight]
    twice = [helper.make_node("MatMul", [a, "w"], [b]) for a, b in ((OBSERVATION, "a"), ("a", ACTION))]
    yield "wrong shape", twice, [weight]
    yield "68 GB", [helper.make_node("ConstantOfShape", ["big"], ["c"]), good], [weight, huge]
    yield "endless", [helper.make_node("Loop", ["", "true"], [], body=body), good], [weight, true]
    doubled = [helper.make_node("Concat", [f"x{i}"] * 2, [f"x{i + 1}"], axis=1) for i in range(60)]
    yield "doubling", [helper.make_node("Identity", [OBSERVATION], ["x0"]), *doubled, good], [weight]
    rows = [helper.make_node("Concat", [f"x{i}"] * 2, [f"x{i + 1}"], axis=0) for i in range(60)]
    yield "rows", [helper.make_node("Identity", [OBSERVATION], ["x0"]), *rows, good], [weight]
    yield "many", [helper.make_node("Identity", [OBSERVATION], [f"y{i}"]) for i in range(5000)] + [good], [weight]


def test_policies_that_are_other_programs(attack, files, policy, shell, tmp_path):
    lines = []
    for name, nodes, tensors in programs():
        ports = [
            helper.make_tensor_value_info(port, TensorProto.FLOAT, ("batch", width))
            for port, width in ((OBSERVATION, 201), (ACTION, 20))
        ]
        graph = helper.make_graph(nodes, "g", ports[:1], ports[1:], tensors)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
        meta = {k: v for k, v in policy[1].items() if k != "sha256"}
        meta["sha256"] = content_hash(model, meta)
        model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(meta)))
        lines.append((name, *scored(files(f"{name}.onnx", model.SerializeToString()))[1:]))
    attack(lines)
    said = {name: shell([str(word) for word in argv], tmp_path).err for name, argv, _ in lines}
    assert "nope.json" in said.pop("sound")
    assert {"no tensor", "no node"} == {name for name, err in said.items() if "onnxruntime cannot run it" in err}
    assert sum("is no policy as `hotice export` writes it" in err for err in said.values()) == len(said) - 2


def test_checkpoints(attack, rng, run, tmp_path):
    """What a checkpoint notes, and its tensors, with a hash that is right again."""
    source = sorted(run.glob("checkpoint-*"))[-1]
    meta, tensors = json.loads((source / "meta.json").read_text()), (source / "tensors.safetensors").read_bytes()
    lines = []
    for number in range(3 * COUNT):
        folder = tmp_path / f"spoilt{number}" / source.name
        shutil.copytree(source, folder)
        if number % 3 == 0:
            content = of_bytes(tensors, rng)
            (folder / "tensors.safetensors").write_bytes(content)
            (folder / "meta.json").write_text(json.dumps({**meta, "sha256": hashlib.sha256(content).hexdigest()}))
        else:
            (folder / "meta.json").write_bytes(next(spoilt(meta, rng, json.dumps, 1)))
        lines.append((f"{folder}", ("merge", "--parts", folder, run, "--out", "m"), (0, 2)))
    attack(lines)


def test_kept_files(attack, rng, files, tmp_path):
    """Solved fields and plans of the cache, damaged: warned of and made anew, so that the line goes on."""
    from hotice.fields.bank import FieldBank
    from hotice.model.shipped import load_scene

    FieldBank.build([load_scene("gap")], cache=tmp_path / "cache")
    field = next((tmp_path / "cache").glob("*.field")).read_bytes()
    head = b"[" * 100_000 + b"\n" + field
    contents = [head, b"", *(of_bytes(field[:2000], rng) + field[2000:] for _ in range(COUNT))]
    attack([("field", ("load:fields", files("x.field", content)), (0,)) for content in contents])
    attack([("plan", ("load:plan", files("x.npz", of_bytes(b"PK\3\4" + rng.bytes(500), rng))), (0,)) for _ in range(3)])
