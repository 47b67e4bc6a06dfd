"""The check of a robot: a sound simulated one passes, and each fault is the row that fails."""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from hotice.commands.deploy.check import table_of
from hotice.commands.deploy.check_config import RobotCheckConfig
from hotice.console import PlainConsole
from hotice.deploy.checkup import all_rows, joint_rows, watch_robot
from hotice.deploy.checkup.floor import lowest_sole
from hotice.deploy.simulated.move import Move
from hotice.errors import InvalidConfig, UnknownName
from hotice.model import builder
from hotice.model.source import MapSource
from tests.deploy.simulated_fixture import Lab

REPOSITORY = Path(__file__).parents[2]


def observed(lab, seconds=1.5):
    charge = lab.robot.states.battery
    return watch_robot(lab.link, lab.poses, lab.tags, lab.clock, seconds, lambda: float(charge()["soc"]))


@pytest.fixture(scope="module")
def sound():
    """A robot that holds itself, on the floor, object in its hands."""
    lab = Lab(start="standing")
    lab.live(0.5)
    return observed(lab)


def failed(rows):
    return [row.name for row in rows if row.passed is False]


def test_a_sound_robot_passes(sound):
    rows = all_rows(sound, stands=True)
    assert failed(rows) == []
    values = {row.name: row.value for row in rows}
    assert values["states a second"] in ("499", "500", "501") and values["longest gap between states"] == "2.0 ms"
    assert values["poses of localization a second"].startswith(("10.", "9.", "11."))
    assert abs(float(values["floor by the map against the soles"].split()[0])) < 0.5
    assert float(values["accelerometer at rest"].split()[0]) == pytest.approx(9.81, abs=0.1)
    assert [row.name for row in all_rows(sound) if row.passed is None] == [
        "tags seen",
        "floor by the map against the soles",
    ]


def test_the_table_says_what_failed(sound, capsys):
    wrong = sound.__class__(**{**vars(sound), "foreign_commands": 3, "charge": None})
    rows = all_rows(wrong, stands=True)
    assert failed(rows) == ["battery", "commands of somebody else"]
    PlainConsole(width=140).print(table_of(rows))
    said = capsys.readouterr().out
    assert said.count("FAIL") == 2


def changed(sound, field, value, index=slice(None)):
    """The same with one field of each state changed."""
    states = []
    for state in sound.states:
        state = state.copy()
        part = state
        for name in field[:-1]:
            part = part[name]
        part[field[-1]][index] = value if not callable(value) else value(part[field[-1]][index])
        states.append(state)
    return sound.__class__(**{**vars(sound), "states": tuple(states)})


@pytest.mark.parametrize(
    ("field", "value", "index", "names"),
    [
        (("imu_state", "accelerometer"), np.negative, slice(None), ["accelerometer against attitude (upwards)"]),
        (("imu_state", "accelerometer"), lambda a: 0.1 * a, slice(None), ["accelerometer at rest"]),
        (("imu_state", "gyroscope"), 0.2, 1, ["gyro at rest"]),
        (("motor_state", "motorstate"), 4, 3, ["motors' errors"]),
        (("motor_state", "temperature"), 120, (5, 1), ["warmest casing, winding"]),
        (("motor_state", "q"), 4.0, 3, ["joint beyond its range"]),
        (("mode_machine",), 3, (), ["machine"]),
        (("mode_pr",), 1, (), ["mode_pr"]),
    ],
)
def test_each_fault_has_its_row(sound, field, value, index, names):
    rows = all_rows(changed(sound, field, value, index), stands=True)
    assert set(names) <= set(failed(rows))
    assert len(failed(rows)) <= len(names) + 1


def test_an_error_that_comes_and_goes(sound):
    states = [state.copy() for state in sound.states]
    states[100]["motor_state"]["motorstate"][3] = 4
    states[200]["motor_state"]["motorstate"][3] = 1
    rows = all_rows(sound.__class__(**{**vars(sound), "states": tuple(states)}))
    assert [row.value for row in rows if row.name == "motors' errors"] == ["left_knee_joint 0x5"]


