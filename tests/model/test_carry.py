"""Carry states: grasp, stance and static torques, and that they hold in simulation."""

import mujoco
import numpy as np
import pytest

from hotice.errors import CarryInfeasible, InvalidConfig
from hotice.model import Box, Cylinder, Sphere, builder, g1
from hotice.model.carry import Posture, solve_carry
from hotice.model.object_range import ObjectRange

CASES = [
    (Box((0.30, 0.30, 0.30), 2.0), Posture()),
    (Box((0.20, 0.40, 0.25), 3.5), Posture(pelvis_height_m=0.62, lean_rad=0.15)),
    (Box((0.40, 0.40, 0.40), 1.0), Posture(pelvis_height_m=0.77)),
    (Cylinder(0.15, 0.30, 1.5), Posture()),
    (Cylinder(0.20, 0.35, 3.0), Posture(pelvis_height_m=0.66, lean_rad=0.20)),
    (Sphere(0.15, 1.5), Posture()),
    (Sphere(0.11, 0.5), Posture(pelvis_height_m=0.60)),
]
WEIGHT_M_S2 = 9.81


def case_id(value):
    return value.shape if hasattr(value, "shape") else f"{value.pelvis_height_m:g}-{value.lean_rad:g}"


@pytest.fixture(scope="module", params=CASES, ids=lambda case: "-".join(map(case_id, case)))
def state(request):
    return solve_carry(*request.param)


@pytest.fixture(scope="module")
def placed(state):
    """Robot and object on the floor in the carry state, kinematics done."""
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_comPos(model, data)
    return model, data


def points(model, data, part, side):
    """Centres of the four spheres of a sole or palm, (4, 3) in W, and their radius [m]."""
    geoms = [model.geom(f"{side}_{part}_{i}").id for i in range(4)]
    return data.geom_xpos[geoms], model.geom_size[geoms[0], 0]


def test_every_palm_sphere_touches(placed):
    """All eight, within 1.5 mm, and nothing else of the robot does."""
    model, data = placed
    item = model.geom(builder.OBJECT_BODY).id
    for g in range(model.ngeom):
        if model.geom_conaffinity[g] & builder.OBJECT and g != item:
            gap = mujoco.mj_geomDistance(model, data, g, item, 1.0, None)
            name = model.geom(g).name
            assert abs(gap) < 0.0015 if "palm" in name else gap > 0.005, (name, gap)


def test_feet_are_level_under_the_centre_of_mass(state, placed):
    model, data = placed
    soles, radius = zip(*(points(model, data, "sole", s) for s in g1.SIDES), strict=True)
    soles = np.concatenate(soles)
    np.testing.assert_allclose(soles[:, 2] - radius[0], 0.0, atol=1e-3)
    com = (model.body_mass[:, None] * data.xipos).sum(axis=0) / model.body_mass.sum()
    assert com[0] == pytest.approx(soles[:, 0].mean(), abs=2e-3) and com[1] == pytest.approx(0.0, abs=2e-3)
    assert data.body("pelvis").xpos[2] == pytest.approx(state.posture.pelvis_height_m, abs=1e-3)


def test_static_torques_balance_gravity_ground_and_grasp(state, placed):
    """Inverse dynamics at rest less ground and hand forces: joint rows are the torques, base rows vanish."""
    _, placed_data = placed
    model = builder.build_model(None, wrist_pos=state.wrist_pos, floor=False)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()[: model.nq]
    mujoco.mj_inverse(model, data)
    rest = data.qfrc_inverse.copy()
    weight = state.carried.mass_kg * WEIGHT_M_S2
    total = model.body_mass.sum() * WEIGHT_M_S2 + weight
    for side, inward in (("left", -1.0), ("right", 1.0)):
        for part, link, lever, force in (
            ("sole", "ankle_roll_link", [0, 0, -1.0], [0, 0, total / 2]),
            ("palm", "wrist_yaw_link", [0, inward, 0], [0, -inward * state.squeeze_n, -weight / 2]),
        ):
            centres, radius = points(model, data, part, side)
            for centre in centres:
                push = np.zeros(model.nv)
                at = centre + radius * np.array(lever)
                body = model.body(f"{side}_{link}").id
                mujoco.mj_applyFT(model, data, np.array(force, dtype=float) / 4, np.zeros(3), at, body, push)
                rest -= push
    np.testing.assert_allclose(rest[6:], state.torque, atol=0.02)
    np.testing.assert_allclose(rest[:3], 0.0, atol=0.01)  # N
    np.testing.assert_allclose(rest[3:6], 0.0, atol=0.8)  # N m: 2 mm of the total weight
    kp, _ = g1.gains()
    np.testing.assert_allclose(state.joint_target, state.joint_pos + state.torque / kp)
    assert placed_data.qpos.shape == state.qpos().shape


def test_states_are_symmetric_and_within_limits(state):
    index, sign = g1.mirror_joints()
    np.testing.assert_allclose(sign * state.joint_pos[index], state.joint_pos, atol=1e-9)
    np.testing.assert_allclose(sign * state.joint_target[index], state.joint_target, atol=2e-3)
    model = builder.build_model()
    limits = np.array([model.joint(j).range for j in g1.ACTION_JOINTS])
    assert (state.joint_pos >= limits[:, 0]).all() and (state.joint_pos <= limits[:, 1]).all()
    effort = np.array([model.actuator(j.removesuffix("_joint")).forcerange[1] for j in g1.ACTION_JOINTS])
    assert (np.abs(state.torque) < effort).all()
    assert state.object_pos_W[1] == 0 and 0.18 < state.object_pos_W[0] - state.root_pos_W[0] < 0.55


