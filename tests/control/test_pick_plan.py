"""Planning a pick-up: kinematics that agree, solvers that name what they cannot keep, a cache that knows what decides a
plan."""

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pinocchio")
pytest.importorskip("pydrake")
pytest.importorskip("adam.casadi")

import pinocchio as pin

import hotice
from hotice.control.pick_plan import Durations, PickPlan, Planner, Support, cache
from hotice.control.pick_plan.grip import PALM_POINTS_M, PALM_RADIUS_M, Grip
from hotice.control.pick_plan.guess import hold as together
from hotice.control.pick_plan.guess.postures import Guess
from hotice.control.pick_plan.keyframes.ik import KeyframeIk
from hotice.control.pick_plan.keyframes.robot import DrakeRobot
from hotice.control.pick_plan.paths.kinematics import NX, OUT, kinematics, to_q, to_x
from hotice.control.pick_plan.paths.nlp import Knots, PathProgram
from hotice.control.pick_plan.task import PickTask, frames_at
from hotice.control.whole_body.terms import FEET, Terms
from hotice.errors import HoticeError, PickInfeasible
from hotice.model import Box, Cylinder, Sphere
from hotice.model.carry import surface_distance
from hotice.model.frames import quat_from_yaw, quat_to_mat

BOX, SUPPORT = Box((0.26, 0.28, 0.28), 1.5), Support(top_m=0.52, near_m=0.24)
PLACE, QUAT = np.array([0.39, 0.02, 0.66]), np.asarray(quat_from_yaw(0.1))
WRISTS = np.array([0.1, -0.2, 0.3, 0.0, 0.15, -0.1])


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    return Planner(BOX, SUPPORT, folder=tmp_path_factory.mktemp("plans"))


@pytest.fixture(scope="module")
def plan(planner):
    return planner.plan(planner.start_q, PLACE, QUAT)


@pytest.fixture
def pose():
    rng = np.random.default_rng(3)
    terms = Terms(WRISTS)
    joints = rng.uniform(0.6 * terms.lower, 0.6 * terms.upper)
    quat = pin.Quaternion(pin.rpy.rpyToMatrix(*rng.uniform(-0.5, 0.5, 3))).coeffs()
    return terms, np.concatenate([rng.standard_normal(3), quat, joints])


def test_casadi_and_pinocchio_agree(pose):
    """Feet, hands, knees and centre of mass of the expression are those of the model that controllers use."""
    terms, q = pose
    x = to_x(pin, q)
    np.testing.assert_allclose(to_q(pin, x), q * np.sign(q[6]) ** ([0] * 3 + [1] * 4 + [0] * 20), atol=1e-12)
    rows = np.asarray(kinematics()(x, WRISTS)).ravel()
    found = {name: rows[a:b] for name, (a, b) in OUT.items()}
    feet, hands = frames_at(terms, q, FEET), frames_at(terms, q)
    for frames, name in ((feet, "feet"), (hands, "hands")):
        np.testing.assert_allclose(found[f"{name}_p"].reshape(2, 3), frames.p, atol=1e-9)
        np.testing.assert_allclose(found[f"{name}_R"].reshape(2, 3, 3).swapaxes(1, 2), frames.R, atol=1e-9)
    knees = [terms.data.oMi[terms.model.getJointId(f"{s}_knee_joint")].translation for s in ("left", "right")]
    np.testing.assert_allclose(found["knees_p"].reshape(2, 3), knees, atol=1e-9)
    np.testing.assert_allclose(found["com"], terms.com, atol=1e-9)


def test_drake_and_pinocchio_agree(pose):
    terms, q = pose
    robot = DrakeRobot(WRISTS)
    np.testing.assert_allclose(robot.configuration(robot.positions(q)), q, atol=1e-12)
    context = robot.plant.CreateDefaultContext()
    robot.plant.SetPositions(context, robot.positions(q))
    hands = frames_at(terms, q)
    for i, side in enumerate(("left", "right")):
        X = robot.plant.GetFrameByName(f"{side}_wrist_yaw_link").CalcPoseInWorld(context)
        np.testing.assert_allclose(X.multiply(robot.hand_m[i]), hands.p[i], atol=1e-9)
        np.testing.assert_allclose(X.rotation().matrix(), hands.R[i], atol=1e-9)
    assert robot.mass_kg == pytest.approx(terms.mass_kg)


