import dataclasses
import json
import shlex
from pathlib import Path

import numpy as np
import onnx
import pytest
import tyro

import hotice.commands.reproduce as module
from hotice.commands.line.parse import Flat
from hotice.commands.paper_tables import TABLES
from hotice.commands.program import main
from hotice.commands.recipes import RECIPES, ReproduceConfig
from hotice.commands.reproduce import reproduce, train_command
from hotice.commands.unseen import Fit
from hotice.errors import CheckpointError, InvalidConfig, Stopped, UnknownName
from hotice.evaluate.config import EvaluateConfig
from hotice.learn.checkpoints.checkpoint import load_checkpoint
from hotice.learn.export import export_onnx
from hotice.learn.policy import torch_policy
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.runner import Runner
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.policy.policy_file import KEY, content_hash, read_onnx_meta
from hotice.task.presets import PRESETS


@pytest.fixture
def scenes(tmp_path):
    """Files of three scenes whose goal is where the robot stands; blocks beside it stand at different places."""
    files = []
    for n, y in enumerate((0.75, 0.8, -0.85)):
        block = Obstacle("block", "side", BoxShape((0.2, 0.2, 1.0)), (0.6 + 0.3 * n, y, 0.5))
        files.append(str(tmp_path / f"near{n}.json"))
        Scene(f"near{n}", goal=(0.04, 0.0), obstacles=(block,)).save(files[-1])
    return files


def quick(tmp_path, scenes, what, **changes):
    given = dict(
        what=what,
        out=tmp_path / "out",
        rollouts=1,
        num_envs=8,
        updates=1,
        threads=1,
        bench=(scenes[0],),
        training=(scenes[0],),
        unseen=tuple(scenes[1:]),
    )
    return ReproduceConfig(**given | changes)


def test_every_row_has_a_recipe_and_every_recipe_a_row():
    assert {row.policy for table in TABLES.values() for row in table.rows} == set(RECIPES)
    for table in TABLES.values():
        assert all(RECIPES[row.policy].test_scenes == table.scenes for row in table.rows)
    assert {RECIPES[row.policy].preset for row in TABLES["table1"].rows} == set(PRESETS)
    assert [RECIPES[row.policy].shape for row in TABLES["table2"].rows] == ["box", "cylinder", "sphere"]


def test_missing_policies_leave_a_row_that_says_so(onnx_file, tmp_path, scenes, capsys):
    config = quick(tmp_path, scenes, "table1", budget="paper", updates=0, policies=(f"dual_hodpf={onnx_file}",))
    result = reproduce(config)
    rows = {row["policy"]: row for row in result["table1"]["rows"]}
    assert rows["dual_hodpf"]["ours"]["success_rate"] == 1.0 and rows["single_sgf"]["ours"] is None
    assert (
        rows["dual_hodpf"]["origin"]["trained"]["updates"] == 2 and rows["dual_hodpf"]["origin"]["trained_by"] is None
    )
    text = (tmp_path / "out" / "tables.md").read_text()
    assert text in capsys.readouterr().out
    assert "no policy `single_sgf`" in text and "| Dual-Agent & HOD-PF | 100.0 |" in text and "88.5" in text
    assert json.loads((tmp_path / "out" / "tables.json").read_text()) == json.loads(json.dumps(result))


def test_what_is_not_given_is_trained_once_and_says_how(onnx_file, tmp_path, scenes, tiny):
    given = (f"dual_hodpf={onnx_file}", f"cylinder={onnx_file}")
    config = quick(tmp_path, scenes, "table2", policies=given)
    result = reproduce(config, tiny(tmp_path))
    origin = result["table2"]["rows"][2]["origin"]
    assert (
        origin["trained"]["updates"] == 1
        and origin["trained"]["steps"] == 64
        and "commit" in origin["trained"]["source"]
    )
    assert "--shapes sphere" in origin["trained_by"] and "--shapes sphere" in origin["evaluated_by"]
    (run,) = (tmp_path / "out" / "runs").iterdir()
    before = {p: p.stat().st_mtime_ns for p in run.rglob("*") if p.is_file()}
    again = reproduce(config, tiny(tmp_path))
    assert again == result and before == {p: p.stat().st_mtime_ns for p in run.rglob("*") if p.is_file()}


