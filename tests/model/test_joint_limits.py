import mujoco
import numpy as np
import pytest

from hotice.errors import UnknownName
from hotice.model import g1
from hotice.model.joint_limits import position_limits, torque_limits


def test_equal_to_the_compiled_model():
    model = mujoco.MjModel.from_xml_path(g1.xml_path())
    joints = [model.joint(name) for name in g1.ALL_JOINTS]
    assert np.array_equal(np.stack(position_limits(), -1), [joint.range for joint in joints])
    by_joint = {model.joint(model.actuator_trnid[i, 0]).name: model.actuator_ctrlrange[i] for i in range(model.nu)}
    assert np.array_equal(torque_limits(), [by_joint[name][1] for name in g1.ALL_JOINTS])
    assert all(low == -high for low, high in by_joint.values())


def test_by_name():
    assert torque_limits(["left_knee_joint"]).tolist() == [139.0]
    with pytest.raises(UnknownName, match="knee"):
        position_limits(["knee"])


def test_no_joints_have_no_limits():
    assert [len(x) for x in position_limits([])] == [0, 0]
