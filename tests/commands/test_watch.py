"""`hotice watch` and `hotice train --view`: the log as it grows, the newest checkpoint's walks, training as without."""

import http.client
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from hotice.commands.live import run_log, watch
from hotice.commands.live.newest_walks import NewestWalks
from hotice.commands.live.run_log import RunLog
from hotice.commands.live.watch_config import WatchConfig
from hotice.commands.program import main
from hotice.errors import CheckpointError, HoticeError, InvalidConfig
from hotice.failures import INTERRUPTED, STOPPED
from hotice.learn.distill.pick_config import PickDistillConfig
from hotice.learn.train.config import TrainConfig
from hotice.learn.train.pick_config import PickTrainConfig

PATIENCE_S = 120.0


def row(update, **more):
    return json.dumps({"update": update, "steps": 100 * update, "reward": 0.1 * update} | more) + "\n"


def test_a_log_is_read_on_as_it_grows(tmp_path):
    log, path = RunLog(tmp_path), tmp_path / "log.jsonl"
    log.look()
    assert log.curves() == {"steps": [], "reward": [], "success": []} and log.last == {} and log.age_s is None
    path.write_text(row(1) + row(2, **{"share/reached": 0.5, "family/gap": 0.25}))
    log.look()
    assert log.curves() == {"steps": [100, 200], "reward": pytest.approx([0.1, 0.2]), "success": [None, 0.5]}
    assert log.families() == [("gap", 0.25)] and log.last["update"] == 2 and 0 <= log.age_s < 60
    # a row that is being written is taken when it is whole; what is none is left out
    whole = row(3, **{"family/gap": 0.75, "family/beam": 1.0})
    with open(path, "a") as file:
        file.write("no row\n[1]\n" + row(2.5, reward=float("nan")) + whole[:20])
    log.look()
    assert log.curves()["reward"] == pytest.approx([0.1, 0.2, None])
    with open(path, "a") as file:
        file.write(whole[20:])
    log.look()
    assert log.curves()["steps"] == [100, 200, 250, 300]
    assert log.families() == [("beam", 1.0), ("gap", 0.5)]
    # a run that goes on from a checkpoint cuts its log
    path.write_text(row(1))
    log.look()
    assert log.curves()["steps"] == [100] and log.families() == []


def test_curves_stay_short_and_families_are_of_the_newest(tmp_path):
    log, count = RunLog(tmp_path), 10 * run_log.MOST_POINTS + 3
    (tmp_path / "log.jsonl").write_text("".join(row(n, **{"family/gap": float(n > count - 20)}) for n in range(count)))
    log.look()
    curve = log.curves()
    assert run_log.MOST_POINTS <= len(curve["steps"]) <= 2 * run_log.MOST_POINTS
    # means of as many updates each: on a straight line they lie on it
    assert curve["reward"] == pytest.approx([steps / 1000 for steps in curve["steps"]])
    assert curve["steps"][0] < 1000 and curve["steps"][-1] > 100 * (count - 20)
    assert log.families() == [("gap", pytest.approx(19 / 20))]


