import subprocess
import sys

import numpy as np
import pytest
from pydrake.multibody.plant import CalcContactFrictionFromSurfaceProperties
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from hotice.errors import (
    CheckpointError,
    InvalidConfig,
    InvalidScene,
    InvalidStation,
    NotAvailable,
    OutputError,
    UnknownName,
)
from hotice.model import BoxShape, Obstacle, Scene
from hotice.model.builder import FLOOR, robot_spec
from hotice.model.self_contact import pairs
from hotice.replay import RolloutRecord
from hotice.systems import StationConfig, make_station, read_logs, write_diagram, write_station_page
from hotice.systems.compose import build, connect
from hotice.systems.joint_pd import JointPd
from hotice.systems.record.picture import wires
from hotice.systems.record.rollout import judge, to_record
from hotice.systems.safety_monitor import FAULTS, SafePosture, SafetyLimits, SafetyMonitor
from hotice.systems.signals import CONTACT_FORCE, GUIDANCE, PERCEPT, ROBOT_STATE
from hotice.systems.visualizer import Visualizer, open_meshcat


@pytest.fixture(scope="module")
def rollout(station):
    """Three seconds under the beam."""
    simulator = Simulator(station)
    simulator.AdvanceTo(3.0)
    return simulator


def trace(station, seconds):
    """Robot states at 50 Hz, (T, 84)."""
    simulator = Simulator(station)
    adaptor = station.GetSubsystemByName("state_adaptor")
    port, context = adaptor.GetOutputPort("robot_state"), adaptor.GetMyContextFromRoot(simulator.get_context())
    states = []
    for k in range(round(50 * seconds) + 1):
        simulator.AdvanceTo(0.02 * k)
        states.append(port.Eval(context).copy())
    return np.array(states)


def test_it_carries(station, rollout):
    logs = read_logs(station, rollout.get_context())
    state = logs["state_adaptor.robot_state"]
    assert state.value.shape == (151, ROBOT_STATE) and np.allclose(np.diff(state.time_s), 0.02)
    assert state.value[-1, 0] > 1.2 and state.value[-1, 38] > 0.6
    assert not logs["safety_monitor.faults"].value.any()
    assert logs["sensor_model.percept"].value.shape[1] == PERCEPT
    assert logs["guidance_field.guidance"].value.shape[1] == GUIDANCE
    assert logs["plant.contact_force"].value.shape[1] == CONTACT_FORCE
    outputs = {
        f"{s.get_name()}.{s.get_output_port(i).get_name()}"
        for s in station.GetSystems()
        if not s.get_name().startswith("log/")
        for i in range(s.num_output_ports())
    }
    assert set(logs) == outputs


def test_record(station, rollout, tmp_path):
    record = to_record(station, rollout.get_context())
    assert record.scene.name == "beam" and len(record.time_s) == 151 and record.arrow_force_W.shape == (151, 19, 3)
    again = RolloutRecord.load(record.save(tmp_path / "r.npz"))
    np.testing.assert_allclose(again.root_pos_W, record.root_pos_W, atol=1e-6)
    arrived = np.hypot(*(record.root_pos_W[:, :2] - record.scene.goal).T) < 0.1
    assert record.outcome == ("success" if arrived.any() else "timeout")


def test_judge(station, rollout):
    qpos = read_logs(station, rollout.get_context())["state_adaptor.robot_state"].value[:, :43].copy()
    for change, outcome in (
        ({2: 0.3}, "fall"),
        ({38: 0.9, 36: 5.0}, "drop"),
        ({0: 2.0, 1: 0.0, 36: 2.25, 37: 0.0}, "success"),
    ):
        end = qpos[0].copy()
        for index, value in change.items():
            end[index] = value
        assert judge(station, np.array([0.0, 0.02]), np.stack([qpos[0], end])) == outcome
    under = qpos[0].copy()
    under[[0, 36]] += 1.0  # upright below the beam: the head is in it
    assert judge(station, np.zeros(1), under[None]) == "robot_collision"


def test_drake_follows_mujoco_standing():
    """Two seconds with the box, servos in the diagram and in the motors: pelvis within 5 cm."""
    for servo in ("pd", "motor"):
        a, b = (
            trace(make_station(StationConfig(servo=servo), plant=p, controller="hold"), 2.0)
            for p in ("mujoco", "drake")
        )
        assert np.linalg.norm(a[:, :3] - b[:, :3], axis=1).max() < 0.05
        assert np.linalg.norm(a[:, 36:39] - b[:, 36:39], axis=1).max() < 0.05
        assert (a[:, :3] != b[:, :3]).any()


def test_contact_forces_of_the_plants_agree():
    forces = []
    for name in ("mujoco", "drake"):
        station = make_station(StationConfig(), plant=name, controller="hold")
        simulator = Simulator(station)
        simulator.AdvanceTo(1.0)
        plant = station.GetSubsystemByName("plant")
        context = plant.GetMyContextFromRoot(simulator.get_context())
        forces.append(plant.GetOutputPort("contact_force").Eval(context).reshape(4, 3))
    np.testing.assert_allclose(forces[0][:, 2], forces[1][:, 2], atol=15.0)
    np.testing.assert_allclose(forces[0][2:, 1], forces[1][2:, 1], atol=10.0)