def test_inverse_kinematics_meets_its_constraints_and_costs(planner):
    """A hand put 5 cm aside and ahead while the feet stay; the pelvis is pulled down by its cost."""
    robot, terms, q = DrakeRobot(planner.wrist_pos), planner.terms, planner.start_q
    feet, hands, pelvis = frames_at(terms, q, FEET), frames_at(terms, q), q[:3] - [0.0, 0.0, 0.05]
    ik = KeyframeIk(robot)
    for i, side in enumerate(("left", "right")):
        ik.place(f"{side}_ankle_roll_link", np.zeros(3), feet.p[i], feet.R[i], "foot")
    goal = hands.p[0] + [0.05, 0.05, 0.0]
    ik.within("left_wrist_yaw_link", robot.hand_m[0], goal - 0.001, goal + 0.001, "hand")
    ik.pelvis(pelvis, np.roll(q[3:7], 1), (10.0, 10.0))
    ik.posture(q[7:], np.full(20, 0.1))
    found = ik.solve(q, "reaching aside")
    np.testing.assert_allclose(frames_at(terms, found, FEET).p, feet.p, atol=1e-4)
    np.testing.assert_allclose(frames_at(terms, found).p[0], goal, atol=1.1e-3)
    assert abs(found[2] - pelvis[2]) < 0.01


def test_inverse_kinematics_names_what_it_cannot_keep(planner):
    robot, q = DrakeRobot(planner.wrist_pos), planner.start_q
    ik = KeyframeIk(robot)
    feet = frames_at(planner.terms, q, FEET)
    ik.place("left_ankle_roll_link", np.zeros(3), feet.p[0], feet.R[0], "foot on the floor")
    ik.within("left_wrist_yaw_link", robot.hand_m[0], [3.0, 0.0, 0.0], [3.1, 1.0, 1.0], "hand three metres ahead")
    with pytest.raises(
        PickInfeasible, match="far away: .*(hand three metres ahead|foot on the floor).* is violated by"
    ):
        ik.solve(q, "far away")


@pytest.fixture(scope="module")
def program():
    """Knots whose second joint must lie above θ."""
    import casadi as cs

    x, theta = cs.SX.sym("x", NX), cs.SX.sym("theta", 1)
    soft, hard = cs.Function("soft", [x, theta], [0.0 * x]), cs.Function("hard", [x, theta], [x[7] - theta])
    return PathProgram(3, soft, hard, ("height above the bar",))


def knots(**change):
    numbers = {
        "ends": np.stack([np.zeros(NX), np.ones(NX)]),
        "guess": np.zeros((3, NX)),
        "theta": np.full((3, 1), -9.0),
        "low": np.zeros((3, 1)),
        "high": np.full((3, 1), np.inf),
        "joint_low": np.full(20, -2.0),
        "joint_high": np.full(20, 2.0),
        "step": np.full(20, 0.5),
    }
    return Knots(**numbers | change)


def test_paths_are_straight_where_nothing_hinders(program):
    np.testing.assert_allclose(program.solve(knots(), "a line"), np.linspace(0, 1, 5)[:, None] * np.ones(NX), atol=1e-5)


def test_paths_keep_bounds_and_bend_little(program):
    path = program.solve(knots(theta=np.array([[-9.0], [0.9], [-9.0]])), "a hill")
    assert path[2, 7] == pytest.approx(0.9, abs=1e-4)
    np.testing.assert_allclose(path[:, 6], np.linspace(0, 1, 5), atol=1e-5)
    assert (np.abs(np.diff(path[:, 6:], axis=0)) < 0.5 + 1e-6).all()


@pytest.mark.parametrize(
    "change, message",
    [
        (
            {"theta": np.array([[-9.0], [0.9], [-9.0]]), "joint_high": np.full(20, 0.7)},
            "height above the bar is violated by 0.200 at knot 2 of 3",
        ),
        ({"step": np.full(20, 0.1)}, "joint speed is violated by"),
    ],
)
def test_paths_name_what_they_cannot_keep(program, change, message):
    with pytest.raises(PickInfeasible, match=f"no path for the test: {message}"):
        program.solve(knots(**change), "the test")


def test_the_same_pick_is_planned_once(planner, plan, monkeypatch):
    """From the cache: equal to the bit, also for what differs by less than the cache tells apart."""
    monkeypatch.setattr(Planner, "_solve", lambda self, task: pytest.fail("planned again"))
    again = Planner(BOX, SUPPORT, folder=planner.folder).plan(planner.start_q, PLACE + 1e-6, QUAT)
    for name, value in vars(plan).items():
        np.testing.assert_array_equal(getattr(again, name), value)


