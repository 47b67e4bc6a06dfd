import mujoco
import numpy as np
import pytest

from hotice.control.walk.arms import level_arms
from hotice.model import Box, builder, g1
from hotice.model.carry import solve_carry


@pytest.mark.parametrize("size", [(0.2, 0.2, 0.2), (0.3, 0.35, 0.25), (0.4, 0.4, 0.4)])
def test_palms_stay_on_a_load_that_stays_level(size):
    """Forward kinematics: both palms keep their place in the object's frame at every lean."""
    state = solve_carry(Box(size, 2.0))
    table = level_arms(state)
    model = builder.build_model(None, wrist_pos=state.wrist_pos, floor=False, fixed_base=True)
    data = mujoco.MjData(model)
    palms = [model.geom(f"{s}_palm_{i}").id for s in g1.SIDES for i in range(4)]
    seen = []
    for lean in (0.0, 0.2, 0.45):
        data.qpos[12:20] = table.at(lean)
        mujoco.mj_kinematics(model, data)
        place, pitch = table.object_at(lean)
        c, s = np.cos(pitch), np.sin(pitch)
        R_PO = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        seen.append((data.geom_xpos[palms] - model.body("pelvis").pos - place) @ R_PO)
        assert pitch == pytest.approx(-lean, abs=0.08)
    assert seen[1] == pytest.approx(seen[0], abs=2e-3) and seen[2] == pytest.approx(seen[0], abs=2e-3)


def test_no_lean_keeps_the_grasp():
    state = solve_carry(Box((0.3, 0.3, 0.3), 1.5))
    assert level_arms(state).at(0.0) == pytest.approx(state.joint_pos[g1.UPPER], abs=5e-3)


def test_the_load_rises_against_the_trunk():
    table = level_arms(solve_carry(Box((0.3, 0.3, 0.3), 1.5)))
    assert (np.diff(table.p_PO[:, 2]) > 0).all()
