"""The simulated robot over the link in memory: motors, IMU, what it drops, and that it stands and falls."""

import re

import numpy as np
import pytest

from hotice.deploy.messages.checks import seal
from hotice.deploy.messages.hg import JOINTS, LOW_STATE
from hotice.deploy.messages.remote import connected, pressed
from hotice.deploy.simulated.senses.inertial import Imu, roll_pitch_yaw, tilted
from hotice.errors import InvalidConfig, UnknownName
from hotice.model import g1
from hotice.model.frames import quat_from_axis_angle, quat_rotate
from tests.deploy.simulated_fixture import STEP_S, Lab, command

KNEE = g1.ALL_JOINTS.index("left_knee_joint")
WRIST = g1.ALL_JOINTS.index("right_wrist_pitch_joint")


def one(index, value):
    values = np.zeros(29)
    values[index] = value
    return values


def torque_of(lab, told):
    """Torque of the next physics step, and position and speed that it was made of."""
    lab.link.state()
    lab.link.publish(told)
    q, dq = lab.world.joint_pos.copy(), lab.world.joint_vel.copy()
    lab.clock.sleep(STEP_S)
    return lab.state()["motor_state"]["tau_est"][JOINTS], q, dq


def hanging(**config):
    lab = Lab(start="held", **config)
    lab.live(0.3)
    return lab


def test_the_motor_law_by_hand():
    lab = hanging()
    told = command(q=one(KNEE, 0.2), dq=one(KNEE, 0.5), tau=one(KNEE, 3.0), kp=one(KNEE, 50.0), kd=one(KNEE, 2.0))
    torque, q, dq = torque_of(lab, told)
    assert torque[KNEE] == pytest.approx(3.0 + 50.0 * (0.2 - q[KNEE]) + 2.0 * (0.5 - dq[KNEE]), abs=1e-4)
    assert np.abs(dq[KNEE]) > 1e-3
    assert not np.delete(torque, KNEE).any()


def test_the_motor_law_with_drawn_motors():
    """A motor of another strength and gain believes its encoder."""
    lab = hanging(dynamics="drawn", seed=3)
    motors = lab.world.motors
    torque, q, dq = torque_of(lab, command(q=one(KNEE, 0.2), tau=one(KNEE, 3.0), kp=one(KNEE, 50.0), kd=one(KNEE, 2.0)))
    seen = q[KNEE] + motors.offset[KNEE]
    kp, kd, strength = motors._kp_share[KNEE], motors._kd_share[KNEE], motors._strength[KNEE]
    assert torque[KNEE] == pytest.approx(strength * 3.0 + kp * 50.0 * (0.2 - seen) - kd * 2.0 * dq[KNEE], abs=1e-3)
    assert abs(kp - 1.0) > 0.01 and abs(strength - 1.0) > 0.01 and abs(motors.offset[KNEE]) > 1e-4


def test_torques_are_cut_at_the_limit():
    lab = hanging()
    torque, _, _ = torque_of(lab, command(q=one(WRIST, 1.5), kp=one(WRIST, 60.0)))
    assert torque[WRIST] == pytest.approx(5.0)


def test_motors_that_are_off_are_limp():
    lab = hanging()
    told = lab.holding()
    off = command(q=told.q, tau=told.tau, kp=told.kp, kd=told.kd, enabled=np.zeros(29, bool))
    torque, _, _ = torque_of(lab, off)
    assert not torque.any()
    assert not lab.state()["motor_state"]["mode"].any()


def test_damping_does_not_chatter():
    """At kd 8 a torque computed every 2 ms changes its sign some 200 times a second."""
    lab = hanging()
    told, signs = command(kd=np.full(29, 8.0)), []
    for _ in range(250):
        lab.live(STEP_S, told)
        signs.append(np.sign(lab.state()["motor_state"]["tau_est"][JOINTS]))
    changes = (np.diff(signs, axis=0) != 0).sum(axis=0) / 0.5
    assert changes.mean() < 30.0


