"""Bodies are solid: limbs keep each other out, and a robot on the floor lies on it."""

import mujoco
import numpy as np
import pytest

from hotice.model import Box, builder, g1, self_contact
from hotice.model.carry import Posture, solve_carry
from hotice.model.object_range import ObjectRange

STILL = np.zeros(20)


def standing(**kwargs):
    state = solve_carry(Box((0.3, 0.3, 0.3), 1.5))
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos, **kwargs)
    return model, state


def test_every_pair_is_of_the_robot_and_named_once():
    model, _ = standing()
    names = [tuple(sorted(pair)) for pair in self_contact.pairs()]
    assert len(set(names)) == len(names) == model.npair
    robot = model.body("pelvis").id
    for pair in names:
        links = [int(model.geom_bodyid[model.geom(n).id]) for n in pair]
        assert all(model.body_rootid[b] == robot for b in links) and links[0] != links[1]
    mirrored = {
        tuple(sorted(n.replace("left", "?").replace("right", "left").replace("?", "right") for n in p)) for p in names
    }
    assert mirrored == set(names)


def test_no_carry_state_is_inside_itself():
    """Of 60 objects of all shapes; forearms would be up to 7 mm in the chest for some narrow ones held close."""
    rng, worst = np.random.default_rng(0), 0.0
    objects = ObjectRange(shapes=("box", "cylinder", "sphere"))
    for _ in range(60):
        state = solve_carry(
            objects.sample(rng), Posture(pelvis_height_m=rng.uniform(0.6, 0.77), lean_rad=rng.uniform(0, 0.2))
        )
        model = builder.build_model(state.carried, wrist_pos=state.wrist_pos)
        data = mujoco.MjData(model)
        data.qpos[:] = state.qpos()
        mujoco.mj_kinematics(model, data)
        worst = max(worst, self_contact.depth(model, data))
    assert worst <= 0.001


CROSSINGS = {
    "knees": {"hip_roll": (-0.4, 0.4), "hip_yaw": (0.6, -0.6)},
    "hands on the chest": {"shoulder_pitch": (0.3, 0.3), "shoulder_yaw": (-1.2, 1.2), "elbow": (-0.6, -0.6)},
    "arms on the thighs": {"shoulder_pitch": (0.4, 0.4), "shoulder_roll": (-0.4, 0.4), "hip_pitch": (-1.2, -1.2)},
}


@pytest.mark.parametrize("name", list(CROSSINGS))
@pytest.mark.parametrize("elliptic", [False, True])
def test_limbs_do_not_pass_through_each_other(name, elliptic):
    """Servos pull limbs into each other for a second, at a fixed pelvis: without the pairs they do, with them they
    stop."""
    depths = {}
    for solid in (False, True):
        model = builder.build_model(
            None, fixed_base=True, floor=False, timestep_s=0.002 if elliptic else 0.005, elliptic=elliptic
        )
        if not solid:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        data = mujoco.MjData(model)
        for joint, sides in CROSSINGS[name].items():
            for side, target in zip(g1.SIDES, sides, strict=True):
                data.ctrl[model.actuator(f"{side}_{joint}").id] = target
        deepest = 0.0
        for _ in range(round(1.0 / model.opt.timestep)):
            mujoco.mj_step(model, data)
            deepest = max(deepest, self_contact.depth(model, data))
        depths[solid] = deepest, self_contact.depth(model, data)
    assert depths[False][0] > 0.02
    assert depths[True][0] < 0.5 * depths[False][0] and depths[True][1] < 0.012, depths


@pytest.mark.parametrize("push", [(2.5, 0.0), (-2.5, 0.0), (0.0, 2.5), (1.5, -2.0)])
@pytest.mark.parametrize("elliptic", [False, True])
def test_a_robot_that_fell_lies_on_the_floor(push, elliptic):
    """Pushed over with slack servos: two seconds later no geom of the robot is deeper than 2 cm in the floor."""
    model, state = standing(timestep_s=0.002 if elliptic else 0.005, elliptic=elliptic)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    data.qvel[:2] = push
    model.actuator_gainprm[:] *= 0.1
    model.actuator_biasprm[:] *= 0.1
    data.ctrl[:] = state.joint_target
    mujoco.mj_step(model, data, round(4.0 / model.opt.timestep))
    assert data.qpos[2] < 0.35, "it fell"
    assert lowest(model, data) > -0.02


def lowest(model, data):
    """Lowest point of the robot's geoms over the floor [m]."""
    robot = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body("pelvis").id)
    low = np.inf
    for i in robot:
        up, size, kind = data.geom_xmat[i].reshape(3, 3)[2], model.geom_size[i], model.geom_type[i]
        if kind == mujoco.mjtGeom.mjGEOM_BOX:
            reach = np.abs(up) @ size
        else:  # capsule, or sphere
            reach = size[0] + (abs(up[2]) * size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0)
        low = min(low, data.geom_xpos[i, 2] - reach)
    return low


def test_depth_of_two_capsules_is_their_overlap():
    """Thighs turned inwards: the sum of radii less the distance of their axes."""
    model = builder.build_model(None, fixed_base=True, floor=False)
    data = mujoco.MjData(model)
    for side, roll in (("left", -0.35), ("right", 0.35)):
        data.joint(f"{side}_hip_roll_joint").qpos[:] = roll
    mujoco.mj_kinematics(model, data)
    pair = ("left_hip_yaw_link_0", "right_hip_yaw_link_0")
    ends = []
    for name in pair:
        geom, half = model.geom(name), model.geom(name).size[1]
        axis = data.geom(name).xmat.reshape(3, 3)[:, 2]
        ends.append((data.geom(name).xpos - half * axis, data.geom(name).xpos + half * axis, geom.size[0]))
    t = np.linspace(0, 1, 2001)[:, None]
    a, b = (e[0] + t * (e[1] - e[0]) for e in ends)
    from scipy.spatial import cKDTree

    gap = cKDTree(a).query(b)[0].min() - ends[0][2] - ends[1][2]
    assert self_contact.depth(model, data, [pair]) == pytest.approx(max(0.0, -gap), abs=2e-4)
    assert gap < 0
