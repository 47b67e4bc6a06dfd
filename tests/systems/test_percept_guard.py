"""Every station has a guard between sensors and fields: noise passes as it is, and what cannot be does not."""

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import Simulator

from hotice.model.frames import yaw_from_quat
from hotice.policy.measuring import attitude, track_gravity
from hotice.policy.percept import Percept
from hotice.safety import Answer, Fault
from hotice.systems import InjectedFault, StationConfig, make_station, read_logs
from hotice.systems.faulty import BOX
from hotice.systems.percept_guard import attitude_of, track_down
from hotice.systems.setup.setup import StationSetup
from hotice.systems.station.make import Station
from hotice.task.sensing import STUDENT_SENSING, TRACK_TILT, SensingConfig
from tests.systems.test_faults import AT_S, quiet_before, watch

P_WO = BOX[:3]
RAW = SensingConfig(object_pos_m=0.05, object_rot_rad=0.087, gravity=0.05, gyro_rad_s=0.2)
HELD = SensingConfig(root_pos_m=0.02, root_yaw_rad=0.03, root_hz=10.0, object_pos_m=0.02)
SENSING = {"trained": STUDENT_SENSING, "exact": SensingConfig(), "raw poses": RAW, "a held root": HELD}


def setup_of(name):
    config = StationConfig(scene="open_floor", sensing=SENSING[name], push_m_s=0.5, log_hz=50.0)
    return StationSetup.decide(config, "mujoco", "policy")


@pytest.fixture(scope="module")
def setup():
    """Of a policy whose sensors are those of training."""
    return setup_of("trained")


def of_percept(index, kind="add", until_s=np.inf, **value):
    return InjectedFault(signal="percept", index=index, kind=kind, from_s=AT_S, until_s=until_s, **value)


@pytest.mark.parametrize("name", SENSING)
def test_the_noise_of_training_is_no_fault(name):
    """Nothing is replaced either: fields and policy read what the sensors said."""
    station = Station(setup_of(name))
    simulator = Simulator(station)
    monitor, sensors, guard = (
        station.GetSubsystemByName(n) for n in ("safety_monitor", "sensor_model", "percept_guard")
    )
    for seed in range(4):
        context = simulator.get_mutable_context()
        context.SetTime(0.0)
        station.SetRandomContext(context, RandomGenerator(seed))
        simulator.Initialize()
        for k in range(60):
            simulator.AdvanceTo(0.02 * k + 0.019)
            said, passed = (s.GetOutputPort("percept").Eval(s.GetMyContextFromRoot(context)) for s in (sensors, guard))
            np.testing.assert_array_equal(said, passed)
        assert not monitor.GetOutputPort("faults").Eval(monitor.GetMyContextFromRoot(context)).any()


JUMPS = {
    "a turn that no gyro felt": ((of_percept((3,), value=3.0),), Fault.POSE_JUMP),
    "a turn of 20 degrees": ((of_percept((3,), value=-0.35),), Fault.POSE_JUMP),
    "a place 0.6 m away": ((of_percept((0, 1), value=0.42),), Fault.POSE_JUMP),
    "no place": ((of_percept((0, 1, 2), "value"),), Fault.POSE_INVALID),
}


@pytest.mark.parametrize("name", JUMPS)
def test_a_place_that_jumps_is_not_gone_by(setup, name):
    """The robot stands upright for as long as it lasts, nor does it turn by what only the estimate says."""
    faults, fault = JUMPS[name]
    station = Station(setup, faults=faults)
    simulator = Simulator(station)
    seen = watch(station, AT_S + 2.0, simulator=simulator)
    quiet_before(seen)
    assert seen.counts[fault] >= 99 and seen.up.min() > 0.9
    stopped = [a is Answer.STOP_WALKING for t, a in zip(seen.time_s, seen.answer, strict=True) if t > 0.32]
    assert all(stopped)
    told, true = trace(station, simulator.get_context())
    assert np.linalg.norm(told.p_WP[:2] - true[:2]) < 0.2 and abs(told.yaw[0] - yaw_from_quat(true[3:7])) < 0.2
    after = seen.state[seen.time_s > 0.5]
    assert np.linalg.norm(after[:, :2] - after[0, :2], axis=1).max() < 0.35


