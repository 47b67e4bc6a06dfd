import numpy as np
import pytest

from hotice.deploy.command import DAMPING_KD, LIMITS, CheckedCommand, Limits, UnsafeCommand
from hotice.deploy.messages.checks import open_low_cmd
from hotice.model import g1

KNEE = g1.ALL_JOINTS.index("left_knee_joint")


def command(**changes):
    zero = np.zeros(29)
    fields = dict(q=zero, dq=zero, tau=zero, kp=LIMITS.kp, kd=LIMITS.kd, enabled=np.ones(29, bool))
    return CheckedCommand(**fields | changes)


def at_knee(value, base=0.0):
    values = np.full(29, base)
    values[KNEE] = value
    return values


@pytest.mark.parametrize("name", ["q", "dq", "tau", "kp", "kd"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e39])
def test_numbers_are_finite(name, bad):
    with pytest.raises(UnsafeCommand, match=f"left_knee_joint: {name} = -?(nan|inf)"):
        command(**{name: at_knee(bad)})


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("q", -0.087267, 2.8798),
        ("dq", -139.0 / DAMPING_KD, 139.0 / DAMPING_KD),  # kd dq is a torque
        ("tau", -139.0, 139.0),
        ("kp", 0.0, 200.0),
        ("kd", 0.0, DAMPING_KD),
    ],
)
def test_limits_of_the_knee(name, low, high):
    for edge, step in ((low, -1e-3), (high, 1e-3)):
        assert getattr(command(**{name: at_knee(edge)}), name)[KNEE] == np.float32(edge)
        with pytest.raises(UnsafeCommand, match=r"left_knee_joint.* is allowed"):
            command(**{name: at_knee(edge + step)})


def test_torque_and_speed_share_one_limit():
    command(tau=at_knee(100.0), dq=at_knee(39.0 / DAMPING_KD))
    with pytest.raises(UnsafeCommand, match="tau \\+ kd dq = 140"):
        command(tau=at_knee(100.0), dq=at_knee(40.0 / DAMPING_KD))
    with pytest.raises(UnsafeCommand, match="dq = 20.1"):
        command(kd=np.zeros(29), dq=at_knee(20.1))


def test_gains_end_at_the_trained_ones():
    kp, kd = g1.gains(g1.ALL_JOINTS)
    assert (LIMITS.kp == kp.astype(np.float32)).all() and (LIMITS.kd == np.maximum(kd, 8.0)).all()


@pytest.mark.parametrize("name", Limits._fields)
def test_limits_stay_what_they_are(name):
    limit = getattr(LIMITS, name)
    with pytest.raises(ValueError):
        limit[:] = 100.0
    with pytest.raises(ValueError):
        limit.flags.writeable = True


@pytest.mark.parametrize("shape", [(), (20,), (30,), (1, 29)])
def test_one_number_a_joint(shape):
    with pytest.raises(UnsafeCommand, match="one a joint"):
        command(q=np.zeros(shape))


def test_only_numbers_and_only_truths():
    with pytest.raises(UnsafeCommand, match="real numbers"):
        command(q=np.full(29, "0"))
    with pytest.raises(UnsafeCommand, match="bool is needed"):
        command(enabled=np.ones(29))


def test_it_stays_what_was_checked():
    source = np.zeros(29)
    checked = command(q=source)
    source[:] = 9.0
    assert not checked.q.any()
    with pytest.raises(ValueError):
        checked.q[0] = 9.0
    with pytest.raises(ValueError):
        checked.q.flags.writeable = True
    with pytest.raises(AttributeError):
        checked.q = source


def test_its_message(rng):
    low, high = LIMITS.lower, LIMITS.upper
    checked = command(q=rng.uniform(low, high), tau=rng.uniform(-1, 1, 29), enabled=np.arange(29) != KNEE)
    record = open_low_cmd(checked.message(mode_machine=6))
    assert record["mode_machine"] == 6 and record["mode_pr"] == 0
    motors = record["motor_cmd"]
    for name in ("q", "dq", "tau", "kp", "kd"):
        assert (motors[name][:29] == getattr(checked, name)).all()
    assert (motors["mode"][:29] == checked.enabled).all() and not motors[29:].tobytes().strip(b"\0")


@pytest.mark.parametrize("machine", [300, -1, 0, 7, "5", None])
def test_it_is_for_a_machine_that_exists(machine):
    with pytest.raises(
        UnsafeCommand, match=f"mode_machine of a command is '?{machine}'?: known are 1, 2, .*, 16; take"
    ):
        command().message(machine)


def test_the_motor_law(rng):
    checked = command(q=np.full(29, 0.1), tau=np.full(29, 1.0), enabled=np.arange(29) != 3)
    torque = checked.motor_torques(q=np.full(29, 0.2), dq=np.full(29, 0.5))
    expected = 1.0 + LIMITS.kp * (0.1 - 0.2) - LIMITS.kd * 0.5
    assert torque[3] == 0.0 and np.allclose(np.delete(torque, 3), np.delete(expected, 3), atol=1e-4)
