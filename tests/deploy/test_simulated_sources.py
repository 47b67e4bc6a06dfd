"""Localization, tags and mishaps of the simulated robot."""

from dataclasses import replace

import numpy as np
import pytest

from hotice.deploy.camera import HEAD_CAMERA
from hotice.deploy.frames import WAIST, Pose, camera_in_pelvis, lidar_in_pelvis
from hotice.deploy.messages.hg import JOINTS
from hotice.deploy.simulated import SimulatedRobotConfig
from hotice.deploy.sources import MemorySource, TagSample
from hotice.deploy.tags import box_bundle
from hotice.errors import InvalidConfig, UnknownName
from hotice.model import BoxShape
from hotice.model.frames import quat_from_axis_angle, quat_to_mat, yaw_from_quat
from hotice.model.scene import Obstacle
from hotice.model.shipped import load_scene
from hotice.model.source import MapSource
from tests.deploy.simulated_fixture import STEP_S, Lab

SOURCE = MapSource(
    file="map.pcd",
    sha256="0" * 64,
    unit_m=0.5,
    position_m=(1.0, 2.0, 1.2),
    quaternion_wxyz=tuple(quat_from_axis_angle([1.0, 0.1, 0.2], 3.0).tolist()),
)


def pelvis_of(lab, sample, source=None):
    """Pelvis in the scene as an estimator finds it, with the measured waist."""
    p, quat = sample.p_ML, sample.quat_ML
    if source is not None:
        p, quat = source.pose_to_scene(p, quat)
    waist = lab.state()["motor_state"]["q"][JOINTS][list(WAIST)]
    return Pose.of(p, quat) @ lidar_in_pelvis(waist).inverse


def test_localization_without_noise_leads_to_the_pelvis():
    scene = replace(load_scene("open_floor"), source=SOURCE)
    lab = Lab(scene=scene)
    lab.live(0.21)
    found = pelvis_of(lab, lab.poses.newest().sample, SOURCE)
    qpos = lab.world.data.qpos
    # 9 ms ago, steadied
    assert found.p == pytest.approx(qpos[:3], abs=1e-3)
    assert found.R == pytest.approx(quat_to_mat(qpos[3:7]), abs=2e-3)


def test_localization_has_the_trained_rate_and_noise():
    lab, rows = Lab(noise="trained"), []
    for k in range(500):
        lab.robot.localization.live(0.1 * k)
        sample = lab.poses.newest().sample
        found = Pose.of(sample.p_ML, sample.quat_ML) @ lidar_in_pelvis(np.zeros(3)).inverse
        rows.append([*(found.p - lab.world.data.qpos[:3]), yaw_from_quat(found.quat)])
    assert lab.poses.counts().taken == 500
    lab.robot.localization.live(0.1 * 499 + 0.098)
    assert lab.poses.counts().taken == 500
    rows = np.array(rows)
    assert np.abs(rows.mean(axis=0)).max() < 0.003
    for values, half in ((rows[:, :3].ravel(), 0.02), (rows[:, 3], 0.03)):
        assert values.std() == pytest.approx(half / np.sqrt(3.0), rel=0.05)
        assert np.abs(values).max() <= half * (1 + 1e-9)


def test_localization_drifts_in_one_direction():
    still, drifting = Lab(), Lab(drift_m_s=0.05)
    for lab in (still, drifting):
        lab.live(2.01)
    apart = drifting.poses.newest().sample.p_ML - still.poses.newest().sample.p_ML
    assert np.linalg.norm(apart) == pytest.approx(0.1, abs=1e-6)
    assert apart[2] == pytest.approx(0.0)


def test_samples_come_late_by_the_drawn_delay():
    from hotice.task.sensing import STUDENT_SENSING, draw_delays

    seed = next(s for s in range(9) if draw_delays(STUDENT_SENSING, 0.02, 10, s)[0])
    lab = Lab(delays="trained", seed=seed)
    lab.live(0.018)
    assert lab.poses.newest() is None
    lab.live(0.006)
    sample = lab.poses.newest().sample
    assert sample.measured_s == pytest.approx(STEP_S)
    assert lab.tags.newest() is None
    lab.live(0.014)
    assert lab.tags.newest().sample.measured_s == pytest.approx(STEP_S)


def test_the_camera_sees_the_tags_on_top_of_the_carried_box():
    lab = Lab()
    lab.live(0.002)
    sample = lab.tags.newest().sample
    assert sample.ids.tolist() == [0, 1, 2, 3]
    bundle, qpos = box_bundle(lab.config.carried), lab.world.data.qpos
    X_WC = Pose.of(qpos[:3], qpos[3:7]) @ camera_in_pelvis(lab.world.joint_pos[list(WAIST)])
    X_WO = Pose.of(qpos[-7:-4], qpos[-4:])
    wished = HEAD_CAMERA.pixels((X_WC.inverse @ X_WO).points(bundle.corners_O[:4]))
    assert sample.corners_px == pytest.approx(wished, abs=1e-6)
    # ahead is up in the picture, left is left
    middle = sample.corners_px.mean(axis=1)
    assert middle[0, 1] < middle[2, 1] and middle[0, 0] < middle[1, 0]


def test_tags_have_the_rate_and_the_pixel_noise():
    exact, noisy, off = Lab(), Lab(noise="trained"), []
    for k in range(200):
        for lab in (exact, noisy):
            lab.robot.sight.live(k / 30)
        off.append(noisy.tags.newest().sample.corners_px - exact.tags.newest().sample.corners_px)
    assert noisy.tags.counts().taken == 200
    noisy.robot.sight.live(199 / 30 + 0.033)
    assert noisy.tags.counts().taken == 200
    assert np.std(off) == pytest.approx(0.3, rel=0.1)