def test_the_policy_walks_in_drake():
    states = trace(make_station(plant="drake"), 1.5)
    assert states[-1, 0] > 0.4 and states[:, 2].min() > 0.65 and states[-1, 38] > 0.6


def test_friction_in_drake_is_that_of_mujoco():
    """What two bodies feel: Drake's mean of both frictions, MuJoCo's by priority, else the larger of both."""
    station = make_station(StationConfig(scene="beam"), plant="drake", controller="hold")
    inspector = station.GetSubsystemByName("plant").scene_graph.model_inspector()
    model = make_station(StationConfig(scene="beam"), controller="hold").GetSubsystemByName("plant").model
    geoms = {model.geom(i).name: model.geom(i) for i in range(model.ngeom)}

    def felt(a, b):
        first, second = sorted((geoms[a], geoms[b]), key=lambda g: g.priority[0], reverse=True)
        same = first.priority == second.priority
        return float(max(first.friction[0], second.friction[0]) if same else first.friction[0])

    seen, palms_meet = set(), set()
    for pair in inspector.GetCollisionCandidates():
        names = [
            inspector.GetName(g).split("::")[-1].removesuffix("_in_hands").replace("_at_palms/", "/") for g in pair
        ]
        assert set(names) <= geoms.keys(), names
        one, other = (inspector.GetProximityProperties(g).GetProperty("material", "coulomb_friction") for g in pair)
        mean = CalcContactFrictionFromSurfaceProperties(one, other).static_friction()
        assert mean == pytest.approx(felt(*names), abs=1e-6), names
        seen.add(mean.__round__(3))
        if any("_palm_" in n for n in names):
            palms_meet |= {n for n in names if "_palm_" not in n}
    assert seen >= {2.0, 1.0, 0.8} and palms_meet >= {"object", "obstacle/beam"}


def test_drake_stops_at_obstacles():
    """Collision rules of the plant: soles and floor, palms and object; obstacles and everything."""
    station = make_station(StationConfig(scene="beam"), plant="drake", controller="hold")
    inspector = station.GetSubsystemByName("plant").scene_graph.model_inspector()
    names = [
        tuple(sorted(inspector.GetName(g).split("::")[-1] for g in pair)) for pair in inspector.GetCollisionCandidates()
    ]
    floor = {a if b == "floor" else b for a, b in names if "floor" in (a, b)}
    robot = robot_spec(20).compile()
    meeting = {robot.geom(i).name for i in range(robot.ngeom) if robot.geom_conaffinity[i] & FLOOR}
    assert floor - {n for n in floor if "_palm_" in n} == {"object"} | meeting and "left_sole_0" in meeting
    held = {a if b == "object_in_hands" else b for a, b in names if "object_in_hands" in (a, b)}
    assert held == {f"{side}_palm_{i}" for side in ("left", "right") for i in range(4)}
    met = {a if b == "object" else b for a, b in names if "object" in (a, b)}
    assert "torso_link_0" in met and "left_sole_0" not in met and not met & held
    touched = {a if b == "obstacle/beam" else b for a, b in names if "obstacle/beam" in (a, b)}
    assert touched >= {"torso_link_0", "object", "left_sole_0"} and not touched & held
    by_palms = "obstacle_at_palms/beam"
    assert {a if b == by_palms else b for a, b in names if by_palms in (a, b)} == held
    across = [n for n in names if n[0].startswith("left_") and n[1].startswith("right_")]
    assert set(across) == {
        p for p in map(tuple, map(sorted, pairs())) if p[0].startswith("left_") and p[1].startswith("right_")
    }


def test_noise_changes_what_the_policy_reads(carry):
    config = StationConfig(sensing=StationConfig.from_dict({"sensing": "student"}).sensing, seed=4, log_hz=50.0)
    ends = []
    for seed in (4, 4, 5):
        station = make_station(StationConfig(**{**vars(config), "seed": seed}))
        simulator = Simulator(station)
        simulator.AdvanceTo(0.5)
        ends.append(read_logs(station, simulator.get_context())["state_adaptor.robot_state"].value[-1])
    np.testing.assert_array_equal(ends[0], ends[1])
    assert (ends[0] != ends[2]).any()


@pytest.mark.parametrize(
    "kwargs, error, message",
    [
        ({"plant": "gazebo"}, UnknownName, "unknown plant 'gazebo': known are drake, mujoco"),
        ({"controller": "run"}, UnknownName, "unknown controller 'run': known are hold, job, pickup"),
        ({"config": "station.yaml"}, InvalidConfig, "read one with StationConfig.load"),
        ({"config": StationConfig(physics_dt_s=0.003)}, InvalidConfig, "must be a multiple"),
        ({"config": StationConfig(scene="nowhere")}, UnknownName, "unknown scene"),
        ({"config": StationConfig(scene="no/file.json")}, InvalidScene, "no such file"),
        ({"config": StationConfig(policy="nobody")}, UnknownName, "unknown policy"),
        ({"config": StationConfig(policy="no/file.onnx")}, CheckpointError, "no such file"),
    ],
)
def test_bad_stations(kwargs, error, message):
    with pytest.raises(error, match=message):
        make_station(**kwargs)