def trace(station, context):
    """The newest percept that fields and policy read, and the true state (84,)."""
    logs = read_logs(station, context)
    return Percept(logs["percept_guard.percept"].value[-1]), logs["state_adaptor.robot_state"].value[-1]


@pytest.mark.parametrize("name", [name for name in JUMPS if name != "a turn of 20 degrees"])
def test_it_walks_on_when_the_place_is_right_again(setup, name):
    faults, fault = JUMPS[name]
    over = [of_percept(f.index, f.kind, AT_S + 1.0, value=f.value) for f in faults]
    seen = watch(Station(setup, faults=over), AT_S + 4.0)
    assert seen.counts[fault] == 50 and seen.fault[-1] is Fault.NONE
    assert seen.state[-1, 0] > 1.5 and seen.up.min() > 0.85


@pytest.mark.parametrize("index, value", [(P_WO, 0.3), (BOX, np.nan), (P_WO, 1e3)])
def test_a_box_that_cannot_be_is_held(setup, index, value):
    """For less than 0.1 s, which is passed over; in the pelvis frame the box stays where it was."""
    kind = "add" if np.isfinite(value) else "value"
    station = Station(setup, faults=[of_percept(index, kind, AT_S + 0.08, value=value)])
    simulator = Simulator(station)
    seen = watch(station, AT_S + 0.07, simulator=simulator)
    assert {Fault.BOX_JUMP, Fault.BOX_INVALID} & set(seen.counts) and set(seen.answer) == {Answer.PASS}
    told, true = trace(station, simulator.get_context())
    assert np.linalg.norm((told.p_WO - told.p_WP) - (true[36:39] - true[:3])) < 0.08
    assert np.isfinite(told.vector).all()


@pytest.mark.parametrize("controller", ["hold", "walk", "pickup"])
def test_whoever_controls(controller):
    """A box pose that is not finite is found in stations of every controller, without being asked for."""
    if controller != "hold":
        pytest.importorskip("pinocchio")
    station = make_station(StationConfig(scene="open_floor"), controller=controller)
    assert station.HasSubsystemNamed("percept_guard")
    seen = watch(Station(station.setup, faults=[of_percept(BOX, "value")]), AT_S + 0.1)
    assert seen.counts[Fault.BOX_INVALID] == 5


def test_legs_carry_the_place_on():
    """For 0.8 s nobody says where the walking robot is; the guard knows it to 3 cm and 3 degrees."""
    lost = InjectedFault(signal="stamps", index=(0,), kind="frozen", from_s=AT_S)
    station = make_station(StationConfig(scene="open_floor", log_hz=50.0), faults=[lost])
    simulator = Simulator(station)
    watch(station, AT_S + 0.8, simulator=simulator)
    logs = read_logs(station, simulator.get_context())
    told = [Percept(row) for row in logs["percept_guard.percept"].value[30:]]
    true = logs["state_adaptor.robot_state"].value[30:]
    walked = np.linalg.norm(true[-1, :2] - true[0, :2])
    off = [np.linalg.norm(p.p_WP - x[:3]) for p, x in zip(told, true, strict=True)]
    turned = [abs(p.yaw[0] - yaw_from_quat(x[3:7])) for p, x in zip(told, true, strict=True)]
    assert walked > 0.3 and max(off) < 0.03 and max(turned) < 0.06
    assert max(np.abs(p.p_WK[4] - p.p_WP).max() for p in told) < 0.01, "the keypoint of the pelvis goes along"


def test_the_compiled_loops_are_the_formulas(rng):
    down, count, R_WP = np.full(3, np.nan), 0.0, np.empty((3, 3))
    plain = None
    for k in range(30):
        gravity, gyro = np.array([0.1, -0.05, -0.99]) + 0.05 * rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        gain, dt_s = max(TRACK_TILT, 1.0 / (k + 1)), 0.02
        plain = gravity / np.linalg.norm(gravity) if plain is None else track_gravity(plain, gravity, gyro, gain, dt_s)
        count = track_down(down, count, gravity, gyro, dt_s)
        np.testing.assert_allclose(down, plain, atol=1e-14)
        attitude_of(0.7 + k, down, R_WP)
        np.testing.assert_allclose(R_WP, attitude(0.7 + k, plain), atol=1e-14)
    for bad in (np.full(3, np.nan), np.full(3, np.inf)):
        assert track_down(down, count, bad, gyro, 0.02) == count
    np.testing.assert_allclose(down, plain, atol=1e-14)
