"""The process that reads tags: its loop, the box that is solved from what it sends, the program."""

import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("cv2", reason="tags are found with OpenCV: the extra `deploy`")

import cv2

from hotice.commands.program import main
from hotice.deploy.camera import HEAD_CAMERA, Camera
from hotice.deploy.clock import SimulatedClock
from hotice.deploy.frames import WAIST, camera_in_pelvis
from hotice.deploy.guard.faults import Reaction, box_unseen
from hotice.deploy.guard.limits import GuardLimits
from hotice.deploy.link.protocol import LinkError
from hotice.deploy.messages.hg import LOW_STATE
from hotice.deploy.sources import MemorySource, TagSample, UdpSource
from hotice.deploy.tags import (
    BoxPoser,
    BrokenFrame,
    FolderCamera,
    Frame,
    RealSenseCamera,
    TagBox,
    TagDetector,
    box_bundle,
    watch_tags,
)
from hotice.deploy.tags import watch as watch_module
from hotice.deploy.tags.cameras import as_head_camera
from hotice.deploy.tags.rendering import mirrored
from hotice.errors import InputError, MissingExtra, NotAvailable
from hotice.model.frames import quat_from_axis_angle
from tests.deploy.tags_fixture import BOX, CARRY, Pose, angle_deg, near_pose, take

BUNDLE = box_bundle(BOX)
DETECTOR = TagDetector(BUNDLE.ids)
X_PO = Pose(np.eye(3), np.array(CARRY))


class Film:
    """Frames of a list, 30 a second; an error in it is raised."""

    camera, coefficients = HEAD_CAMERA, ()

    def __init__(self, clock, frames) -> None:
        self._clock, self._frames = clock, iter(frames)

    def frame(self):
        self._clock.sleep(1 / 30)
        each = next(self._frames, None)
        if isinstance(each, Exception):
            raise each
        return None if each is None else Frame(each, self._clock.now() - 0.02)

    def close(self) -> None: ...


def upright() -> np.ndarray:
    state = LOW_STATE.zeros()
    state["imu_state"]["quaternion"] = (1.0, 0.0, 0.0, 0.0)
    return state


class Tracked:
    """Tags of a box on a clock; each sample is solved as it comes."""

    def __init__(self) -> None:
        self.clock = SimulatedClock()
        self.source = MemorySource(self.clock, TagSample.decode)
        self.box = TagBox(self.source, BoxPoser(BUNDLE))
        self.verdicts = []

    def watch(self, frames):
        return watch_tags(Film(self.clock, frames), DETECTOR, self, self.clock)

    def send(self, data: bytes) -> None:
        self.source.send(data)
        sighting = self.box.update(upright(), self.clock.now())
        self.verdicts.append(sighting and sighting.verdict)

    def reaction(self) -> Reaction:
        """The guard's, to the age of the box."""
        return box_unseen(self.box.age_s(self.clock.now()), GuardLimits())


def test_corners_arrive_with_the_time_of_exposure(rng):
    track = Tracked()
    watched = track.watch([take(X_PO, rng)])
    sample = track.source.newest().sample
    assert sample.ids.tolist() == [0, 1, 2, 3] and sample.measured_s == pytest.approx(1 / 30 - 0.02)
    assert (watched.pictures, watched.with_tags, watched.tags, watched.broken, watched.unsent) == (1, 1, 4, 0, 0)
    assert list(watched.age_s) == pytest.approx([0.02])


def test_single_broken_pictures_are_survived(rng):
    track, good = Tracked(), take(X_PO, rng)
    broken = [BrokenFrame("torn")] * (watch_module.MOST_BROKEN - 1)
    watched = track.watch([good, *broken, good, *broken, good])
    assert watched.pictures == 3 and watched.broken == len(broken) * 2 and watched.last_break == "torn"
    assert track.source.counts().taken == 3
    with pytest.raises(BrokenFrame, match=f"{watch_module.MOST_BROKEN} pictures in a row"):
        track.watch([good, *broken, BrokenFrame("gone"), good])


def test_it_ends_when_it_is_stopped(rng):
    track, good = Tracked(), take(X_PO, rng)
    film = Film(track.clock, [good] * 9)
    watched = watch_tags(film, DETECTOR, track, track.clock, stopped=lambda: len(track.verdicts) == 4)
    assert watched.pictures == 4 and watched.rate_hz == pytest.approx(30.0)


def test_a_network_that_is_down_is_survived(rng):
    class Down:
        def send(self, data):
            raise LinkError("network is unreachable")

    clock = SimulatedClock()
    assert watch_tags(Film(clock, [take(X_PO, rng)] * 2), DETECTOR, Down(), clock).unsent == 2