def test_obstacles_may_have_any_name_in_drake(tmp_path):
    """Also that of another geometry."""
    shape, names = BoxShape((0.2, 0.2, 0.2)), ("floor", "object", "left_sole_0")
    stones = tuple(Obstacle(name, "ground", shape, (1.0, float(i), 0.1)) for i, name in enumerate(names))
    Scene("named", obstacles=stones).save(tmp_path / "s.json")
    station = make_station(StationConfig(scene=str(tmp_path / "s.json")), plant="drake", controller="hold")
    inspector = station.GetSubsystemByName("plant").scene_graph.model_inspector()
    found = {inspector.GetName(g) for g in inspector.GetAllGeometryIds()}
    assert found >= {f"obstacle/{name}" for name in names}


def test_drake_refuses_meshes(tmp_path):
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 0.2 0 0\nv 0 0.2 0\nv 0 0 0.2\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    from hotice.model.geometry.shapes import shape_from_dict

    shape = shape_from_dict({"type": "mesh", "file": "t.obj", "scale": 1.0}, tmp_path)
    Scene("tetra", obstacles=(Obstacle("stone", "ground", shape, (1.0, 0.5, 0.0)),)).save(tmp_path / "s.json")
    with pytest.raises(NotAvailable, match="'stone' is a triangle mesh"):
        make_station(StationConfig(scene=str(tmp_path / "s.json")), plant="drake")


def test_open_ports_are_named(carry):
    builder = DiagramBuilder()
    servo = builder.AddNamedSystem("joint_pd", JointPd())
    safety = builder.AddNamedSystem("safety_monitor", SafetyMonitor(SafePosture.of(carry), SafetyLimits(), 0.02))
    connect(builder, servo, "torque", safety, "command")
    with pytest.raises(InvalidStation, match="has no input port 'target': known are joint_target, joint_state"):
        connect(builder, safety, "command", servo, "target")
    with pytest.raises(InvalidStation, match="has no output port"):
        connect(builder, safety, "torque", servo, "joint_target")
    with pytest.raises(InvalidStation, match=f"has {FAULTS} numbers, port 'joint_target' of 'joint_pd' needs 20"):
        connect(builder, safety, "faults", servo, "joint_target")
    with pytest.raises(InvalidStation, match="connected already"):
        connect(builder, servo, "torque", safety, "command")
    with pytest.raises(
        InvalidStation, match="'joint_target' of 'joint_pd', 'joint_state' of 'joint_pd', 'robot_state' of"
    ):
        build(builder)


def test_a_station_without_logs(carry):
    station = make_station(controller="hold")
    with pytest.raises(NotAvailable, match="log_hz"):
        read_logs(station, station.CreateDefaultContext())


def test_pictures(station, tmp_path):
    for name in ("d.svg", "d.png", "d.dot"):
        assert write_diagram(station, tmp_path / name).stat().st_size > 2000
    text = (tmp_path / "d.dot").read_text()
    assert "guidance_field" in text and "safety_monitor" in text
    assert ("policy", "joint_target", "safety_monitor", "command") in wires(station)
    with pytest.raises(OutputError, match=r"\.png, \.svg, \.pdf or written as \.dot"):
        write_diagram(station, tmp_path / "d.gif")


def test_visualizer(tmp_path):
    meshcat = open_meshcat()
    station = make_station(StationConfig(scene="beam"), meshcat=meshcat)
    for path in ("robot/pelvis", "object", "obstacles/0", "field/0", "field/18", "force/left_ankle_roll_link", "goal"):
        assert meshcat.HasPath(f"station/{path}"), path
    meshcat.StartRecording()
    Simulator(station).AdvanceTo(0.2)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    page = write_station_page(meshcat, tmp_path / "station.html")
    assert page.stat().st_size > 100_000 and b"<script" in page.read_bytes()
    station.ForcedPublish(station.CreateDefaultContext())


def test_footsteps_and_primitives(beam, carry):
    meshcat = open_meshcat()
    steps = [(0.2, 0.1, 0.0, 0), (0.4, -0.1, 0.1, 1)]
    Visualizer(meshcat, beam, carry.carried, footsteps=steps, meshes=False)
    assert meshcat.HasPath("station/footsteps/1") and not meshcat.HasPath("station/footsteps/2")
    assert meshcat.HasPath("station/robot/torso_link/torso_link_0")


def test_no_torch_and_no_drake():
    code = "import sys; from hotice.systems import make_station; make_station(); assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
    code = "import sys; sys.modules['pydrake'] = None; import hotice.systems"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "hotice.systems needs Drake, which is not installed: pip install 'hotice[drake]'" in done.stderr


def test_the_station_is_the_plain_loop_of_the_benchmark():
    from benchmarks.station import environment, speed

    report = speed("pd", StationConfig(servo="pd"), seconds=0.2, rounds=1)
    assert report["bitwise"] and report["share"] > 0
    assert environment(0.1) > 0
