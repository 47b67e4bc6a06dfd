import dataclasses
import sys

import numpy as np
import pytest

from hotice.commands.program import main
from hotice.errors import InvalidConfig, OutputError
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.record import failures_first, record_rollouts
from hotice.learn.policy import load_policy
from hotice.model import Box
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.replay.video import FRAMES_PER_S, SIZE_PX, STILL_S, film_frames, write_video

WALL = Obstacle("wall", "side", BoxShape((0.1, 0.6, 0.6)), (0.75, 0.0, 0.9))


@pytest.fixture(scope="module")
def record(onnx_file):
    """A short rollout that ends at a wall or before."""
    policy = load_policy(onnx_file, threads=1)
    states = [solve_carry(Box((0.3, 0.3, 0.3), 1.0))]
    (record,) = record_rollouts(policy, Scene("wall", obstacles=(WALL,)), states, Conditions(), seed=0, threads=1)
    return record.every(0.1)


def test_a_film_can_be_read_back(record, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    seen = []
    path = write_video(record, tmp_path / "film.mp4", lambda n, total: seen.append((n, total)))
    frames = imageio_ffmpeg.read_frames(str(path))
    meta = next(frames)
    images = [np.frombuffer(f, dtype=np.uint8).reshape(SIZE_PX[1], SIZE_PX[0], 3) for f in frames]
    assert meta["size"] == SIZE_PX and meta["fps"] == FRAMES_PER_S and meta["codec"] == "h264"
    assert len(images) == len(film_frames(record)) == len(seen) == seen[-1][1]
    assert images[0].std() > 5 and np.abs(images[0].astype(int) - images[-1]).max() > 50
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.mp4"]


def test_frames_keep_the_rollouts_time(record):
    frames = film_frames(record)
    time = record.time_s - record.time_s[0]
    assert frames == sorted(frames) and frames[0] == 0 and frames[-1] == len(time) - 1
    assert len(frames) / FRAMES_PER_S == pytest.approx(time[-1] + STILL_S, abs=0.05)
    for n, frame in enumerate(frames):
        assert time[frame] <= n / FRAMES_PER_S + 1e-6
        assert frame == len(time) - 1 or time[frame + 1] > n / FRAMES_PER_S


def test_what_cannot_be_written(record, tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    with pytest.raises(InvalidConfig, match=".mp4"):
        write_video(record, tmp_path / "film.avi")
    with pytest.raises(OutputError, match="gone"):
        write_video(record, tmp_path / "gone" / "film.mp4")
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(InvalidConfig, match="pip install"):
        write_video(record, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


def test_failures_come_first(record):
    outcomes = ["success", "drop", "success", "timeout", "robot_collision", "unstable", "drop"]
    records = [dataclasses.replace(record, outcome=o, policy=str(i)) for i, o in enumerate(outcomes)]
    ordered = failures_first(records)
    assert [r.outcome for r in ordered] == [
        "robot_collision",
        "drop",
        "drop",
        "timeout",
        "unstable",
        "success",
        "success",
    ]
    assert [r.policy for r in ordered if r.outcome in ("drop", "success")] == ["1", "6", "0", "2"]


def test_play_films_the_first_failure(onnx_file, tmp_path, capsys):
    pytest.importorskip("imageio_ffmpeg")
    Scene("wall", obstacles=(WALL,)).save(tmp_path / "wall.json")
    Scene("near", goal=(0.04, 0.0)).save(tmp_path / "near.json")
    scenes = [str(tmp_path / f"{name}.json") for name in ("near", "wall")]
    out, film = tmp_path / "page.html", tmp_path / "film.mp4"
    options = ["--policy", str(onnx_file), "--rollouts", "1", "--out", str(out), "--video", str(film)]
    assert main(["play", *options, "--scenes", *scenes]) == 0
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert "1  wall" in first and "success" not in first and "2  near: success" in second
    assert film.stat().st_size > 10_000 and out.is_file() and out.with_suffix(".png").is_file()


@pytest.mark.parametrize("wrong", [["--video-of", "0"], ["--video-of", "3", "--video", "film.mp4"]])
def test_a_rollout_that_is_not_there(onnx_file, wrong, capfd):
    assert main(["play", "--policy", str(onnx_file), *wrong]) == 2
    assert "video_of" in capfd.readouterr().err
