from dataclasses import fields, replace

import mujoco
import numpy as np
import pytest

from hotice.errors import HoticeError, OutputError
from hotice.model import Box
from hotice.replay import InvalidRollout, RolloutEvent, RolloutRecord


def test_places_what_is_visible_and_moves(record, toy):
    assert record.geom_names == ["trunk", "head", "left_leg", "right_leg", "object"]
    assert record.geom_types == ["box", "ellipsoid", "capsule", "cylinder", "box"]
    assert record.geom_is_object.tolist() == [False] * 4 + [True]
    np.testing.assert_allclose(record.root_pos_W[:, 0], np.linspace(0, 2, 101), atol=1e-12)
    np.testing.assert_allclose(record.object_pos_W[-1], [2.4, 0.0, 0.9], atol=1e-12)
    assert record.distance_m == pytest.approx(0.0, abs=1e-12)


def test_poses_agree_with_mujoco(record, toy):
    data = mujoco.MjData(toy)
    data.qpos[:] = toy.qpos0
    data.qpos[0], data.qpos[9] = 2.0, 2.4
    data.qpos[7] = 0.5 * np.sin(12)
    data.qpos[8] = -data.qpos[7]
    mujoco.mj_forward(toy, data)
    for g, name in enumerate(record.geom_names):
        np.testing.assert_allclose(record.geom_pos_W[-1, g], data.geom(name).xpos, atol=1e-12)
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, record.geom_quat_W[-1, g])
        np.testing.assert_allclose(matrix, data.geom(name).xmat, atol=1e-9)


def test_shows_the_robot_and_object_of_the_shipped_model(scene):
    from hotice.model.builder import build_model

    model = build_model(Box((0.3, 0.3, 0.3), 2.0))
    record = RolloutRecord.from_states(
        model,
        model.qpos0[None],
        scene=scene,
        carried=Box((0.3, 0.3, 0.3), 2.0),
        time_s=[0.0],
        outcome="fall",
        policy="none",
    )
    assert record.geom_is_object.sum() == 1
    assert {"left_knee_link_0", "right_knee_link_0", "object"} <= set(record.geom_names)
    assert not any("floor" in name for name in record.geom_names)


def test_round_trip(record, tmp_path):
    path = record.save(tmp_path / "rollout.npz")
    back = RolloutRecord.load(path)
    for item in fields(RolloutRecord):
        ours, theirs = getattr(record, item.name), getattr(back, item.name)
        if isinstance(ours, np.ndarray):
            np.testing.assert_allclose(theirs, ours, atol=1e-6, err_msg=item.name)
        elif item.name != "scene":
            assert theirs == ours, item.name
    assert back.scene.to_dict() == record.scene.to_dict()
    assert [p.name for p in tmp_path.iterdir()] == ["rollout.npz"]
    np.testing.assert_allclose(back.scene.obstacles[-1].shape.mesh().vertices.max(axis=0), [0.3, 0.3, 0.4])


def test_events_come_back(record, tmp_path):
    events = (
        RolloutEvent(time_s=-0.5, kind="mode", text="posture"),
        RolloutEvent(time_s=1.25, kind="fault", text="box not seen"),
    )
    told = replace(record, events=events)
    assert RolloutRecord.load(told.save(tmp_path / "told.npz")).events == events
    assert told.every(0.07).events == events
    assert b'"events"' not in np.load(record.save(tmp_path / "none.npz"))["json"].tobytes()
    with pytest.raises(InvalidRollout, match="order of time"):
        replace(record, events=events[::-1])
    for wrong in ({"time_s": np.nan}, {"text": 401 * "x"}, {"kind": "party"}):
        with pytest.raises(HoticeError, match="event"):
            replace(events[0], **wrong)


def test_thinning_keeps_first_and_last_frame(record):
    thin = record.every(0.07)
    assert thin.time_s[0] == record.time_s[0] and thin.time_s[-1] == record.time_s[-1]
    assert np.diff(thin.time_s[:-1]).min() >= 0.07 * 0.99
    assert len(record.every(0.02).time_s) == len(record.time_s)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outcome": "won"}, "unknown 'won': known are running"),
        ({"time_s": np.zeros(101)}, "must grow"),
        ({"geom_types": ["mesh"] * 5}, "unknown 'mesh'"),
        ({"geom_sizes": np.full((5, 3), np.nan)}, "not finite"),
        ({"root_pos_W": np.zeros((3, 3))}, "root_pos_W has shape"),
    ],
)
def test_impossible_records_are_refused(record, change, message):
    with pytest.raises(InvalidRollout, match=message):
        replace(record, **change)


def test_states_of_another_model_are_refused(toy, scene):
    kwargs = dict(scene=scene, carried=Box((0.3, 0.3, 0.2), 1.5), time_s=[0.0], outcome="fall", policy="x")
    with pytest.raises(InvalidRollout, match="qpos has shape"):
        RolloutRecord.from_states(toy, np.zeros((1, 5)), **kwargs)
    with pytest.raises(InvalidRollout, match="no body 'torso': known are"):
        RolloutRecord.from_states(toy, toy.qpos0[None], root_body="torso", **kwargs)


def test_arrows_may_be_left_out(toy, scene):
    record = RolloutRecord.from_states(
        toy, toy.qpos0[None], scene=scene, carried=Box((0.3, 0.3, 0.2), 1.5), time_s=[0.0], outcome="drop", policy="x"
    )
    assert record.arrow_pos_W.shape == (1, 0, 3)


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 truncated"])
def test_broken_files_are_refused(tmp_path, content):
    path = tmp_path / "broken.npz"
    path.write_bytes(content)
    with pytest.raises(InvalidRollout, match="broken.npz"):
        RolloutRecord.load(path)


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(InvalidRollout, match="no such file"):
        RolloutRecord.load(tmp_path / "none.npz")


def test_meshes_cannot_leave_the_record(record, tmp_path):
    path = record.save(tmp_path / "rollout.npz")
    with np.load(path) as archive:
        arrays = dict(archive)
    text = arrays["json"].tobytes().replace(b'"wedge.obj"', b'"../../w.obj"')
    np.savez(path, **arrays | {"json": np.frombuffer(text, dtype=np.uint8)})
    with pytest.raises(InvalidRollout, match="outside the record"):
        RolloutRecord.load(path)


def test_unwritable_path_is_one_line(record, tmp_path):
    for path in (tmp_path / "missing" / "rollout.npz", tmp_path):
        with pytest.raises(OutputError, match="^cannot write .*$") as caught:
            record.save(path)
        assert isinstance(caught.value, HoticeError) and "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