def key(planner, durations=None, q=None, p=PLACE, quat=QUAT):
    task = PickTask.of(planner.grip, planner.terms, planner.start_q if q is None else q, p, quat)
    return cache.plan_key(task, durations or Durations())


def test_the_key_holds_all_that_decides(planner, monkeypatch):
    nudge = planner.start_q + np.concatenate([[0.01], np.zeros(26)])
    keys = [
        key(planner),
        key(planner, q=nudge),
        key(planner, p=PLACE + 0.001),
        key(planner, quat=np.asarray(quat_from_yaw(0.2))),
        key(planner, Durations(lift_s=2.0)),
        key(Planner(replace(BOX, mass_kg=1.6), SUPPORT)),
        key(Planner(Box((0.27, 0.28, 0.28), 1.5), SUPPORT)),
        key(Planner(BOX, replace(SUPPORT, top_m=0.53))),
        key(Planner(BOX, replace(SUPPORT, near_m=0.25))),
    ]
    monkeypatch.setattr(cache, "_planner", lambda: "another robot or solver")
    keys.append(key(planner))
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 not a plan", None])
def test_a_damaged_file_is_planned_again(planner, plan, tmp_path, damage):
    cache.save(tmp_path, "some", plan)
    path = tmp_path / "some.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if damage is None else damage)
    with pytest.warns(cache.BrokenPlanFile, match="damaged"):
        assert cache.load(tmp_path, "some") is None
    assert cache.load(tmp_path, "other") is None


def with_joint(path, value, joint=6):
    out = path.copy()
    out[-1, 7 + joint] = value
    return out


@pytest.mark.parametrize(
    "damage, message",
    [
        (lambda p: {"to_grasp": with_joint(p.to_grasp, 1e9)}, "to_grasp has right_hip_pitch_joint at 1e\\+09 rad"),
        (lambda p: {"to_crouch": with_joint(p.to_crouch, np.nan)}, "to_crouch has shape"),
        (lambda p: {"to_pregrasp": p.to_pregrasp[:0]}, "to_pregrasp has shape"),
        (lambda p: {"retreat": p.retreat[:, :26]}, "retreat has shape"),
        (lambda p: {"retreat": p.retreat * ([1.0] * 3 + [0.0] * 4 + [1.0] * 20)}, "pelvis' turn in retreat has a quat"),
        (lambda p: {"to_grasp": np.array(0.0)}, "to_grasp has shape"),
        (lambda p: {"p_OH": p.p_OH[0]}, "p_OH has shape"),
        (lambda p: {"p_HO": p.p_HO[:, :2]}, "p_HO has shape"),
        (lambda p: {"hand_point": p.hand_point.astype(complex)}, "hand_point has shape"),
        (lambda p: {"p_GO": p.p_GO[:2]}, "p_GO has shape"),
        (lambda p: {"quat_GO": np.zeros(4)}, "quat_GO has a quaternion of length 0"),
        (lambda p: {"lift_knots": 0}, "lift_knots is 0: 1 to 13"),
        (lambda p: {"lift_knots": 14}, "lift_knots is 14: 1 to 13"),
        (lambda p: {"back_m": -0.1}, "back_m is -0.1"),
    ],
)
def test_a_file_that_holds_no_plan_is_planned_again(planner, plan, tmp_path, damage, message):
    content = vars(plan) | damage(plan)
    with pytest.raises(ValueError, match=message):
        PickPlan(**content)
    np.savez(tmp_path / "some.npz", **content)
    with pytest.warns(cache.BrokenPlanFile, match="damaged"):
        assert cache.load(tmp_path, "some") is None


def test_a_start_beyond_the_range_of_a_joint_is_refused(planner):
    """Before the plan is made, and with the joint's name."""
    start = planner.start_q.copy()
    start[7] = 3.5
    with pytest.raises(
        PickInfeasible, match="q_start has left_hip_pitch_joint .* rad beyond its range: at most 0.1 rad"
    ):
        planner.plan(start, PLACE, QUAT)