def test_the_commands_do_what_they_say(tmp_path, tiny):
    config = tiny(tmp_path / "a run", preset="single_sgf", scenes=("gap", "beam"), curriculum=False, seed=3)
    program, command, *options = shlex.split(train_command(config))
    assert (program, command) == ("hotice", "train")
    assert tyro.cli(Flat[TrainConfig], args=options) == config


@pytest.fixture
def near_policy(tiny, tmp_path, scenes):
    """A policy that was trained on the first of `scenes`."""
    Runner(tiny(tmp_path / "near", scenes=(scenes[0],), updates=1)).train()
    return export_onnx(torch_policy(tmp_path / "near"), tmp_path / "near.onnx")


def test_unseen_scenes(near_policy, tmp_path, scenes):
    onnx_file = near_policy
    config = quick(tmp_path, scenes, "unseen", budget="paper", updates=0, policies=(f"generalist={onnx_file}",))
    result = reproduce(config)["unseen"]
    assert [p["name"] for p in result["points"]] == ["near1", "near2"]
    assert result["training"]["compared"] == 1 and result["training"]["left_out"] == []
    assert result["groups"]["family_unknown"]["rollouts"] == 2 and set(result["groups"]) == {"family_unknown"}
    assert "| of no known family | 2 | 2 | 100.0 |" in (tmp_path / "out" / "tables.md").read_text()
    assert all(0.2 < p["similarity"] < 1.0 and p["nearest"] == "near0" for p in result["points"])
    assert result["points"][0]["similarity"] > result["points"][1]["similarity"]
    assert result["fits"]["success_rate"] == pytest.approx({"slope": 0.0, "intercept": 1.0, "rmse": 0.0}, abs=1e-9)
    assert (tmp_path / "out" / "unseen.png").stat().st_size > 10_000
    command = result["rows"][0]["origin"]["evaluated_by"]
    asked = tyro.cli(Flat[EvaluateConfig], args=shlex.split(command)[2:])
    assert asked.rollouts == 1 and asked.scenes == config.unseen and asked.policy == str(onnx_file)


def test_a_policy_without_a_record_is_refused_before_anything_is_scored(near_policy, tmp_path, scenes, monkeypatch):
    file = without_record(near_policy, tmp_path / "old.onnx")
    config = quick(tmp_path, scenes, "unseen", budget="paper", updates=0, policies=(f"generalist={file}",))
    with monkeypatch.context() as patch:
        patch.setattr(module, "_evaluate", lambda *args: pytest.fail("it was scored"))
        with pytest.raises(CheckpointError, match="carries no record of its training scenes.*--trained-on"):
            reproduce(config)
    named = reproduce(dataclasses.replace(config, trained_on=(scenes[0],)))["unseen"]
    assert named["training"]["told_by_hand"] == 1 and {p["nearest"] for p in named["points"]} == {"near0"}
    config = dataclasses.replace(config, policies=(f"generalist={near_policy}",), trained_on=(scenes[0],))
    with pytest.raises(InvalidConfig, match="carries a whole record"):
        reproduce(config)


def without_record(policy, path):
    """A copy of a policy as it was exported before there were records."""
    model = onnx.load(policy)
    meta = {k: v for k, v in read_onnx_meta(policy.read_bytes(), policy).items() if k not in ("sha256", "trained_on")}
    del model.metadata_props[:]
    meta["sha256"] = content_hash(model, meta)
    model.metadata_props.append(onnx.StringStringEntryProto(key=KEY, value=json.dumps(meta)))
    onnx.save_model(model, path)
    return path


def test_fit_of_a_noisy_line():
    x = np.linspace(0.5, 1.0, 200)
    noise = np.random.default_rng(0).normal(0.0, 0.05, 200)
    fit = Fit.of(x, 0.2 + 0.6 * x + noise)
    assert fit.slope == pytest.approx(0.6, abs=0.05) and fit.intercept == pytest.approx(0.2, abs=0.05)
    assert fit.rmse == pytest.approx(np.std(noise), rel=0.02)
    with pytest.raises(InvalidConfig, match="two that differ"):
        Fit.of([0.5, 0.5], [1.0, 0.0])


@pytest.mark.parametrize(
    "policies, error",
    [(("dual_hodpf",), InvalidConfig), (("dual_hodpf=",), InvalidConfig), (("triple=x",), UnknownName)],
)
def test_policies_given_wrongly(policies, error):
    with pytest.raises(error):
        ReproduceConfig(what="table1", policies=policies)