def test_what_is_in_the_way_hides_tags():
    scene = load_scene("open_floor")
    x, y, _ = scene.start
    plate = Obstacle(
        name="plate", shape=BoxShape((0.02, 0.4, 0.02)), category="overhead", position_m=(x + 0.17, y, 1.06)
    )
    hidden, seen = Lab(scene=replace(scene, obstacles=(plate,))), Lab(scene=scene)
    for lab in (hidden, seen):
        lab.live(0.002)
    assert len(hidden.tags.newest().sample.ids) < len(seen.tags.newest().sample.ids) == 4


def test_mishaps_of_sources():
    lab = Lab(fault=("tag-loss@0.2s+0.2s", "tag-foreign@0.5s", "pose-loss@0.3s+0.3s", "pose-jump@0.7s", "pose-nan@1s"))
    lab.live(0.3)
    assert not len(lab.tags.newest().sample.ids)
    lab.live(0.18)
    assert lab.tags.newest().sample.ids.tolist() == [0, 1, 2, 3]
    lab.live(0.1)
    assert lab.tags.newest().sample.ids.tolist() == [400, 401, 402, 403]
    assert lab.poses.newest().age_s > 0.28
    before = lab.poses.newest().sample.p_ML
    lab.live(0.25)
    assert lab.poses.newest().age_s < 0.1
    assert lab.poses.newest().sample.p_ML - before == pytest.approx([0.2, 0.0, 0.0], abs=5e-3)
    lab.live(0.4)
    assert lab.poses.counts().refused["number"] == pytest.approx(2, abs=1)


def test_mishaps_of_states():
    lab = Lab(
        fault=(
            "tick-frozen@0.1s+0.1s",
            "state-bad-crc@0.3s+0.1s",
            "state-nan@0.5s+0.1s",
            "state-silent@0.7s+0.1s",
            "state-late@0.9s+0.1s",
        )
    )

    def after(seconds):
        taken = lab.link.counts()
        lab.live(seconds)
        received = lab.link.state()
        return received.age_s, lab.link.counts(), taken

    assert after(0.098)[0] == pytest.approx(0.0, abs=1e-9)
    age_s, now, _ = after(0.1)
    assert age_s > 0.09 and now.repeats >= 48
    after(0.1)
    age_s, now, _ = after(0.1)
    assert age_s > 0.09 and now.refused == {"crc": pytest.approx(50, abs=1)}
    after(0.1)
    age_s, now, _ = after(0.1)
    assert age_s > 0.09 and now.refused["number"] == pytest.approx(50, abs=1)
    after(0.1)
    age_s, now, before = after(0.1)
    assert age_s > 0.09 and now.taken <= before.taken + 2
    after(0.1)
    before = lab.link.counts().taken
    assert after(0.05)[0] > 0.045


def test_mishaps_of_the_body():
    lab = Lab(fault=("push@0.1s", "motor-hot@0.1s", "motor-error@0.1s", "encoder-jump@0.1s", "battery-low@0.1s"))
    lab.live(0.098)
    before = lab.state()["motor_state"]["q"][3]
    assert np.linalg.norm(lab.world.data.qvel[:2]) < 0.05
    lab.live(2 * STEP_S)
    motors = lab.state()["motor_state"]
    assert motors["temperature"][0, 1] >= 150 and motors["motorstate"][3] == 0x400
    assert motors["q"][3] - before == pytest.approx(1.0, abs=0.05)
    assert lab.robot.states.battery()["soc"] == 5
    assert np.linalg.norm(lab.world.data.qvel[:2]) == pytest.approx(1.0, abs=0.4)


def test_a_second_publisher_is_heard_by_both():
    lab = Lab(start="held", fault=("second-publisher@0.1s",))
    lab.live(0.1)
    assert lab.link.counts().foreign_commands == 0
    lab.live(0.1)
    assert lab.link.counts().foreign_commands == pytest.approx(50, abs=1)
    assert lab.robot.told.kd[0] == 8.0


@pytest.mark.parametrize(
    "text", ["tag-loss", "tag-loss@3", "tag-loss@s", "@3s", "tag-loss@-1s", "tag-loss@3s+", "a b@3s"]
)
def test_a_fault_that_cannot_be_read(text):
    with pytest.raises(InvalidConfig, match="tag-loss@3s"):
        SimulatedRobotConfig(fault=(text,))


@pytest.mark.parametrize("name", ["push", "battery-low"])
def test_a_fault_of_an_instant_has_no_duration(name):
    assert SimulatedRobotConfig(fault=(f"{name}@1s",)).mishaps[0].name == name
    with pytest.raises(InvalidConfig, match="happens once"):
        SimulatedRobotConfig(fault=(f"{name}@1s+0.5s",))


def test_names_that_do_not_exist():
    with pytest.raises(UnknownName, match="tick-frozen"):
        SimulatedRobotConfig(fault=("earthquake@3s",))
    with pytest.raises(UnknownName, match="start"):
        SimulatedRobotConfig(press=("L2+Q@3s",))


def test_help_names_every_mishap():
    from pathlib import Path

    import hotice.deploy.simulated.config as config
    from hotice.deploy.simulated.mishaps import MISHAPS

    text = Path(config.__file__).read_text(encoding="utf-8")
    assert not [name for name in MISHAPS if name not in text]


def test_a_source_is_an_inbox_of_its_own():
    lab = Lab()
    other = MemorySource(lab.clock, TagSample.decode)
    assert other.newest() is None