@pytest.mark.parametrize("silence", ["hold", "limp", "damp"])
def test_what_motors_do_when_commands_stop(silence):
    lab = hanging(silence=silence, silence_after_s=0.05)
    lab.live(0.1, lab.holding())
    lab.live(0.04)
    assert lab.state()["motor_state"]["mode"][KNEE] == 1
    holding = lab.robot.told
    lab.live(0.04)
    state = lab.state()["motor_state"]
    if silence == "hold":
        assert lab.robot.told is holding
    if silence == "limp":
        assert not state["tau_est"].any() and not state["mode"].any()
    if silence == "damp":
        lab.clock.sleep(STEP_S)
        assert lab.robot.told.kd[KNEE] == 8.0 and not np.any(lab.robot.told.kp)


def test_a_bad_checksum_moves_nothing():
    lab = hanging()
    good = command(tau=one(KNEE, 5.0)).message(5)
    lab.bus.put_command(good[:-1] + bytes([good[-1] ^ 1]))
    lab.live(2 * STEP_S)
    assert not lab.state()["motor_state"]["tau_est"].any()
    assert lab.robot.end.counts().refused == {"crc": 1}
    lab.bus.put_command(good)
    lab.live(2 * STEP_S)
    assert lab.state()["motor_state"]["tau_est"][KNEE] == pytest.approx(5.0)


def test_another_machine_moves_nothing():
    lab = hanging(machine=11)
    lab.bus.put_command(command(tau=one(KNEE, 5.0)).message(5))
    lab.live(2 * STEP_S)
    assert not lab.state()["motor_state"]["tau_est"].any()
    assert lab.robot.end.counts().refused == {"mode": 1}
    assert lab.state()["mode_machine"] == 11
    lab.live(2 * STEP_S, command(tau=one(KNEE, 5.0)))
    assert lab.state()["motor_state"]["tau_est"][KNEE] == pytest.approx(5.0)


def test_a_state_every_two_milliseconds():
    lab = Lab()
    lab.live(1.0)
    lab.link.state()
    counts = lab.link.counts()
    assert (counts.taken, counts.missed, counts.repeats, counts.refused) == (500, 0, 0, {})
    assert lab.robot.time_s == pytest.approx(1.0)
    assert lab.state()["tick"] == 1000


def test_the_imu_at_rest_feels_the_floor():
    lab = Lab()
    lab.live(0.2, lab.holding())
    imu = lab.state()["imu_state"]
    assert imu["accelerometer"] == pytest.approx([0.0, 0.0, 9.81], abs=0.1)
    assert imu["gyroscope"] == pytest.approx(np.zeros(3), abs=0.02)
    assert imu["quaternion"] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=0.01)


class TestImu:
    """Against a pelvis that is moved by hand."""

    quat = quat_from_axis_angle([0.0, 1.0, 0.0], 0.4)

    def imu(self):
        return Imu(Lab().world.model)

    def test_leaning_forward(self):
        qpos = np.concatenate([np.zeros(3), self.quat])
        reading = self.imu().read(qpos, np.zeros(6))
        # what is up is ahead of the pelvis' own up when it leans forward: behind the pelvis, along −x
        assert reading.accelerometer == pytest.approx(9.81 * np.array([-np.sin(0.4), 0.0, np.cos(0.4)]))
        assert roll_pitch_yaw(reading.quaternion) == pytest.approx([0.0, 0.4, 0.0])

    def test_tipping_forward_turns_about_plus_y(self):
        rate = np.array([0.0, 1.5, 0.0])
        reading = self.imu().read(np.concatenate([np.zeros(3), self.quat]), np.concatenate([np.zeros(3), rate]))
        assert reading.gyroscope == pytest.approx(rate)

    def test_falling_freely_feels_nothing(self):
        imu = self.imu()
        qpos = np.concatenate([np.zeros(3), self.quat])
        imu.read(qpos, np.zeros(6))
        reading = imu.read(qpos, np.array([0.0, 0.0, -9.81 * STEP_S, 0.0, 0.0, 0.0]))
        assert reading.accelerometer == pytest.approx(np.zeros(3), abs=1e-9)

    def test_spinning_pulls_towards_the_axis(self):
        """The IMU is 45 mm ahead of the pelvis' axis: turning about z it is pulled back to it."""
        imu, rate, turn = self.imu(), 3.0, 3.0 * STEP_S
        velocity = np.array([0.0, 0.0, 0.0, 0.0, 0.0, rate])
        for yaw in (0.0, turn):
            qpos = np.concatenate([np.zeros(3), quat_from_axis_angle([0.0, 0.0, 1.0], yaw)])
            reading = imu.read(qpos, velocity)
        assert reading.accelerometer[0] == pytest.approx(-(rate**2) * 0.04525, rel=1e-3)

    def test_tilted_points_gravity(self, rng):
        quat, gravity = rng.normal(size=4), rng.normal(size=3)
        quat /= np.linalg.norm(quat)
        found = tilted(quat, gravity)
        assert quat_rotate(found, gravity / np.linalg.norm(gravity)) == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)
        down_P = quat_rotate(quat * [1, -1, -1, -1], np.array([0.0, 0.0, -1.0]))
        assert abs(tilted(quat, down_P) @ quat) == pytest.approx(1.0)


