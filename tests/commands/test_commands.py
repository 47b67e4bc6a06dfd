"""The command line: each command used once, and everything that can be given wrongly."""

import json
import os
import subprocess
import sys

import pytest

from hotice.commands import scene as scenes
from hotice.commands import table
from hotice.commands.line.options import OPTIONS, SCENE_OPTIONS
from hotice.commands.pipeline.jobs import OUTPUTS
from hotice.commands.program import main
from hotice.errors import HoticeError

COMMANDS = (
    "train",
    "distill",
    "finetune",
    "pipeline",
    "evaluate",
    "reproduce",
    "merge",
    "export",
    "play",
    "watch",
    "tables",
    "benchmark",
    "robot-sim",
    "deploy",
    "robot-check",
    "tags",
    "tag-camera",
)
NAN, INF = float("nan"), float("inf")


def refused(capfd, *argv):
    """Runs a command that must fail: status 2, one line on stderr, no traceback. Returns the line."""
    capfd.readouterr()
    assert main([str(a) for a in argv]) == 2
    out, err = capfd.readouterr()
    lines = [line for line in err.splitlines() if line.strip()]
    assert len(lines) == 1 and lines[0].startswith("hotice: ") and "Traceback" not in out + err, err
    return lines[0]


@pytest.mark.parametrize("name", COMMANDS)
def test_help(name, capsys):
    with pytest.raises(SystemExit) as caught:
        main([name, "--help"])
    assert caught.value.code in (0, None)
    assert "options" in capsys.readouterr().out


def test_every_command_has_the_options_that_jobs_are_checked_against():
    for commands, options in ((table.COMMANDS, OPTIONS), (scenes.COMMANDS, SCENE_OPTIONS)):
        hints = {name: command.__annotations__.get("config") for name, command in commands.items()}
        kinds = {name: kind.__name__ for name, kind in options.items()}
        assert {name: hint for name, hint in hints.items() if hint is not None} == kinds
    assert set(OUTPUTS) <= set(OPTIONS)


def test_help_lists_every_command(capsys):
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    assert all(name in out for name in COMMANDS)


# each command once


def test_train(tmp_path, tiny_options, capsys):
    assert main(["train", "--out", str(tmp_path / "run"), *tiny_options, "--updates", "1", "--scenes", "gap"]) == 0
    assert f"hotice evaluate --policy {tmp_path / 'run'} --scenes gap" in capsys.readouterr().out
    assert (tmp_path / "run" / "checkpoint-0000001" / "meta.json").is_file()


