import dataclasses
import resource
import sys

import numpy as np
import pytest

from hotice.commands.play import _filmed
from hotice.commands.program import main
from hotice.errors import InvalidConfig, OutputError
from hotice.evaluate.conditions import Conditions
from hotice.evaluate.record import failures_first, record_rollouts
from hotice.learn.policy import load_policy
from hotice.model import Box
from hotice.model.carry import solve_carry
from hotice.model.geometry.shapes import BoxShape
from hotice.model.scene import Obstacle, Scene
from hotice.replay import offscreen
from hotice.replay.offscreen import NoRenderer, find_renderer
from hotice.replay.video import FRAMES_PER_S, STILL_S, film_frames, find_encoder, write_video

SMALL_PX = (192, 108)
WALL = Obstacle("wall", "side", BoxShape((0.1, 0.6, 0.6)), (0.75, 0.0, 0.9))


@pytest.fixture(scope="module")
def record(onnx_file):
    """A short rollout that ends at a wall or before."""
    policy = load_policy(onnx_file, threads=1)
    states = [solve_carry(Box((0.3, 0.3, 0.3), 1.0))]
    (record,) = record_rollouts(policy, Scene("wall", obstacles=(WALL,)), states, Conditions(), seed=0, threads=1)
    return record.every(0.1)


@pytest.fixture
def films():
    """Skips where no film can be made, with the reason."""
    pytest.importorskip("imageio_ffmpeg")
    try:
        find_renderer()
    except NoRenderer as error:
        pytest.skip(str(error))


@pytest.fixture
def looked_for_anew():
    """What was found before is looked for again, here and by whoever comes next."""
    for search in (find_encoder, find_renderer):
        search.cache_clear()
    yield
    for search in (find_encoder, find_renderer):
        search.cache_clear()


def images_of(path):
    import imageio_ffmpeg

    frames = imageio_ffmpeg.read_frames(str(path))
    meta = next(frames)
    width, height = meta["size"]
    return meta, [np.frombuffer(f, dtype=np.uint8).reshape(height, width, 3) for f in frames]


def test_a_film_can_be_read_back(films, record, tmp_path):
    seen = []
    path = write_video(record, tmp_path / "film.mp4", lambda n, total: seen.append((n, total)), size_px=SMALL_PX)
    meta, images = images_of(path)
    assert meta["size"] == SMALL_PX and meta["fps"] == FRAMES_PER_S and meta["codec"] == "h264"
    assert len(images) == len(film_frames(record)) == len(seen) == seen[-1][1]
    assert images[0].std() > 5 and np.abs(images[0].astype(int) - images[-1]).max() > 50
    assert sorted(p.name for p in tmp_path.iterdir()) == ["film.mp4"]


def test_films_have_1080_lines_and_tell_the_outcome(films, record, tmp_path):
    path = write_video(record, tmp_path / "film.mp4", most_s=0.5 * STILL_S)
    meta, images = images_of(path)
    assert meta["size"] == (1920, 1080) and len(images) == round(0.5 * STILL_S * FRAMES_PER_S)
    words = images[-1][20:80, 1400:1900].astype(int)
    # red letters on the pale sky
    assert ((words[..., 0] - words[..., 1] > 60) & (words[..., 0] - words[..., 2] > 60)).sum() > 500


def test_frames_keep_the_rollouts_time(record):
    frames = film_frames(record)
    time = record.time_s - record.time_s[0]
    assert frames == sorted(frames) and frames[0] == 0 and frames[-1] == len(time) - 1
    assert len(frames) / FRAMES_PER_S == pytest.approx(time[-1] + STILL_S, abs=0.05)
    for n, frame in enumerate(frames):
        assert time[frame] <= n / FRAMES_PER_S + 1e-6
        assert frame == len(time) - 1 or time[frame + 1] > n / FRAMES_PER_S


def test_the_end_of_a_long_rollout_is_shown(record):
    frames = film_frames(record)
    assert film_frames(record, 0.4) == frames[-10:] and film_frames(record, 100.0) == frames