def test_a_map_that_leans_or_lies_elsewhere(sound):
    half = np.radians(3.0) / 2
    leaning = MapSource(
        file="m.pcd",
        sha256="0" * 64,
        unit_m=1.0,
        position_m=(0.0, 0.0, 0.0),
        quaternion_wxyz=(np.cos(half), np.sin(half), 0.0, 0.0),
    )
    assert "gravity by the map against the IMU" in failed(all_rows(sound, source=leaning))
    low = MapSource(
        file="m.pcd", sha256="0" * 64, unit_m=1.0, position_m=(0, 0, -0.05), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0)
    )
    assert failed(all_rows(sound, source=low, stands=True)) == ["floor by the map against the soles"]
    assert failed(all_rows(sound, source=low)) == []


def test_a_silent_network():
    lab = Lab(start="standing")
    lab.clock = type(lab.clock)()
    rows = all_rows(watch_robot(lab.link, lab.poses, lab.tags, lab.clock, 1.0))
    assert {"states a second", "gamepad", "battery", "poses of localization a second"} <= set(failed(rows))


@pytest.mark.parametrize("kept", [slice(30, None), slice(None, -30)])
def test_a_robot_that_is_silent_at_first_or_in_the_end(sound, kept):
    """For 60 ms: the rate alone does not tell."""
    some = sound.__class__(**{**vars(sound), "states": sound.states[kept], "state_s": sound.state_s[kept]})
    assert failed(all_rows(some, stands=True)) == ["longest gap between states"]


ORDER = ("left_knee_joint", "waist_yaw_joint")


def moved_in_turn(order, **config):
    """Rows of joints that are moved as they are asked for, and what was asked."""
    moves = tuple(f"{joint}@{1.3 + 3.5 * i:.1f}s" for i, joint in enumerate(order))
    lab, asked = Lab(start="held", move=moves, **config), []
    return joint_rows(lab.link, lab.clock, asked.append, order, 5.0), asked


def test_the_order_of_the_joints():
    rows, asked = moved_in_turn(ORDER, noise="trained")
    assert asked == list(ORDER) and [row.passed for row in rows] == [True] * 2
    for row, joint in zip(rows, ORDER, strict=True):
        name, by = row.value.split(" by ")
        assert name == joint and 0.35 < abs(float(by.split()[0])) < 0.65
    rows, _ = moved_in_turn(ORDER[:1], fault=("joints-swapped@0s",))
    assert failed(rows) == ["moved by hand: left_knee_joint"]
    assert rows[0].value.startswith("right_knee_joint by ")
    lab = Lab(start="standing")
    (row,) = joint_rows(lab.link, lab.clock, lambda joint: None, ORDER[:1], 1.0)
    assert row.value == "none moved" and row.passed is False
    with pytest.raises(UnknownName, match="left_knee"):
        RobotCheckConfig(joints=("left_knee",))
    with pytest.raises(UnknownName):
        Lab(move=("knee@1s",))
    with pytest.raises(InvalidConfig, match="leave the duration out"):
        Lab(move=("left_knee_joint@1s+5s",))
    assert len(RobotCheckConfig(joints=("all",)).asked) == 29 == len(Move.parse("all@1s"))


def test_the_lowest_sole_by_hand():
    """Straight legs: pelvis height of the description, less what its feet are below the ankles."""
    model = builder.build_model(joints=29, floor=False)
    data = mujoco.MjData(model)
    data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_kinematics(model, data)
    soles = [i for i in range(model.ngeom) if "_sole_" in model.geom(i).name]
    lowest = min(data.geom_xpos[i, 2] - model.geom_size[i, 0] for i in soles)
    assert lowest_sole(np.zeros(29), np.array([0.0, 0.0, 1.0])) == pytest.approx(lowest, abs=1e-9)
    assert -0.85 < lowest < -0.7
    upside_down = lowest_sole(np.zeros(29), np.array([0.0, 0.0, -1.0]))
    assert upside_down > 0.7


@pytest.mark.parametrize("values", [{"robot": "go2"}, {"robot": "g1"}, {"seconds": 0.5}, {"seconds": float("nan")}])
def test_what_is_refused(values):
    with pytest.raises(InvalidConfig):
        RobotCheckConfig(**values)


@pytest.mark.slow
def test_the_command_over_loopback(tmp_path):
    """A silent domain fails with status 2 and its rows' names."""
    pytest.importorskip("cyclonedds", reason="the link over DDS needs the extra `deploy`")
    done = subprocess.run(
        [sys.executable, "-m", "hotice", "robot-check", "--domain", "77", "--seconds", "1", "--pose-port", "47991"]
        + ["--tags-port", "47992"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 2 and "rows failed: states a second" in done.stderr
    assert "FAIL" in done.stdout
