"""The commands of `hotice pickup`: help, one real use of each, refusals in one line."""

import json
from collections import Counter
from pathlib import Path

import pytest

from hotice.commands.picks import group
from hotice.commands.program import main
from hotice.errors import PickInfeasible
from hotice.model.picks.book import PickBook

BOOK = Path(__file__).parents[1] / "sim" / "data" / "picks.npz"
SMALL = "--num-envs 4 --steps 4 --minibatches 2 --epochs 1 --hidden 16 --critic-hidden 16 --threads 1 --updates 1"


def run(*line):
    return main(["pickup", *(str(word) for part in line for word in str(part).split())])


@pytest.mark.parametrize("name", list(group.COMMANDS))
def test_help(name, capsys):
    with pytest.raises(SystemExit) as caught:
        run(name, "--help")
    assert caught.value.code in (0, None) and "options" in capsys.readouterr().out


def test_a_book_is_written_with_what_was_refused(tmp_path, monkeypatch, capsys):
    from hotice.control.playback import course

    book = PickBook.load(BOOK)
    given = iter([PickInfeasible("support 0.80 m high is in the way"), book.rows([0]), book.rows([1])])

    def plan_book(pick):
        found = next(given)
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(course, "plan_book", plan_book)
    assert run("plan --count 2 --out", tmp_path / "x.npz") == 0
    assert len(PickBook.load(tmp_path / "x.npz")) == 2
    assert "2 picks; refused 1\n  1 x support # m high is in the way" in capsys.readouterr().out


def test_distill_train_and_evaluate(tmp_path, capsys):
    student, better, report = tmp_path / "student", tmp_path / "better", tmp_path / "r.json"
    assert run("distill", SMALL, "--aggregate 1 --picks", BOOK, "--out", student) == 0
    assert run("train", SMALL, "--picks", BOOK, "--init", student, "--out", better) == 0
    assert run("evaluate --rollouts 5 --threads 1 --policy", better, "--picks", BOOK, "--out", report) == 0
    content = json.loads(report.read_text())
    assert content["format"] == "hotice-pickup-report/1"
    assert {s["shape"]: s["rollouts"] for s in content["shapes"]} == {"box": 3, "cylinder": 1, "sphere": 1}
    assert sum(sum(s["outcomes"].values()) for s in content["shapes"]) == 5
    assert "box: " in capsys.readouterr().out


def test_trials_do_not_depend_on_how_many_follow(monkeypatch, tmp_path):
    from hotice.evaluate import pickups
    from hotice.evaluate.pick_config import PickEvaluateConfig
    from hotice.evaluate.pickups import evaluate_picks

    codes = []
    monkeypatch.setattr(pickups, "BLOCK", 2)
    real = pickups._run
    monkeypatch.setattr(pickups, "_run", lambda env, act: codes.append(env.reset()[0].clone()) or real(env, act))
    monkeypatch.setattr(pickups.PickUpEnv, "label", lambda env: 5.0 * env.action_scale.new_ones(env.num_envs, 20))
    for rollouts in (2, 4):
        evaluate_picks(PickEvaluateConfig(picks=BOOK, rollouts=rollouts, threads=1))
    assert (codes[0] == codes[1]).all()


@pytest.mark.parametrize(
    "line, message",
    [
        ("evaluate --picks nope.npz", "nope.npz"),
        ("evaluate --rollouts 0", "rollouts"),
        ("distill", "no picks"),
        ("train --picks x.npz", "no init"),
        ("plan --out x.json", ".npz file is needed"),
        ("plan --count 0", "count"),
    ],
)
def test_refusals_are_one_line(line, message, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(line) == 2
    out, err = capfd.readouterr()
    lines = [text for text in err.splitlines() if text.strip()]
    assert message in lines[-1] and "Traceback" not in out + err


def test_reasons_are_counted_without_their_numbers():
    from hotice.control.playback.draw import _kind

    texts = ["support 0.70 m high is in the way: x", "support 0.65 m high is in the way: y", "no room"]
    assert Counter(map(_kind, texts)) == {"support # m high is in the way": 2, "no room": 1}