def test_walks_are_of_the_same_scenes_each_time(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    content = json.loads((copy / "config.json").read_text())
    (copy / "config.json").write_text(json.dumps(content | {"scenes": ["bench20"]}))
    first, second, other = (NewestWalks(copy, 3, seed) for seed in (0, 0, 1))
    names = [scene.name for scene in first.scenes]
    assert len(names) == 3 and names == [scene.name for scene in second.scenes] == sorted(names)
    assert names != [scene.name for scene in other.scenes]
    (copy / "config.json").write_text(json.dumps(content))
    walks = NewestWalks(copy, 3, 0)
    assert [scene.name for scene in walks.scenes] == ["open_floor"] and walks.seen is None
    newest = walks.newest()
    assert newest == copy / "checkpoint-0000002"
    (record,) = walks.walk(newest)
    assert record.scene.name == "open_floor" and walks.seen == newest and len(record.time_s) > 5
    (newest / "tensors.safetensors").write_bytes(b"cut")
    with pytest.raises(CheckpointError):
        list(walks.walk(newest))
    shutil.rmtree(newest)
    assert walks.newest() is None


@pytest.mark.parametrize(
    ("content", "why"),
    [(None, "no such file"), ("[]", "names no scenes"), ('{"scenes": [1]}', "names no scenes"), ("{", "is not JSON")],
)
def test_what_is_no_run_is_refused(tmp_path, content, why, capsys):
    if content is not None:
        (tmp_path / "config.json").write_text(content)
    assert main(["watch", str(tmp_path)]) == 2
    assert why in " ".join(capsys.readouterr().err.split())


def test_pick_ups_are_not_watched(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"scenes": ["open_floor"], "picks": "book.npz"}))
    with pytest.raises(InvalidConfig, match="of pick-ups, which are not watched"):
        NewestWalks(tmp_path, 1, 0)
    for kind in (PickTrainConfig, PickDistillConfig):
        with pytest.raises(InvalidConfig, match="pick-ups are not shown"):
            kind(picks=Path("book.npz"), view=True)


def test_a_port_needs_a_view():
    with pytest.raises(InvalidConfig, match="view_port is 8000: there is no page without view"):
        TrainConfig(view_port=8000)
    with pytest.raises(InvalidConfig, match="view_port is 70000"):
        TrainConfig(view=True, view_port=70000)


class Page:
    """`watch` in a thread of its own; what it serves."""

    def __init__(self, config, monkeypatch):
        monkeypatch.setattr(watch, "LOOK_S", 0.05)
        monkeypatch.setattr(watch.os, "nice", lambda _: None)
        self.ended, told, self.errors = threading.Event(), threading.Event(), []

        def say(url):
            self.place = re.match(r"http://([^/]+)/", url)[1]
            told.set()

        def work():
            try:
                watch.watch(config, say, self.ended)
            except HoticeError as error:
                self.errors.append(error)
            told.set()

        self.thread = threading.Thread(target=work)
        self.thread.start()
        assert told.wait(PATIENCE_S)

    def text(self):
        connection = http.client.HTTPConnection(self.place, timeout=PATIENCE_S)
        connection.request("GET", "/")
        return connection.getresponse().read().decode()

    def frames(self):
        """Frames as they come; None when it is over."""
        connection = http.client.HTTPConnection(self.place, timeout=PATIENCE_S)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        for line in answer:
            if line.startswith(b"event: over"):
                yield None
                return
            if line.startswith(b"data: "):
                yield json.loads(line[6:])

    def end(self):
        self.ended.set()
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()


def test_a_page_follows_a_run_from_before_its_beginning_to_its_end(run, tmp_path, monkeypatch):
    page = Page(WatchConfig(run=tmp_path / "run", wait=True), monkeypatch)
    try:
        assert "has not begun" in page.text()
        (tmp_path / "run").mkdir()
        shutil.copy(run / "config.json", tmp_path / "run")
        end = time.monotonic() + PATIENCE_S
        while '"watches":' not in page.text():
            assert time.monotonic() < end
            time.sleep(0.05)
        assert "connect-src 'self'" in page.text()
        frames = page.frames()
        first = next(frames)
        assert first["version"] == 0 and "no checkpoint yet" in first["said"] and first["curves"]["steps"] == []
        shutil.copytree(run, tmp_path / "run", dirs_exist_ok=True)
        walked = next(frame for frame in frames if frame["version"] == 1)
        assert walked["said"] == "checkpoint-0000002, without exploration" and walked["last"]["update"] == 2
        assert walked["curves"]["steps"] == [64, 128] and '"version":1' in page.text().replace('": ', '":')
        # the page was not loaded anew: nobody waits for more walks
        shutil.copytree(run / "checkpoint-0000002", tmp_path / "run" / "checkpoint-0000003")
        for _ in range(3):
            next(frames)
        assert '"version":1' in page.text().replace('": ', '":')
        again = page.frames()
        assert next(frame for frame in again if frame["version"] == 2)["said"].startswith("checkpoint-0000003")
        (tmp_path / "run" / "checkpoint-0000004").mkdir()
        third = page.frames()
        assert next(f for f in third if "not shown" in f["said"])["said"].startswith("checkpoint-0000004 is not shown:")
    finally:
        page.end()
    assert page.errors == []
    assert [frame for frame in third if frame is None] == [None]