def test_a_policy_of_another_preset_is_refused(onnx_file, tmp_path, scenes):
    with pytest.raises(InvalidConfig, match="trained as 'dual_hodpf'"):
        reproduce(quick(tmp_path, scenes, "table1", policies=(f"single_sgf={onnx_file}",)))
    with pytest.raises(CheckpointError):
        reproduce(quick(tmp_path, scenes, "table1", policies=("single_sgf=gone/x.onnx",)))


def test_reproduce_as_a_command(onnx_file, tmp_path, scenes):
    options = ["--budget", "paper", "--rollouts", "1", "--threads", "1", "--bench", scenes[0]]
    policies = ["--policies", f"dual_hodpf={onnx_file}"]
    assert main(["reproduce", "table2", *options, *policies, "--out", str(tmp_path / "tables")]) == 0
    assert (tmp_path / "tables" / "tables.md").is_file()


@pytest.mark.slow
def test_all_of_the_paper_from_nothing(tmp_path, scenes, capfd):
    """Every policy is trained (a little) and scored once; each result alone then finds all of it in the same folder."""
    out = tmp_path / "out"
    options = [
        "--rollouts",
        "1",
        "--updates",
        "1",
        "--num-envs",
        "8",
        "--threads",
        "1",
        "--out",
        str(out),
        "--seed",
        "4",
    ]
    options += ["--bench", scenes[0], "--training", scenes[0], "--unseen", *scenes[1:]]
    assert main(["reproduce", "all", *options]) == 0
    whole = json.loads((out / "tables.json").read_text())
    assert sorted(p.name for p in (out / "runs").iterdir()) == sorted(RECIPES)
    assert {"table1", "table2", "unseen"} <= set(whole) and (out / "unseen.png").stat().st_size > 10_000
    for name in TABLES:
        for row in whole[name]["rows"]:
            recipe, origin = RECIPES[row["policy"]], row["origin"]
            assert row["ours"]["rollouts"] == 1 and row["ours"]["success_rate"] == 1.0
            assert origin["trained"]["steps"] == 8 * 24 and origin["preset"] == recipe.preset and origin["perturbed"]
            trained = tyro.cli(Flat[TrainConfig], args=shlex.split(origin["trained_by"])[2:])
            assert (trained.preset, trained.seed, trained.updates) == (recipe.preset, 4, 1)
            assert trained.task.objects.shapes == (recipe.shape,)
            asked = tyro.cli(Flat[EvaluateConfig], args=shlex.split(origin["evaluated_by"])[2:])
            assert asked.shapes == (recipe.shape,) and asked.policy == str(trained.out)
    text = (out / "tables.md").read_text()
    assert all(f"## {table.title}" in text for table in TABLES.values()) and "no policy" not in text
    made = {p: p.stat().st_mtime_ns for p in (out / "runs").rglob("*") if p.is_file()}
    for name in TABLES:
        assert main(["reproduce", name, *options]) == 0
        alone = json.loads((out / "tables.json").read_text())
        assert alone[name] == whole[name] and not (set(TABLES) - {name}) & set(alone)
    assert made == {p: p.stat().st_mtime_ns for p in (out / "runs").rglob("*") if p.is_file()}, (
        "nothing was trained again"
    )


def test_a_training_that_was_interrupted_is_told_and_goes_on(tmp_path, scenes, tiny, monkeypatch):
    given = [f"{name}=unused" for name in PRESETS if name != "single_sgf"]
    monkeypatch.setattr(module, "_check_presets", lambda given: None)
    monkeypatch.setattr(module, "_evaluate", lambda config, name, path, command: pytest.fail(f"{name} was evaluated"))
    config = quick(tmp_path, scenes, "table1", policies=tuple(given), updates=3)
    monkeypatch.setattr(Runner, "due", lambda self: False)

    def stopped_at_once(self):
        self.learn_once()
        self.save()
        return False

    with monkeypatch.context() as patch:
        patch.setattr(Runner, "train", stopped_at_once)
        with pytest.raises(Stopped, match="training of single_sgf was interrupted and is saved: the same"):
            reproduce(config, tiny(tmp_path))
    path, _ = module._train(config, "single_sgf", tiny(tmp_path))
    assert load_checkpoint(Path(path))[1]["update"] == 3