@pytest.mark.parametrize("lost_s, reaction", [(0.3, Reaction.NONE), (1.0, Reaction.NONE), (3.0, Reaction.HOLD)])
def test_tags_that_are_lost(lost_s, reaction, rng):
    """The box stays where it was; after 2 s without it the robot stands; seen again, it goes on."""
    track, good, empty = Tracked(), take(X_PO, rng), np.full((480, 640), 110, np.uint8)
    lost = round(30 * lost_s)

    def film():
        yield good
        assert track.verdicts == ["ok"] and track.box.update(upright(), track.clock.now()) is None
        before = track.box.seen
        yield from [empty] * lost
        assert track.box.seen is before and track.box.newest.X_PO is None
        assert track.box.age_s(track.clock.now()) == pytest.approx(lost_s, abs=0.04)
        assert track.reaction() is reaction
        yield good

    track.watch(film())
    assert track.verdicts == ["ok", *["none seen"] * lost, "ok"] and track.reaction() is Reaction.NONE
    assert track.box.verdicts == {"none seen": lost, "ok": 2}


def test_pictures_that_say_nothing_of_the_box_are_losses(rng):
    """A mirrored print, a box that lies on its side, foreign tags, nothing at all."""
    track = Tracked()
    side = Pose(
        Pose.of(np.zeros(3), quat_from_axis_angle([0.0, 1.0, 0.0], np.radians(-80.0))).R, np.array([0.6, 0.0, 0.05])
    )
    track.watch([take(X_PO, rng, printing=mirrored), take(side, rng)])
    foreign = TagSample(number=9, measured_s=0.0, ids=np.array([400, 401]), corners_px=np.ones((2, 4, 2)))
    track.send(foreign.encode())
    assert track.verdicts == ["none seen", "against the prior", "none seen"]
    assert track.box.seen is None and track.box.age_s(1.0) == np.inf


def test_the_box_is_solved_with_the_waist_and_the_attitude_of_the_state(rng):
    track, state = Tracked(), upright()
    waist = np.array([0.2, -0.05, 0.1])
    state["motor_state"]["q"][list(WAIST)] = waist
    state["imu_state"]["quaternion"] = quat_from_axis_angle([0.0, 1.0, 0.0], 0.2)
    placed = near_pose(rng)
    corners = HEAD_CAMERA.pixels((camera_in_pelvis(waist).inverse @ placed).points(BUNDLE.corners_O[:4]))
    track.source.send(TagSample(number=0, measured_s=0.0, ids=np.arange(4), corners_px=corners).encode())
    seen = track.box.update(state, track.clock.now())
    assert seen.X_PO.p == pytest.approx(placed.p, abs=1e-4) and angle_deg(seen.X_PO.R, placed.R) < 0.05
    # a pelvis that lies on its face cannot carry the box so
    state["imu_state"]["quaternion"] = quat_from_axis_angle([0.0, 1.0, 0.0], 1.4)
    track.source.send(TagSample(number=1, measured_s=0.0, ids=np.arange(4), corners_px=corners).encode())
    assert track.box.update(state, track.clock.now()).verdict == "against the prior"


def test_corners_of_another_camera_become_those_of_the_head_camera(rng):
    other = Camera(fx=910.0, fy=912.0, cx=650.0, cy=350.0, width=1280, height=720)
    p_C = np.column_stack([rng.uniform(-0.3, 0.3, (5, 2)), np.ones(5)])
    assert as_head_camera(other.pixels(p_C), other) == pytest.approx(HEAD_CAMERA.pixels(p_C))
    # librealsense's polynomial, by hand for one radial and one tangential number
    pixel = np.array([[650.0 + 91.0, 350.0]])
    ray = as_head_camera(pixel, other, (0.5, 0.0, 0.0, 0.2, 0.0))[0]
    x = 0.1 * (1.0 + 0.5 * 0.01) + 0.2 * 3.0 * 0.01
    assert ray == pytest.approx([319.5 + 607.0 * x, 239.5])


def test_pictures_of_a_folder(tmp_path, rng):
    for name, picture in (("b.png", take(X_PO, rng)), ("a.png", np.zeros((480, 640), np.uint8))):
        assert cv2.imwrite(str(tmp_path / name), picture)
    (tmp_path / "c.png").write_bytes(b"no picture")
    assert cv2.imwrite(str(tmp_path / "d.png"), np.zeros((4, 6), np.uint8))
    (tmp_path / "notes.txt").write_text("x")
    clock = SimulatedClock(5.0)
    camera = FolderCamera(tmp_path, clock, rate_hz=10.0)
    first, second = camera.frame(), camera.frame()
    assert first.picture.max() == 0 and DETECTOR.detect(second.picture).ids.tolist() == [0, 1, 2, 3]
    assert (first.taken_s, second.taken_s, clock.now()) == pytest.approx((5.0, 5.1, 5.1))
    with pytest.raises(BrokenFrame, match=r"c\.png: cannot be read"):
        camera.frame()
    with pytest.raises(BrokenFrame, match=r"is 6 × 4; a picture of 640 × 480"):
        camera.frame()
    assert camera.frame() is None
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="no picture"):
        FolderCamera(tmp_path / "none", clock)
    with pytest.raises(InputError, match="no folder"):
        FolderCamera(tmp_path / "notes.txt", clock)