def test_a_port_that_is_taken_is_told(run, monkeypatch):
    first = Page(WatchConfig(run=run), monkeypatch)
    try:
        port = int(first.place.split(":")[1])
        second = Page(WatchConfig(run=run, port=port), monkeypatch)
        second.end()
        assert "cannot be used for the live page" in str(second.errors[0])
    finally:
        first.end()


def same_rows(path):
    """Rows of a log without what depends on the clock."""
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    timed = ("minutes", "steps_per_s", "seconds/collect", "seconds/learn")
    return [{name: value for name, value in row.items() if name not in timed} for row in rows]


@pytest.mark.slow
def test_a_run_that_is_shown_learns_the_same(tmp_path, tiny_options):
    """To the last bit: stopped after a checkpoint has walked beside it, and compared with as many updates alone."""
    alone, shown = (tmp_path / name for name in ("alone", "shown"))
    options = ["--checkpoint-updates", "5", *tiny_options]
    command = [sys.executable, "-m", "hotice", "train", "--out", str(shown), "--view", "--updates", "100000", *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        lines = iter(process.stderr)
        place = next(found[1] for line in lines if (found := re.search(r"live page: http://([^/]+)/", line)))
        connection = http.client.HTTPConnection(place, timeout=PATIENCE_S)
        connection.request("GET", "/events")
        answer = connection.getresponse()
        assert any(b'"version":1,' in line for line in answer)
        process.send_signal(signal.SIGINT)
        assert any(line.startswith(b"event: over") for line in answer)
        process.stderr.read()
        assert process.wait(PATIENCE_S) == STOPPED
    finally:
        process.kill()
        process.communicate()
    newest = sorted(shown.glob("checkpoint-*"))[-1]
    updates = int(newest.name.removeprefix("checkpoint-"))
    assert main(["train", "--out", str(alone), "--updates", str(updates), *options]) == 0
    assert same_rows(alone / "log.jsonl") == same_rows(shown / "log.jsonl")
    assert (alone / newest.name / "tensors.safetensors").read_bytes() == (newest / "tensors.safetensors").read_bytes()


def ends_with(process_id):
    """Whether a process is gone, or a zombie that nobody has asked for."""
    try:
        return Path(f"/proc/{process_id}/stat").read_text().split(")")[1].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_the_page_goes_when_the_training_is_killed(tmp_path, tiny_options):
    command = [sys.executable, "-m", "hotice", "train", "--out", str(tmp_path / "run"), "--view", *tiny_options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert any("live page: http" in line for line in process.stderr)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    assert children
    process.kill()
    process.wait()
    process.stderr.close()
    end = time.monotonic() + PATIENCE_S
    while not all(map(ends_with, children)):
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.mark.slow
def test_ctrl_c_ends_it(run):
    command = [sys.executable, "-m", "hotice", "watch", str(run)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert "live page of" in process.stdout.readline()
    assert os.getpriority(os.PRIO_PROCESS, process.pid) == watch.NICE
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == INTERRUPTED and said == "hotice: interrupted\n"


def test_options_are_checked():
    for wrong in ({"rollouts": 0}, {"rollouts": 21}, {"port": -1}, {"seed": 0.5}):
        with pytest.raises(InvalidConfig, match=next(iter(wrong))):
            replace(WatchConfig(run=Path("run")), **wrong)
