import copy
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from hotice.control.plant import TorquePlant
from hotice.control.walk import WalkConfig, WalkController, plan_walk
from hotice.control.walk.leg import ANKLE_BEND_RAD, SHANK_M, THIGH_M, toe_down
from hotice.fields import build_hod_pf
from hotice.model import Box, Scene, builder, g1
from hotice.model.carry import solve_carry

STATE = solve_carry(Box((0.30, 0.30, 0.30), 1.5))
HALF_A_METRE = Scene.from_dict(
    {
        "format": "hotice-scene/1",
        "name": "short",
        "bounds_m": [[-0.5, -1.0, 0.0], [1.0, 1.0, 1.5]],
        "start": {"position_m": [0.0, 0.0], "yaw_rad": 0.0},
        "goal": {"position_m": [0.5, 0.0]},
        "obstacles": [],
    }
)


@pytest.fixture(scope="module")
def walker():
    """A controller with its plan, and the plant at the start of it."""
    plant = TorquePlant(builder.build_model(STATE.carried, wrist_pos=STATE.wrist_pos))
    plant.reset(STATE.qpos())
    x, y = np.mean([plant.data.body(f"{s}_ankle_roll_link").xpos[:2] for s in g1.SIDES], axis=0)
    plan = plan_walk(build_hod_pf(HALF_A_METRE, resolution_m=0.08), STATE, (float(x), float(y), 0.0))
    return WalkController(plan, STATE), plant


def restart(walker):
    controller, plant = walker
    plant.reset(STATE.qpos())
    return controller, plant, controller.start(plant.measure())


def drive(controller, plant, memory, seconds):
    torques = []
    for _ in range(round(seconds * controller.rate_hz)):
        command, memory = controller.step(memory, plant.measure())
        plant.step(command.torque)
        torques.append(command.torque)
    return np.array(torques), command, memory


def test_walks_to_the_goal_with_the_load_and_stops_there(walker):
    controller, plant, memory = restart(walker)
    _, command, memory = drive(controller, plant, memory, 3.5)
    root, load = plant.data.qpos[:3], plant.data.qpos[27:30]
    assert command.phase == "stand" and memory.step == len(controller.plan.footsteps)
    assert root[0] == pytest.approx(0.5, abs=0.08) and root[1] == pytest.approx(0.0, abs=0.05)
    assert root[2] == pytest.approx(WalkConfig().pelvis_height_m, abs=0.02)
    assert np.abs(plant.data.qvel[:2]).max() < 0.05
    hands = np.mean([plant.data.site(f"{s}_hand").xpos for s in g1.SIDES], axis=0)
    grasp = np.linalg.norm(load - hands)
    plant.reset(STATE.qpos())
    hands = np.mean([plant.data.site(f"{s}_hand").xpos for s in g1.SIDES], axis=0)
    assert grasp == pytest.approx(np.linalg.norm(STATE.object_pos_W - hands), abs=0.02)


def test_a_step_leaves_its_memory_alone_and_a_copy_repeats_it(walker):
    controller, plant, memory = restart(walker)
    _, _, memory = drive(controller, plant, memory, 0.6)
    before, measurement = copy.deepcopy(memory), plant.measure()
    first, _ = controller.step(memory, measurement)
    assert memory.phase == before.phase and (memory.feet == before.feet).all()
    assert (memory.qp.guess.x == before.qp.guess.x).all() and (memory.qp.torque == before.qp.torque).all()
    again, _ = controller.step(before, measurement)
    assert again.torque == pytest.approx(first.torque, abs=1e-3)


def test_what_is_not_finite_is_a_fault_and_the_last_torque(walker):
    controller, plant, memory = restart(walker)
    command, memory = controller.step(memory, plant.measure())
    bad = replace(plant.measure(), joint_vel=np.full(20, np.nan))
    faulty, after = controller.step(memory, bad)
    assert faulty.faults == command.faults + 1 and after.qp.faults == faulty.faults
    assert faulty.torque == pytest.approx(command.torque)


def test_a_lifted_foot_points_down_only_behind_the_hip():
    p_WP, R_WP = np.array([0.0, 0.0, 0.71]), np.eye(3)
    level, _ = toe_down(p_WP, R_WP, 1.0, np.array([0.1, 0.117, 0.10, 0.0]))
    down, lift = toe_down(p_WP, R_WP, 1.0, np.array([-0.25, 0.117, 0.15, 0.0]))
    assert level == 0.0
    assert down > 0.2 and lift > 0.02


def test_the_ankle_of_a_lifted_foot_stays_in_range():
    """Law of cosines with the pitch that was given: the angle between shank and foot is at the limit, not beyond."""
    pose = np.array([-0.2, 0.117, 0.12, 0.0])
    pitch, lift = toe_down(np.array([0.0, 0.0, 0.71]), np.eye(3), 1.0, pose)
    below, ahead = 0.71 - 0.133 - (pose[2] + lift + 0.018), pose[0]
    length = np.hypot(ahead, below)
    shank = np.arccos((length**2 + SHANK_M**2 - THIGH_M**2) / (2 * length * SHANK_M)) - np.arctan2(ahead, below)
    assert shank - pitch == pytest.approx(ANKLE_BEND_RAD, abs=0.03)


def test_importing_walk_costs_no_solver():
    heavy = ("pinocchio", "osqp", "proxsuite", "torch")
    code = f"import sys, hotice.control.walk; print([m for m in {heavy} if m in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == "[]"
    )
