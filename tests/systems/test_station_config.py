import pytest

from hotice.errors import InvalidConfig
from hotice.model import Box, Cylinder
from hotice.systems import StationConfig
from hotice.systems.safety_monitor import SafetyLimits
from hotice.task.sensing import STUDENT_SENSING, SensingConfig

WHOLE = """
scene: beam
carried: {shape: cylinder, radius_m: 0.13, length_m: 0.3, mass_kg: 1.5}
policy: carry
servo: pd
physics_dt_s: 0.004
sensing: {joint_pos_rad: 0.01, root_hz: 10}
safety: {tilt_rad: 0.8}
seed: 3
log_hz: 50
"""


@pytest.fixture
def load(tmp_path):
    def load(text):
        path = tmp_path / "station.yaml"
        path.write_text(text) if isinstance(text, str) else path.write_bytes(text)
        return StationConfig.load(path)

    return load


def test_a_file(load):
    config = load(WHOLE)
    assert config.scene == "beam" and config.carried == Cylinder(0.13, 0.3, 1.5)
    assert config.sensing == SensingConfig(joint_pos_rad=0.01, root_hz=10)
    assert config.safety == SafetyLimits(tilt_rad=0.8) and config.physics_dt_s == 0.004 and config.seed == 3
    assert load("{}") == StationConfig() and load("sensing: student").sensing == STUDENT_SENSING
    assert load("sensing: {root_tracking: true}").sensing.root_tracking
    assert load("{}").carried == Box((0.30, 0.30, 0.30), 1.5)


@pytest.mark.parametrize(
    "text, message",
    [
        ("scenes: beam", "unknown key 'scenes': known are scene, carried"),
        ("[1, 2]", "a mapping of scene"),
        ("", "a mapping of scene"),
        ("scene: [", "is no plain YAML"),
        (b"\xff\xfe\x00", "is no plain YAML"),
        ("!!python/object/apply:os.system ['true']", "is no plain YAML"),
        ("scene: 3", "scene is 3"),
        ("servo: spring", "known are motor, pd|known are pd, motor"),
        ("physics_dt_s: 0.1", "from 1e-05 to 0.01 s"),
        ("physics_dt_s: 1.0e-12", "from 1e-05 to 0.01 s"),
        ("meshcat_hz: 1.0e+300", "above 0 and at most 1000"),
        ("scene: open_floor\nscene: gap", "key 'scene' twice"),
        ("sensing: &a {gravity: 0.1}\nsafety: *a", "aliases .* not allowed"),
        ("physics_dt_s: .nan", "physics_dt_s is nan"),
        ("physics_dt_s: fast", "physics_dt_s is 'fast'"),
        ("log_hz: -1", "log_hz is -1"),
        ("seed: 1.5", "seed is 1.5"),
        ("seed: -1", "seed is -1"),
        ("elliptic: 1", "elliptic is 1"),
        ("pick_bearing_rad: .inf", "pick_bearing_rad is inf"),
        ("sensing: good", "known are exact, student, or a mapping"),
        ("sensing: {gyro: 1}", "sensing has unknown key 'gyro'"),
        ("sensing: {gyro_rad_s: much}", "sensing.gyro_rad_s is 'much'"),
        ("sensing: {gravity: -0.1}", "sensing.gravity is -0.1"),
        ("sensing: {root_tracking: 1}", "sensing.root_tracking is 1: true or false"),
        ("safety: 3", "safety is 3"),
        ("carried: {shape: cone}", "object shape is 'cone': known are box"),
        ("carried: {shape: sphere, radius_m: 0.1, mass_kg: -1}", "mass_kg is -1"),
    ],
)
def test_bad_files(load, text, message):
    with pytest.raises(InvalidConfig, match=message) as caught:
        load(text)
    assert "\n" not in str(caught.value) and "station.yaml" in str(caught.value)


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(InvalidConfig, match="no such file"):
        StationConfig.load(tmp_path / "none.yaml")
    with pytest.raises(InvalidConfig, match="is a folder"):
        StationConfig.load(tmp_path)


def test_values_from_python():
    with pytest.raises(InvalidConfig, match="carried is 'box'"):
        StationConfig(carried="box")  # type: ignore[arg-type]
    with pytest.raises(InvalidConfig, match="pelvis_height_m is True"):
        StationConfig(pelvis_height_m=True)