NOT_HASHED = {
    "hotice.archives": "refuses files, changes no plan",
    "hotice.caches": "where plans are kept",
    "hotice.checks": "refuses numbers, changes none",
    "hotice.compiled": "the same mathematics, compiled",
    "hotice.control.controller": "Terms.update reads a Measurement; plans are made of configurations",
    "hotice.errors": "an infeasible pick leaves no plan",
    "hotice.model.joint_limits": "refuses postures, changes none",
    "hotice.files": "how a plan is written, not what it is",
    "hotice.model.scene": "obstacles: the planner's models have none",
}
"""Modules that the planner imports and that may change without a plan becoming stale."""


def sources_of(name: str) -> set[str]:
    """Modules of the package that a module imports, anywhere in it; names from a package's face by where they live."""
    package = Path(hotice.__file__).parent

    def file_of(module: str) -> Path | None:
        path = package.parent.joinpath(*module.split("."))
        return next((f for f in (path / "__init__.py", path.with_suffix(".py")) if f.is_file()), None)

    def imports(module: str) -> list[tuple[str, str]]:
        nodes = ast.walk(ast.parse(file_of(module).read_text(encoding="utf-8")))
        return [(n.module or "", a.name) for n in nodes if isinstance(n, ast.ImportFrom) for a in n.names]

    def home(module: str, name: str) -> str:
        if file_of(f"{module}.{name}"):
            return f"{module}.{name}"
        if file_of(module).name == "__init__.py":
            return next(home(*found) for found in imports(module) if found[1] == name)
        return module

    return {home(*found) for found in imports(name) if found[0].startswith("hotice")}


def test_the_key_holds_every_source_that_decides():
    """What the planner imports, and what that imports, is hashed or there is a reason why not."""
    package = Path(hotice.__file__).parent
    hashed = {".".join(("hotice", *f.relative_to(package).with_suffix("").parts)) for f in cache.SOURCES}
    todo, seen = ["hotice.control.pick_plan.planner"], set()
    while todo:
        name = todo.pop()
        if name not in seen | NOT_HASHED.keys():
            seen.add(name)
            todo += sources_of(name)
    assert seen <= hashed, f"plans would outlive a change of {', '.join(sorted(seen - hashed))}"
    assert "hotice.control.pick_plan.paths.nlp" in seen and "hotice.model.carry" in seen
    assert all(any(reason in sources_of(name) for name in seen) for reason in NOT_HASHED), "an entry without a use"
    assert all(name in seen for name in hashed if not name.endswith("__init__")), "hashed, but not imported"


def test_the_cache_keeps_the_newest(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "MOST_FILES", 2)
    import os

    for i, name in enumerate("abc"):
        cache.save(tmp_path, name, plan)
        os.utime(tmp_path / f"{name}.npz", (i, i))
    cache.save(tmp_path, "d", plan)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.npz", "d.npz"]


def test_plans_are_kept_by_content_of_the_task(planner, plan):
    """A plan serves where feet and object are where they were, and nowhere else."""
    q = planner.start_q
    assert planner.fits(plan, q, PLACE + [0.002, 0.0, 0.0], QUAT)
    assert not planner.fits(plan, q, PLACE + [0.01, 0.0, 0.0], QUAT)
    assert not planner.fits(plan, q, PLACE, np.asarray(quat_from_yaw(0.15)))
    assert not planner.fits(plan, q + np.concatenate([[0.02], np.zeros(26)]), PLACE, QUAT)


@pytest.mark.parametrize(
    "place, why",
    [
        ([0.39, 0.02, np.nan], "p_GO holds numbers that are not finite"),
        ([1.4, 0.0, 0.66], "x 1.40.*cannot be grasped standing; stand nearer.*is violated by"),
        ([0.39, 0.6, 0.66], "y 0.60.*cannot be grasped standing"),
    ],
)
def test_picks_that_cannot_be_planned(planner, place, why):
    assert issubclass(PickInfeasible, HoticeError)
    with pytest.raises(PickInfeasible, match=why):
        planner.plan(planner.start_q, place, QUAT)


