"""The comparison of branches with one run: what it runs, for how long, and what it writes."""

import json

from benchmarks import branches
from hotice.learn.checkpoints.checkpoint import list_checkpoints, save_checkpoint


def test_each_way_trains_its_time_and_is_evaluated(tmp_path, monkeypatch, capsys):
    seen = []

    def hotice(*argv):
        seen.append(argv)
        options = dict(zip(argv[1:], argv[2:], strict=False))
        out = tmp_path / options["--out"]
        if argv[0] == "train":
            done = list_checkpoints(out)
            minutes = json.loads((done[-1] / "meta.json").read_text())["minutes"] if done else 0.0
            meta = {"minutes": minutes + float(options["--max-minutes"]), "steps": 1000}
            save_checkpoint(out, len(done) + 1, {}, meta)
        else:
            report = {"success_rate": 0.5, "success_interval_95": [0.4, 0.6], "mean_distance_m": 0.2}
            out.write_text(json.dumps(report))

    monkeypatch.setattr(branches, "_hotice", hotice)
    argv = ["--minutes", "6", "--points", "2", "--cores", "2", "--num-envs", "8", "--out", str(tmp_path / "b")]
    assert branches.main([*argv, "--often", "64", "--seldom", "640", "--", "--perturbed"]) == 0
    trained = [line for line in seen if line[0] == "train"]
    assert len(trained) == 6 and all("--perturbed" in line and "--resume" in line for line in trained)
    assert [line[line.index("--max-minutes") + 1] for line in trained] == ["3.0"] * 6
    assert [line[line.index("--num-envs") + 1] for line in trained] == ["8", "8", "4", "4", "4", "4"]
    assert [line[line.index("--merge-every") + 1] for line in trained[2:]] == ["64", "64", "640", "640"]
    content = json.loads((tmp_path / "b" / "curves.json").read_text())
    assert [p["minutes"] for p in content["curves"]["seldom"]] == [3.0, 6.0]
    assert "| seldom | 640 | 1,000 | 2 | 50.0% | 40.0% to 60.0% | 0.200 |" in capsys.readouterr().out
    seen.clear()
    assert branches.main([*argv, "--often", "64", "--seldom", "640"]) == 0 and seen == [], "what is done stays"


def test_environments_that_cannot_be_shared_out_are_refused(tmp_path, capsys):
    argv = ["--minutes", "1", "--cores", "3", "--num-envs", "8", "--out", str(tmp_path / "b")]
    assert branches.main(argv) == 2 and "a multiple of the 3 cores is needed" in capsys.readouterr().err