def test_a_realsense_needs_its_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingExtra, match=r"pip install 'hotice\[realsense\]'"):
        RealSenseCamera()


class ToyRealSense:
    """As much of pyrealsense2 as is used, after its documentation; no camera was at hand."""

    stream, format = SimpleNamespace(color="color"), SimpleNamespace(bgr8="bgr8")
    timestamp_domain = SimpleNamespace(global_time="global", system_time="system", hardware_clock="hardware")
    distortion = SimpleNamespace(inverse_brown_conrady="inverse", brown_conrady="brown")

    def __init__(self, lens, color) -> None:
        self.lens, self.color = lens, color
        self.stopped = False

    def config(self):
        return SimpleNamespace(enable_stream=lambda *options: None)

    def pipeline(self):
        def wait(timeout_ms):
            if self.color is None:
                raise RuntimeError("Frame didn't arrive within 500")
            return SimpleNamespace(get_color_frame=lambda: self.color)

        def start(config):
            if self.lens is None:
                raise RuntimeError("No device connected")
            profile = SimpleNamespace(get_intrinsics=lambda: self.lens)
            return SimpleNamespace(get_stream=lambda stream: SimpleNamespace(as_video_stream_profile=lambda: profile))

        return SimpleNamespace(start=start, wait_for_frames=wait, stop=lambda: setattr(self, "stopped", True))


def lens(**other):
    given = {"fx": 606.0, "fy": 606.5, "ppx": 318.0, "ppy": 241.0, "width": 640, "height": 480}
    return SimpleNamespace(**{**given, "model": "inverse", "coeffs": [0.0] * 5, **other})


def color_frame(age_s: float, domain: str):
    return SimpleNamespace(
        get_data=lambda: np.full((480, 640, 3), 77, np.uint8),
        get_timestamp=lambda: 1e3 * (time.time() - age_s),
        get_frame_timestamp_domain=lambda: domain,
    )


def test_a_toy_of_a_realsense(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", ToyRealSense(lens(), color_frame(0.05, "global")))
    camera = RealSenseCamera()
    assert camera.camera == Camera(fx=606.0, fy=606.5, cx=318.0, cy=241.0, width=640, height=480)
    before_s, (picture, taken_s), after_s = time.monotonic(), camera.frame(), time.monotonic()
    assert picture.shape == (480, 640) and (picture == 77).all()
    assert before_s - 0.06 < taken_s < after_s - 0.04
    # the camera's own clock is not ours
    monkeypatch.setitem(sys.modules, "pyrealsense2", ToyRealSense(lens(), color_frame(0.05, "hardware")))
    assert RealSenseCamera().frame().taken_s >= after_s


def test_what_a_realsense_may_lack(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", ToyRealSense(None, None))
    with pytest.raises(NotAvailable, match="is it plugged in"):
        RealSenseCamera()
    monkeypatch.setitem(sys.modules, "pyrealsense2", ToyRealSense(lens(), None))
    with pytest.raises(BrokenFrame, match="no picture within 500 ms"):
        RealSenseCamera().frame()
    other = ToyRealSense(lens(model="brown", coeffs=[0.1, 0.0, 0.0, 0.0, 0.0]), None)
    monkeypatch.setitem(sys.modules, "pyrealsense2", other)
    with pytest.raises(NotAvailable, match="inverse Brown-Conrady"):
        RealSenseCamera()
    assert other.stopped


def test_the_program(tmp_path, rng, capsys):
    """Its datagrams wait in the reader's socket."""
    for k in range(3):
        assert cv2.imwrite(str(tmp_path / f"{k}.png"), take(X_PO, rng))
    (tmp_path / "1b.png").write_bytes(b"torn")
    source = UdpSource(0, TagSample.decode)
    assert main(["tag-camera", "--camera", str(tmp_path), "--port", str(source.port)]) == 0
    shown = capsys.readouterr().out
    assert "12 tags" in shown and "100.0 %" in shown and "1 broken" in shown
    received = source.newest()
    source.close()
    assert received is not None and received.number == 3 and received.sample.ids.tolist() == [0, 1, 2, 3]
    assert main(["tag-camera", "--camera", str(tmp_path), "--host", "no host"]) == 2
    assert "cannot send to no host:" in capsys.readouterr().err
    assert main(["tag-camera", "--camera", str(tmp_path / "nowhere")]) == 2
    assert "no folder" in capsys.readouterr().err


def test_sheets_from_the_command_line(tmp_path, capsys):
    out = tmp_path / "tags.pdf"
    assert main(["tags", "--box", "0.3", "0.3", "0.25", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF") and str(out) in capsys.readouterr().out
    assert main(["tags", "--box", "0.3", "0.1", "0.25", "--out", str(out)]) == 2
    assert "at least 0.14 m" in capsys.readouterr().err
    assert main(["tags", "--box", "0.3", "0.3", "0.25", "--out", str(tmp_path / "tags.png")]) == 2
    assert ".pdf" in capsys.readouterr().err