def test_a_cached_plan_costs_neither_drake_nor_casadi(planner, plan):
    code = (
        "import sys, numpy as np\n"
        "from hotice.control.pick_plan import Planner, Support\n"
        "from hotice.model import Box\n"
        f"box, support = Box({BOX.size_m}, {BOX.mass_kg}), Support(top_m=0.52, near_m=0.24)\n"
        f"p = Planner(box, support, folder={str(planner.folder)!r})\n"
        f"p.plan(p.start_q, {PLACE.tolist()}, {QUAT.tolist()})\n"
        "assert not {'pydrake', 'casadi', 'adam'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize(
    "size, mass, top, aside, yaw",
    [
        ((0.33, 0.34, 0.30), 1.4, 0.59, -0.03, 15.0),
        ((0.26, 0.37, 0.22), 2.7, 0.52, -0.03, 10.0),
    ],
    ids=["deep", "wide"],
)
def test_the_grasp_leads_to_the_carry_state(size, mass, top, aside, yaw):
    """A box turned and aside ends level before an upright pelvis, near its place: the hold was chosen for that."""
    planner = Planner(Box(size, mass), Support(top_m=top, near_m=0.24), folder=None)
    turn = np.radians(yaw)
    ahead = 0.26 + 0.5 * (size[0] * np.cos(turn) + size[1] * np.sin(turn))
    plan = planner.plan(planner.start_q, [ahead, aside, top + size[2] / 2], quat_from_yaw(turn))
    (grasp, q), t = (plan.grasp, plan.retreat[-1]), planner.terms
    before, after = frames_at(t, grasp), frames_at(t, q)
    R_GO = after.R[0] @ before.R[0].T @ np.asarray(quat_to_mat(plan.quat_GO))
    p_GO = after.p.mean(axis=0) - R_GO @ plan.p_OH.mean(axis=0)
    assert np.linalg.norm(p_GO - planner.carry.object_pos_W) < 0.055
    np.testing.assert_allclose(pin.rpy.matrixToRpy(R_GO), 0.0, atol=np.radians(2.0))
    np.testing.assert_allclose(pin.rpy.matrixToRpy(pin.Quaternion(q[3:7]).matrix()), 0.0, atol=np.radians(1.5))
    assert q[2] == pytest.approx(planner.carry.root_pos_W[2], abs=0.005)


def test_rows_of_grasp_and_carry_have_their_jacobian(planner):
    """By central differences, at a configuration where nothing fits."""
    task = PickTask.of(planner.grip, planner.terms, planner.start_q, PLACE, QUAT)
    problem, rng = together._Problem(Guess(planner.terms, task)), np.random.default_rng(2)
    x, step = 0.02 * rng.standard_normal(together.N), 1e-6
    _, J = problem.rows(x, *together.EXACT)
    for k in rng.choice(together.N, 12, replace=False).tolist() + list(range(2 * 26, together.N)):
        off = step * np.eye(together.N)[k]
        (a, _), (b, _) = (problem.rows(x + s * off, *together.EXACT) for s in (1.0, -1.0))
        np.testing.assert_allclose(J[:, k], (a - b) / (2 * step), atol=0.05 * (1.0 + np.abs(J[:, k]).max()))


@pytest.mark.parametrize("off", [0.0, 0.07])
def test_straight_palms_beside_a_cylinder_have_their_gaps(off):
    """In closed form: front of the palms at the widest, rear off by what the circle falls away."""
    cylinder = Cylinder(0.15, 0.3, 1.0)
    grip = Grip(carried=cylinder, support=SUPPORT)
    points = grip.place[0] + [0.0, off, 0.0] + PALM_POINTS_M
    distance, _ = surface_distance(cylinder, points)
    np.testing.assert_allclose(distance - PALM_RADIUS_M, grip.gaps_m(off), atol=1e-12)
    assert grip.gaps_m(off)[PALM_POINTS_M[:, 0] > 0] == pytest.approx(off)


def test_a_sphere_is_held_below_its_centre_by_both_of_a_pair():
    sphere = Sphere(0.15, 1.5)
    planner = Planner(sphere, SUPPORT, folder=None)
    place = np.array([0.42, 0.01, 0.52 + 0.15])
    plan, t = planner.plan(planner.start_q, place, [1.0, 0.0, 0.0, 0.0]), planner.terms
    hands = frames_at(t, plan.grasp)
    for i in range(2):
        points = hands.p[i] + PALM_POINTS_M @ hands.R[i].T - place
        gaps = np.linalg.norm(points, axis=1) - 0.15 - PALM_RADIUS_M
        front = PALM_POINTS_M[:, 0] > 0
        np.testing.assert_allclose(gaps[front], 0.0, atol=0.001)
        assert (gaps[~front] > 0.005).all()
        assert points[front].mean(axis=0)[2] < -0.005
        assert abs(points[front].mean(axis=0)[0]) < 0.012