def hold(state, seconds, seed):
    """Slip of the object between the palms [m] after `seconds` of noisy servo targets, pelvis fixed."""
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos, fixed_base=True, floor=False)
    model.body("pelvis").pos[:] = state.root_pos_W
    model.body("pelvis").quat[:] = state.quat_WP
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    data.qpos[:] = state.qpos()[7:]
    mujoco.mj_kinematics(model, data)

    def grip():
        palms = [data.site(f"{s}_hand").xpos for s in g1.SIDES]
        return data.body(builder.OBJECT_BODY).xpos - np.mean(palms, axis=0)

    before = grip()
    for _ in range(round(seconds / 0.02)):
        data.ctrl[:] = state.joint_target + rng.uniform(-0.03, 0.03, 20)
        mujoco.mj_step(model, data, nstep=4)
    assert np.isfinite(data.qpos).all()
    return float(np.linalg.norm(grip() - before))


def test_ten_objects_are_held_for_a_second():
    rng = np.random.default_rng(3)
    objects = ObjectRange(shapes=("box", "cylinder", "sphere"))
    slips = [
        hold(solve_carry(objects.sample(rng), Posture(pelvis_height_m=rng.uniform(0.60, 0.77))), 1.0, seed)
        for seed in range(10)
    ]
    assert np.median(slips) < 0.005 and max(slips) < 0.02, slips


@pytest.mark.parametrize("width", [0.5, 0.6, 0.7])
def test_boxes_wider_than_the_paper_are_held_at_their_sides(width):
    """The palms touch the sides, not front or back, and the box stays."""
    state = solve_carry(Box((0.3, width, 0.3), 1.0))
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos()
    mujoco.mj_kinematics(model, data)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        centres, radius = points(model, data, "palm", side)
        np.testing.assert_allclose(sign * centres[:, 1], width / 2 + radius, atol=1.5e-3)
    assert hold(state, 1.0, 0) < 0.005


def test_wrists_stay_nearly_straight():
    """Over the range of objects and postures no grasp needs a wrist bent by more than 0.6 rad, whatever the shape."""
    rng = np.random.default_rng(8)
    objects = ObjectRange(shapes=("box", "cylinder", "sphere"))
    for _ in range(40):
        carried = objects.sample(rng)
        posture = Posture(pelvis_height_m=rng.uniform(0.60, 0.77), lean_rad=rng.uniform(0.0, 0.2))
        assert np.abs(solve_carry(carried, posture).wrist_pos).max() < 0.6, (carried, posture)


def test_solving_is_reproducible_and_starts_afresh():
    """A state does not depend on what was solved before."""
    first = solve_carry(*CASES[0])
    solve_carry(*CASES[4])
    again = solve_carry(*CASES[0])
    np.testing.assert_array_equal(first.qpos(), again.qpos())
    np.testing.assert_array_equal(first.joint_target, again.joint_target)


def test_squeeze_and_mass_enter_the_targets():
    """A heavier object and a firmer grip need more of the arms; the angles stay those of the shape."""
    light, heavy = (solve_carry(Box((0.3, 0.3, 0.3), m), squeeze_n=40.0) for m in (0.5, 3.0))
    firm = solve_carry(Box((0.3, 0.3, 0.3), 0.5), squeeze_n=60.0)
    np.testing.assert_allclose(light.joint_pos[g1.UPPER], heavy.joint_pos[g1.UPPER], atol=5e-3)
    assert np.linalg.norm(heavy.torque[g1.UPPER]) > np.linalg.norm(light.torque[g1.UPPER]) + 3.0
    assert np.linalg.norm(firm.torque[g1.UPPER] - light.torque[g1.UPPER]) > 1.0
    assert heavy.root_pos_W[0] < light.root_pos_W[0]  # stands further back under a heavier load


@pytest.mark.parametrize(
    ("carried", "posture", "message"),
    [
        (Box((0.3, 1.2, 0.3), 1.0), Posture(), "box 120 cm wide cannot be held"),
        (Sphere(0.6, 1.0), Posture(), "sphere 120 cm wide cannot be held"),
        (Box((0.3, 0.3, 0.3), 12.0), Posture(), "12.00 kg is too heavy for the arms"),
        (Box((0.3, 0.3, 0.3), 2.0), Posture(pelvis_height_m=0.45), "no stance with the pelvis at 0.45 m"),
        (Box((0.3, 0.3, 0.3), 2.0), Posture(pelvis_height_m=0.40, lean_rad=-0.2), "use another height or less lean"),
    ],
)
def test_infeasible(carried, posture, message):
    with pytest.raises(CarryInfeasible, match=message) as caught:
        solve_carry(carried, posture)
    assert "\n" not in str(caught.value)


def test_too_little_squeeze():
    with pytest.raises(
        CarryInfeasible, match=r"3.00 kg is too heavy for a squeeze of 5 N: palm friction 0.6 holds at most"
    ):
        solve_carry(Box((0.3, 0.3, 0.3), 3.0), squeeze_n=5.0)


@pytest.mark.parametrize("values", [{"pelvis_height_m": 0.9}, {"pelvis_height_m": float("nan")}, {"lean_rad": 0.9}])
def test_impossible_postures(values):
    with pytest.raises(InvalidConfig, match=f"{next(iter(values))} is"):
        Posture(**values)
