"""Where a pick-up ends: the stance in which policies were trained, with torques that hold it."""

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("proxsuite")

import mujoco

from hotice.control.controller import Measurement
from hotice.control.pick_plan import Support
from hotice.control.pickup import Pickup, PickupConfig
from hotice.control.pickup.end_state import carry_at_end
from hotice.control.pickup.footwork import Departure
from hotice.control.walk.later import WalkLater
from hotice.fields import build_hod_pf
from hotice.model import Box, Obstacle, Scene, builder, g1
from hotice.model.carry import carry_state_at, solve_carry
from hotice.model.geometry.shapes import BoxShape

TOP_M, NEAR_M = 0.6, 0.25
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def pickup(carried, **options):
    half = carried.half_extents_m
    place = np.array([NEAR_M + 0.02 + half[0], 0.0, TOP_M + half[2]])
    return Pickup(carried, Support(top_m=TOP_M, near_m=NEAR_M), place, UPRIGHT, **options)


@pytest.mark.parametrize("carried", [Box((0.3, 0.3, 0.3), 1.5), Box((0.4, 0.2, 0.2), 3.2)], ids=["cube", "long"])
def test_the_pick_up_ends_in_the_stance_of_the_policies(carried):
    picked = pickup(carried)
    state, own = carry_at_end(picked), solve_carry(carried)
    assert abs(state.root_pos_W[2] - own.root_pos_W[2]) < 0.005 and abs(state.posture.lean_rad) < 0.03
    np.testing.assert_allclose(state.joint_pos[g1.LOWER], own.joint_pos[g1.LOWER], atol=0.12)
    np.testing.assert_allclose(state.object_pos_W - state.root_pos_W, own.object_pos_W - own.root_pos_W, atol=0.08)
    np.testing.assert_array_equal(state.wrist_pos, picked.planner.wrist_pos)
    np.testing.assert_allclose(state.joint_pos, picked.expected.retreat[-1][7:])


def test_servo_targets_of_the_end_hold_the_object():
    """What the motors' own servos make of it in 0.4 s, before a policy must balance; bare angles let the object
    down."""
    state = carry_at_end(pickup(Box((0.3, 0.3, 0.3), 1.5)))
    model = builder.build_model(state.carried, wrist_pos=state.wrist_pos)
    moved = []
    for target in (state.joint_target, state.joint_pos):
        data = mujoco.MjData(model)
        data.qpos[:], data.ctrl[:] = state.qpos(), target
        for _ in range(round(0.4 / model.opt.timestep)):
            mujoco.mj_step(model, data)
        moved.append(np.linalg.norm(data.qpos[27:30] - state.object_pos_W))
    assert moved[0] < 0.03 and moved[1] > 2.0 * moved[0]


def test_a_carry_state_found_otherwise_is_the_solved_one():
    own = solve_carry(Box((0.3, 0.3, 0.3), 1.5))
    again = carry_state_at(
        own.carried, own.joint_pos, own.wrist_pos, own.object_pos_W - own.root_pos_W, squeeze_n=own.squeeze_n
    )
    for name in ("joint_target", "torque", "root_pos_W", "object_pos_W"):
        np.testing.assert_allclose(getattr(again, name), getattr(own, name), atol=1e-6)


def test_departures_begin_after_the_retreat():
    """From the end of the retreat on, the reference steps back and turns; without a departure it holds."""
    for departure, phase in ((Departure(), "hold"), (Departure(back_m=0.3, turn_rad=0.5), "depart")):
        picked = pickup(
            Box((0.3, 0.3, 0.3), 1.5), departure=departure, config=PickupConfig(rate_hz=100.0, retreat_s=1.5)
        )
        q, zero = picked.start_q, np.zeros(3)
        m = Measurement(
            time_s=0.0,
            joint_pos=q[7:],
            joint_vel=np.zeros(20),
            p_WP=q[:3],
            quat_WP=np.roll(q[3:7], 1),
            v_WP=zero,
            w_WP_P=zero,
            p_WO=np.array([0.42, 0.0, 0.75]),
            quat_WO=UPRIGHT,
            v_WO=zero,
            w_WO_O=zero,
            foot_force_W=np.full((2, 3), 100.0),
            hand_force_W=np.full((2, 3), 40.0),
        )
        memory = picked.start(m)
        memory.plan, memory.phase, memory.load_share, memory.squeeze_n = (
            picked.expected,
            "retreat",
            1.0,
            picked.squeeze_n,
        )
        memory.came_from = memory.reference = picked.expected.retreat[-1]
        seen = []
        for k in range(round(12.0 * picked.rate_hz)):
            m = Measurement(**{**vars(m), "time_s": (k + 1) / picked.rate_hz})
            _, memory = picked.step(memory, m)
            seen.append(memory.phase)
            if memory.phase == "hold":
                break
        assert phase in seen and seen[-1] == "hold"
        end = picked.expected.retreat[-1]
        yaw = 2 * np.arctan2(memory.reference[5], memory.reference[6])
        assert yaw == pytest.approx(departure.turn_rad, abs=1e-3)
        np.testing.assert_allclose(memory.reference[7:], end[7:], atol=1e-9)
        assert np.linalg.norm(memory.reference[:2] - end[:2]) == pytest.approx(departure.back_m, abs=0.06)


@pytest.mark.parametrize("blocked", [False, True])
def test_a_walk_is_planned_where_it_begins(blocked):
    """From (0.3, 0.1), turned by 0.4 rad; where nothing leads to the goal the robot stands with its load."""
    wall = Obstacle("wall", "side", BoxShape((0.1, 2.0, 1.5)), (1.2, 0.0, 0.75))
    scene = Scene("hall", obstacles=(wall,) if blocked else ())
    state = solve_carry(Box((0.3, 0.3, 0.3), 1.5))
    zero, yaw = np.zeros(3), 0.4
    m = Measurement(
        time_s=7.0,
        joint_pos=state.joint_pos,
        joint_vel=np.zeros(20),
        p_WP=state.root_pos_W + [0.3, 0.1, 0.0],
        quat_WP=np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]),
        v_WP=zero,
        w_WP_P=zero,
    )
    controller = WalkLater(build_hod_pf(scene), state)
    memory = controller.start(m)
    command, memory = controller.step(memory, m)
    assert np.isfinite(command.torque).all()
    if blocked:
        assert memory.failure and command.phase == "stand"
        np.testing.assert_allclose(command.torque, state.torque, atol=1e-9)
    else:
        plan = memory.controller.plan
        assert plan.path.at(0.0)[1] == pytest.approx(0.4, abs=0.1) and len(plan.footsteps) > 4
        assert abs(plan.footsteps[0].x - 0.3) < 0.35 and not memory.failure