def test_noise_is_the_trained_one():
    exact, noisy = Lab(), Lab(noise="trained")
    rows = {"q": [], "dq": [], "gyro": [], "tilt": []}
    for _ in range(200):
        for lab in (exact, noisy):
            lab.live(STEP_S, lab.holding())
        a, b = exact.state(), noisy.state()
        for name in ("q", "dq"):
            rows[name].append(b["motor_state"][name][JOINTS] - a["motor_state"][name][JOINTS])
        rows["gyro"].append(b["imu_state"]["gyroscope"] - a["imu_state"]["gyroscope"])
        rows["tilt"].append(b["imu_state"]["rpy"][:2] - a["imu_state"]["rpy"][:2])
    for name, half in (("q", 0.03), ("dq", 1.5), ("gyro", 0.2), ("tilt", 0.05)):
        values = np.ravel(rows[name])
        assert np.abs(values).max() <= 1.05 * half, name
        assert values.std() == pytest.approx(half / np.sqrt(3.0), rel=0.1), name
        assert abs(values.mean()) < 0.1 * half, name


def test_it_stands_with_the_object_for_three_seconds():
    lab = Lab()
    lab.live(3.0, lab.holding())
    assert not lab.robot.gantry.holds
    assert lab.world.failure == "" and lab.world.touched == ""
    assert lab.world.data.qpos[2] == pytest.approx(0.74, abs=0.02)


def test_a_pushed_one_falls_and_lies_on_the_floor():
    lab = Lab()
    lab.live(0.2, lab.holding())
    lab.world.push([1.5, 0.0])
    lab.live(2.0, lab.holding())
    assert lab.robot.failure == "fall"
    # trunk and knees are solid: it lies on them
    assert lab.world.data.qpos[2] > 0.03


def test_before_the_first_command_it_is_steadied():
    lab = Lab()
    lab.live(5.0)
    assert lab.world.failure == "" and lab.robot.gantry.holds


def test_a_command_with_all_motors_off_does_not_let_go():
    lab = Lab()
    lab.live(0.1, command(enabled=np.zeros(29, bool)))
    assert lab.robot.gantry.holds


def test_hanging_then_lowered_onto_its_feet():
    lab = Lab(start="held")
    lab.live(1.0)
    assert lab.world.lowest_sole_m > 0.02
    told = lab.holding()
    lab.live(1.0, told)
    lab.robot.press("F2")
    assert lab.robot.gantry.holds
    lab.live(3.5, told)
    assert not lab.robot.gantry.holds
    assert lab.world.data.qpos[2] == pytest.approx(0.74, abs=0.03)


def test_the_object_comes_between_the_palms():
    """The palms, which hold each other's way, are parted for the object; then it is let go, and stays."""
    lab = Lab(start="held")
    told = lab.holding()
    lab.live(1.5, told)
    assert lab.world.object_pose[2] == pytest.approx(3.0, abs=1e-3)
    # nothing was given yet that could be dropped
    assert lab.world.failure == "drop" and lab.robot.failure == ""
    lab.robot.press("F1")
    lab.live(1.5, told)
    assert lab.robot.handing.stage == "held"
    lab.robot.press("F1")
    lab.live(1.5, told)
    assert lab.robot.handing.stage == "gone"
    assert lab.world.failure == ""