@pytest.mark.slow
def test_export_and_evaluate_as_a_program(run, tmp_path):
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}

    def hotice(*argv):
        return subprocess.run(
            [sys.executable, "-m", "hotice", *map(str, argv)],
            capture_output=True,
            text=True,
            env=environment,
            timeout=300,
        )

    done = hotice("export", "--policy", run, "--out", tmp_path / "p.onnx")
    assert done.returncode == 0 and (tmp_path / "p.onnx").is_file(), done.stderr
    done = hotice("evaluate", "--policy", "nobody", "--scenes", "open_floor")
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1 and "Traceback" not in done.stderr
    out = tmp_path / "r.json"
    done = hotice(
        "evaluate",
        "--policy",
        tmp_path / "p.onnx",
        "--scenes",
        "open_floor",
        "--rollouts",
        2,
        "--seed",
        3,
        "--objects",
        1,
        "--threads",
        1,
        "--out",
        out,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(out.read_text())["seed"] == 3 and "open_floor" in done.stdout


def test_play(onnx_file, tmp_path):
    page = tmp_path / "page.html"
    assert main(["play", "--policy", str(onnx_file), "--scenes", "pillars", "--rollouts", "1", "--out", str(page)]) == 0
    assert page.stat().st_size > 10_000 and page.with_suffix(".png").is_file()


def test_what_moves_is_known_to_play_as_it_is_told(onnx_file, tmp_path, monkeypatch, capsys):
    asked = []

    def record(policy, scene, states, conditions, *, seed):
        asked.append((scene.name, conditions.moving.known))
        raise HoticeError("enough")

    monkeypatch.setattr("hotice.commands.play.record_rollouts", record)
    play = [
        "play",
        "--policy",
        str(onnx_file),
        "--scenes",
        "moving20/01_crossing",
        "--out",
        str(tmp_path / "page.html"),
    ]
    for options, known in ((["--moving", "live"], "live"), (["--moving", "still"], "still"), ([], "near")):
        assert main([*play, *options]) == 2
        assert asked.pop() == ("moving20/01_crossing", known)
    assert main([*play, "--controller", "walk", "--moving", "live"]) == 2
    assert "moving is 'live' and controller 'walk', which knows nothing that moves" in capsys.readouterr().err


def test_tables(capsys):
    assert main(["tables"]) == 0
    out = capsys.readouterr().out
    assert "| S | `ogf_object` |" in out and "| actors, critics | `sgf` | 45 |" in out and "`fall`" in out


def test_tables_say_how_the_field_rewards_differ_from_the_paper(capsys):
    assert main(["tables"]) == 0
    printed = capsys.readouterr().out
    row = next(line for line in printed.splitlines() if "`ogf_object`" in line)
    assert "F_object·speed/η − c" in row and "scaled and softened" in row
    assert "ε = 0.1 m/s, and fade out within 0.5 m of the goal" in printed


def test_tables_are_markdown(capsys):
    """Every row of a table has as many cells as its head, whatever its terms are described by."""
    assert main(["tables"]) == 0
    cells = 0
    for line in capsys.readouterr().out.splitlines():
        now = line.replace("\\|", "").count("|")
        assert not (cells and now) or now == cells, line
        cells = now


def test_benchmark(tmp_path, capsys):
    out = tmp_path / "b.json"
    options = ["--num-envs", "4", "8", "--updates", "1", "--steps", "10", "--threads", "1", "--scenes", "open_floor"]
    assert main(["benchmark", *options, "--out", str(out)]) == 0
    result = json.loads(out.read_text())
    assert [row["num_envs"] for row in result["sizes"]] == [4, 8]
    assert all(
        row[f"{kind}_steps_per_s"] > 0 for row in result["sizes"] for kind in ("training", "environment", "physics")
    )


# scenes given wrongly


def box(**changes):
    return {
        "name": "it",
        "category": "side",
        "shape": {"type": "box", "size_m": [0.2, 0.2, 0.5]},
        "position_m": [1.0, 0.6, 0.25],
        "quaternion_wxyz": [1, 0, 0, 0],
    } | changes


def scene(*obstacles, **changes):
    return {
        "format": "hotice-scene/1",
        "name": "given",
        "bounds_m": [[-0.5, -1.0, 0.0], [2.5, 1.0, 1.5]],
        "start": {"position_m": [0.0, 0.0], "yaw_rad": 0.0},
        "goal": {"position_m": [2.0, 0.0]},
        "obstacles": list(obstacles),
    } | changes


SCENES = {
    "malformed": ("{ not json", "JSON"),
    "a list": ("[]", ""),
    "no goal": (json.dumps({k: v for k, v in scene().items() if k != "goal"}), "goal"),
    "unknown shape": (scene(box(shape={"type": "cone", "size_m": [1, 1, 1]})), "cone"),
    "NaN size": (scene(box(shape={"type": "box", "size_m": [NAN, 0.2, 0.2]})), "finite"),
    "negative size": (scene(box(shape={"type": "box", "size_m": [-0.1, 0.2, 0.2]})), "size_m"),
    "goal inside": (scene(box(position_m=[2.0, 0.0, 0.25])), "goal"),
    "start inside": (scene(box(position_m=[0.0, 0.0, 0.25])), "start"),
    "goal outside the bounds": (scene(goal={"position_m": [9.0, 0.0]}), "goal"),
    "unknown version": (scene(format="hotice-scene/9"), "hotice-scene/9"),
    "mesh missing": (scene(box(shape={"type": "mesh", "file": "gone.obj", "scale": 1.0})), "gone.obj"),
    "mesh elsewhere": (scene(box(shape={"type": "mesh", "file": "../outside.obj", "scale": 1.0})), "outside.obj"),
    "mesh by full path": (scene(box(shape={"type": "mesh", "file": "/etc/passwd", "scale": 1.0})), "passwd"),
}


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("command", ["evaluate", "train"])
def test_scenes(name, command, onnx_file, tmp_path, capfd):
    content, part = SCENES[name]
    (tmp_path / "outside.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    folder = tmp_path / "scenes"
    folder.mkdir()
    file = folder / "given.json"
    file.write_text(content if isinstance(content, str) else json.dumps(content))
    more = ["--policy", onnx_file] if command == "evaluate" else ["--out", tmp_path / "run", "--num-envs", 8]
    assert part in refused(capfd, command, *more, "--scenes", file)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "name", ["gone.json", "nowhere/gone.json", "unheard_of", "family:unheard_of:3", "family:beam:x"]
)
def test_missing_scenes(name, onnx_file, capfd):
    refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", name)


def test_an_empty_folder_of_scenes(onnx_file, tmp_path, capfd):
    refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", tmp_path)


# policies given wrongly


def damaged(run, tmp_path, kind):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    file = sorted(copy.glob("checkpoint-*"))[-1] / "tensors.safetensors"
    content = bytearray(file.read_bytes())
    content[-1] ^= 255
    file.write_bytes(content[: len(content) // 3] if kind == "truncated" else content)
    return copy


@pytest.mark.parametrize("kind", ["truncated", "tampered"])
def test_damaged_checkpoints(run, tmp_path, tiny_options, capfd, kind):
    copy = damaged(run, tmp_path, kind)
    refused(capfd, "evaluate", "--policy", copy, "--scenes", "open_floor")
    refused(capfd, "export", "--policy", copy, "--out", tmp_path / "p.onnx")
    refused(capfd, "train", "--out", copy, "--resume", *tiny_options)
    refused(capfd, "train", "--out", tmp_path / "new", "--init", copy, *tiny_options)


def test_damaged_and_foreign_onnx(onnx_file, tmp_path, capfd):
    import onnx

    path = tmp_path / "p.onnx"
    content = bytearray(onnx_file.read_bytes())
    content[len(content) // 2] ^= 255
    path.write_bytes(content)
    refused(capfd, "evaluate", "--policy", path, "--scenes", "open_floor")
    path.write_bytes(content[:100])
    refused(capfd, "play", "--policy", path)
    model = onnx.load(onnx_file)
    del model.metadata_props[:]
    onnx.save(model, path)
    assert "no hotice policy" in refused(capfd, "evaluate", "--policy", path, "--scenes", "open_floor")


def test_a_policy_of_another_layout(onnx_file, tmp_path, capfd):
    """As a file that is whole, but was made for another observation."""
    import onnx

    from hotice.policy.policy_file import KEY, content_hash

    model = onnx.load(onnx_file)
    meta = json.loads(model.metadata_props[0].value)
    meta.pop("sha256")
    meta["layout"][0][0] = "wind"
    del model.metadata_props[:]
    meta["sha256"] = content_hash(model, meta)
    model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(meta)))
    onnx.save(model, tmp_path / "p.onnx")
    for command in ("evaluate", "play"):
        line = refused(capfd, command, "--policy", tmp_path / "p.onnx", "--scenes", "open_floor")
        assert "observation layout" in line


@pytest.mark.parametrize("command", ["evaluate", "play"])
def test_unknown_policies(command, capfd):
    assert "unknown policy" in refused(capfd, command, "--policy", "nobody", "--scenes", "open_floor")
    refused(capfd, command, "--policy", "no/such/file.onnx", "--scenes", "open_floor")


def test_export_needs_a_checkpoint(onnx_file, tmp_path, capfd):
    refused(capfd, "export", "--policy", tmp_path / "gone", "--out", tmp_path / "p.onnx")


# numbers given wrongly


def test_more_than_the_memory(onnx_file, tmp_path, capfd):
    assert "GiB" in refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", "open_floor", "--rollouts", 10**9)
    assert "GiB" in refused(capfd, "train", "--out", tmp_path / "run", "--num-envs", 10**9)
    assert "GiB" in refused(capfd, "benchmark", "--num-envs", 10**9)
    refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", "open_floor", "--rollouts", 10**9, "--batch", 10**9)


@pytest.mark.parametrize(
    "option, values",
    [
        ("--num-envs", (0, -4)),
        ("--updates", (0, -1)),
        ("--max-minutes", (NAN, INF, -1)),
        ("--checkpoint-minutes", (NAN, -1)),
        ("--checkpoint-updates", (-1,)),
        ("--threads", (-1,)),
        ("--seed", (-1, 2**70)),
        ("--steps", (0, -1)),
        ("--epochs", (0,)),
        ("--gamma", (NAN, 2)),
        ("--lam", (INF,)),
        ("--clip", (0, NAN)),
        ("--learning-rate", (NAN, -1)),
        ("--entropy", (NAN, -1)),
        ("--value-weight", (INF,)),
        ("--mirror-weight", (NAN,)),
        ("--min-std", (-1,)),
        ("--hidden", (0, -3)),
        ("--physics-dt-s", (0, NAN, -1)),
        ("--episode-s", (INF,)),
        ("--speed-m-s", (NAN,)),
        ("--margin-m", (-1, NAN)),
        ("--anywhere", (2, NAN)),
        ("--push-m-s", (NAN, -1)),
        ("--tolerance-m", (NAN, -1)),
        ("--anywhere-yaw-noise-rad", (NAN,)),
    ],
)
def test_numbers_of_training(option, values, tmp_path, capfd):
    for value in values:
        refused(capfd, "train", "--out", tmp_path / "run", option, value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "options",
    [
        ["--rollouts", 0],
        ["--rollouts", -5],
        ["--batch", 0],
        ["--objects", -1],
        ["--seed", -1],
        ["--threads", -2],
        ["--size-m", NAN, 0.4],
        ["--size-m", -0.2, 0.4],
        ["--mass-kg", 1, INF],
        ["--mass-kg", 3, 1],
        ["--shapes", "cone"],
    ],
)
def test_numbers_of_evaluation(options, onnx_file, capfd):
    refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", "open_floor", *options)


@pytest.mark.parametrize("options", [["--rollouts", 0], ["--rollouts", -1], ["--rollouts", 10**9], ["--seed", -1]])
def test_numbers_of_play(options, onnx_file, capfd):
    refused(capfd, "play", "--policy", onnx_file, *options)


@pytest.mark.parametrize("options", [["--num-envs", 0], ["--steps", 0], ["--threads", 0], ["--physics", "bullet"]])
def test_numbers_of_benchmark(options, capfd):
    refused(capfd, "benchmark", *options)


@pytest.mark.parametrize("command", ["train", "benchmark"])
def test_unknown_preset(command, tmp_path, capfd):
    assert "dual_hodpf" in refused(capfd, command, "--out", tmp_path / "x", "--num-envs", 4, "--preset", "triple")


# outputs given wrongly


def bad_outputs(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "folder").mkdir(exist_ok=True)
    return [
        tmp_path / "no" / "such" / "x.json",
        tmp_path / "file" / "x.json",
        tmp_path / "folder",
        "/proc/x/y.json",
        "/proc/y.json",
    ]


def test_outputs_of_evaluate_export_play_and_benchmark(run, onnx_file, tmp_path, capfd):
    for out in bad_outputs(tmp_path):
        small = ["--rollouts", 1, "--objects", 1, "--threads", 1]
        near = tmp_path / "near.json"
        near.write_text(json.dumps(scene(goal={"position_m": [0.04, 0.0]})))
        refused(capfd, "evaluate", "--policy", onnx_file, "--scenes", near, *small, "--out", out)
        refused(capfd, "export", "--policy", run, "--out", out)
        refused(capfd, "play", "--policy", onnx_file, "--scenes", near, "--rollouts", 1, "--out", out)
        refused(
            capfd, "benchmark", "--num-envs", 2, "--steps", 10, "--threads", 1, "--scenes", "open_floor", "--out", out
        )


@pytest.mark.parametrize("out", ["file/run", "file", "/proc/x/run", "/proc/run"])
def test_outputs_of_train(out, tmp_path, tiny_options, capfd):
    (tmp_path / "file").write_text("")
    refused(capfd, "train", "--out", out, *tiny_options, "--updates", 1)