def test_what_cannot_be_written(films, record, tmp_path):
    with pytest.raises(InvalidConfig, match=".mp4"):
        write_video(record, tmp_path / "film.avi")
    with pytest.raises(OutputError, match="gone"):
        write_video(record, tmp_path / "gone" / "film.mp4", size_px=SMALL_PX)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_nothing_is_left_of_a_film_that_is_stopped(films, record, tmp_path, stop):
    (tmp_path / "film.mp4").write_text("the film before")

    def stops(n, total):
        if n == 3:
            raise stop

    with pytest.raises(stop):
        write_video(record, tmp_path / "film.mp4", stops, size_px=SMALL_PX)
    assert [p.name for p in tmp_path.iterdir()] == ["film.mp4"]
    assert (tmp_path / "film.mp4").read_text() == "the film before"


def test_a_full_disk_is_an_error(films, record, tmp_path):
    """A limit on files' size stands for it."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    find_encoder()
    resource.setrlimit(resource.RLIMIT_FSIZE, (512, before[1]))
    try:
        with pytest.raises(OutputError, match="is the disk full"):
            write_video(record, tmp_path / "film.mp4", most_s=0.4, size_px=SMALL_PX)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(tmp_path.iterdir())


def missing_encoder(monkeypatch, _):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)


def broken_encoder(monkeypatch, folder):
    broken = folder / "ffmpeg"
    broken.write_text("#!/bin/sh\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(broken))
    encoder = pytest.importorskip("imageio_ffmpeg")._utils
    monkeypatch.setattr(encoder, "get_ffmpeg_exe", encoder.get_ffmpeg_exe)


def missing_renderer(monkeypatch, _):
    pytest.importorskip("imageio_ffmpeg")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(offscreen, "CHOICES", {"egl": "mujoco.none"})


@pytest.mark.parametrize(
    ("lacks", "told"),
    [
        (missing_encoder, "a film needs imageio-ffmpeg: pip install 'hotice[video]'"),
        (broken_encoder, "IMAGEIO_FFMPEG_EXE"),
        (missing_renderer, "apt install libegl1"),
    ],
)
def test_what_a_film_needs_is_looked_for_before_any_work(lacks, told, looked_for_anew, monkeypatch, tmp_path, capfd):
    lacks(monkeypatch, tmp_path)

    def work(*args, **options):
        raise AssertionError("work was begun")

    for name in ("resolve_scenes", "load_policy", "record_rollouts"):
        monkeypatch.setattr(f"hotice.commands.play.{name}", work)
    assert main(["play", "--video", "film.mp4"]) == 2
    assert told in " ".join(capfd.readouterr().err.split())
    assert not list(tmp_path.glob("*.mp4"))


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


def test_play_films_a_success_if_there_is_one(films, onnx_file, tmp_path, capsys, monkeypatch):
    Scene("wall", obstacles=(WALL,)).save(tmp_path / "wall.json")
    Scene("near", goal=(0.04, 0.0)).save(tmp_path / "near.json")
    filmed = []

    def write(record, path, on_frame, *, most_s):
        filmed.append(record.scene.name)
        return write_video(record, path, on_frame, most_s=most_s, size_px=SMALL_PX)

    monkeypatch.setattr("hotice.commands.play.write_video", write)
    scenes = [str(tmp_path / f"{name}.json") for name in ("near", "wall")]
    out, film = tmp_path / "page.html", tmp_path / "film.mp4"
    options = ["--policy", str(onnx_file), "--rollouts", "1", "--out", str(out), "--video", str(film)]
    assert main(["play", *options, "--scenes", *scenes]) == 0
    first, second, *_, last = capsys.readouterr().out.splitlines()
    assert "1  wall" in first and "success" not in first and "2  near: success" in second
    assert filmed == ["near"] and last == str(film)
    assert film.stat().st_size > 2_000 and out.is_file() and out.with_suffix(".png").is_file()


def test_which_rollout_is_filmed(record):
    drop, good = (dataclasses.replace(record, outcome=outcome) for outcome in ("drop", "success"))
    assert _filmed([drop, good], 0) is good and _filmed([drop, drop], 0) is drop
    assert _filmed([drop, good], 1) is drop and _filmed([drop, good], 2) is good


@pytest.mark.parametrize("wrong", [["--video-of", "1"], ["--video-s", "9"], ["--video-of", "3", "--video", "film.mp4"]])
def test_a_rollout_that_is_not_there(films, onnx_file, wrong, capfd):
    assert main(["play", "--policy", str(onnx_file), *wrong]) == 2
    assert wrong[0].removeprefix("--").replace("-", "_") in capfd.readouterr().err