def test_the_same_seed_is_the_same_robot():
    def run(seed):
        lab = Lab(noise="trained", dynamics="drawn", delays="trained", seed=seed)
        lab.live(0.5, lab.holding())
        return seal(LOW_STATE, lab.state())

    assert run(4) == run(4) != run(5)


def test_delays_are_those_drawn():
    from hotice.task.sensing import STUDENT_SENSING, draw_delays

    seeds = {draw_delays(STUDENT_SENSING, 0.02, 10, seed)[0]: seed for seed in range(8)}
    for late in (False, True):
        seed = seeds[late]
        lab = hanging(delays="trained", seed=seed)
        delay_s = draw_delays(STUDENT_SENSING, 0.02, 10, seed)[1]
        told, steps = command(tau=one(KNEE, 5.0)), 0
        while not lab.state()["motor_state"]["tau_est"][KNEE]:
            lab.live(STEP_S, told)
            steps += 1
        assert steps == 1 + round(delay_s / STEP_S) + (10 if late else 0)


def test_keys_come_with_the_state():
    lab = Lab(fault=("remote-loss@0.2s+0.1s",), press=("start@0.01s", "R1+A@0.2s"))

    def keys_after(seconds):
        lab.live(seconds)
        remote = lab.state()["wireless_remote"]
        return pressed(remote) if connected(remote) else None

    assert keys_after(STEP_S) == set()
    lab.robot.press("L2", "B", for_s=0.1)
    assert keys_after(0.05) == {"L2", "B", "start"}
    assert keys_after(0.1) == {"start"}
    assert keys_after(0.1) is None
    assert keys_after(0.1) == {"R1", "A"}
    assert keys_after(0.1) == set()
    with pytest.raises(UnknownName, match="Z"):
        lab.robot.press("Z")


def test_motors_warm_up_and_the_battery_drains():
    lab = Lab(battery_percent=50.0)
    lab.live(3.0)
    temperature = lab.state()["motor_state"]["temperature"]
    shoulder = g1.ALL_JOINTS.index("left_shoulder_yaw_joint")
    assert temperature[shoulder, 1] > temperature[0, 1] >= 30
    assert 49.9 < lab.robot.states._charge < 50.0
    assert lab.robot.states.battery()["soc"] == 50


@pytest.mark.parametrize(
    "values",
    [
        {"box": (0.3, 0.3, 0.0, 1.5)},
        {"machine": 6},
        {"start": "flying"},
        {"silence": "dance"},
        {"silence_after_s": 0.0},
        {"battery_percent": 101.0},
        {"noise": "much"},
    ],
)
def test_impossible_choices_are_told(values):
    with pytest.raises(InvalidConfig):
        Lab(**values)


def test_the_story_tells_what_happened_and_when():
    """Not only how it stands in the end: a fall, and whether the object was given or was in its hands before."""
    standing, held = Lab(fault=("push@0.1s",)), Lab(start="held")
    for lab in (standing, held):
        lab.live(0.1, lab.holding() if lab is standing else None)
    words = dict(standing.robot.told_story())
    assert (
        words["object"] == "in its hands from the start" and words["robot and object"] == "neither fallen nor dropped"
    )
    assert words["touched"] == "no obstacle" and words["to the goal"].startswith("2.0")
    assert dict(held.robot.told_story())["object"] == "aside"
    standing.live(2.5, command())
    words = dict(standing.robot.told_story())
    assert re.fullmatch(r"(fall|drop); first (fall|drop) at [0-2]\.\d s", words["robot and object"])
    # whoever is put back on its feet has fallen all the same
    standing.world.place(standing.world.start)
    now, nearest = dict(standing.robot.told_story()), words["to the goal"].split()[-2]
    assert now["robot and object"].startswith("neither fallen nor dropped; first ")
    assert float(nearest) <= 2.0
    held.robot.handing.stage = "held"
    held.live(0.02)
    held.robot.handing.stage = "gone"
    held.live(0.02)
    assert dict(held.robot.told_story())["object"] == "given to the robot at 0.1 s"
