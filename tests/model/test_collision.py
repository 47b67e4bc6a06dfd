"""Distances from Pinocchio and coal against python-fcl on MuJoCo's kinematics, finite differences and closed forms."""

import mujoco
import numpy as np
import pytest

from hotice.errors import HoticeError, InvalidState, UnknownName
from hotice.model import Box, Obstacle, Scene, builder, frames, g1
from hotice.model.carry import solve_carry
from hotice.model.collision import CollisionChecker
from hotice.model.collision_geometry import GRASP, KINDS, OBJECT_OBSTACLE, ROBOT_OBJECT, ROBOT_OBSTACLE, SELF
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.model.objects import Cylinder, Sphere
from hotice.model.robot_state import RobotState

pin = pytest.importorskip("pinocchio")
fcl = pytest.importorskip("fcl")
OBJECTS = (Box((0.3, 0.3, 0.3), 1.0), Cylinder(0.13, 0.3, 1.5), Sphere(0.14, 1.2))
STATES = 30


def unit(q):
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def clutter(rng):
    """Two obstacles of each primitive, some of them in the way."""
    shapes = [BoxShape((0.3, 0.2, 0.5)), CylinderShape(0.1, 0.4), CapsuleShape(0.08, 0.3), SphereShape(0.15)]
    return Scene(
        "clutter",
        ((-2, -2, 0), (2, 2, 2)),
        (-1.9, -1.9, 0),
        (1.9, 1.9),
        tuple(
            Obstacle(f"o{i}", "side", shapes[i % 4], tuple(rng.uniform([-0.6, -0.6, 0.1], [0.9, 0.9, 1.3])), quat)
            for i, quat in enumerate(map(tuple, unit(rng.normal(size=(8, 4)))))
        ),
    )


def random_qpos(carry, rng, joints=20):
    qpos, _ = RobotState.from_carry(carry).to_mujoco(joints)
    qpos[7 : 7 + joints] += rng.uniform(-0.3, 0.3, joints)
    for start in (0, 7 + joints):
        qpos[start : start + 2] += rng.uniform(-0.3, 0.3, 2)
        qpos[start + 3 : start + 7] = unit(qpos[start + 3 : start + 7] + 0.2 * rng.normal(size=4))
    return qpos


@pytest.fixture(scope="module")
def carries():
    return [solve_carry(o) for o in OBJECTS]


THIN = 1e-7


class Oracle:
    """python-fcl at the places where MuJoCo's kinematics puts the geoms of the whole model.

    Its distances to spheres and capsules err by up to 3e-4 m, those to their centres and axes (as thin boxes) do not.
    """

    def __init__(self, carry, scene):
        self.model = builder.build_model(carry.carried, scene, wrist_pos=carry.wrist_pos, floor=False)
        self.data = mujoco.MjData(self.model)
        self.things = {}
        for i in range(self.model.ngeom):
            kind, size = self.model.geom_type[i], self.model.geom_size[i]
            if kind == mujoco.mjtGeom.mjGEOM_BOX:
                shape = core = fcl.Box(*(2 * size))
            elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
                shape = core = fcl.Cylinder(size[0], 2 * size[1])
            elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
                shape, core = fcl.Capsule(size[0], 2 * size[1]), fcl.Box(THIN, THIN, 2 * size[1])
            else:
                shape, core = fcl.Sphere(size[0]), fcl.Box(THIN, THIN, THIN)
            radius = 0.0 if shape is core else size[0]
            self.things[self.model.geom(i).name] = (i, fcl.CollisionObject(shape), fcl.CollisionObject(core), radius)

    def place(self, qpos):
        self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        for i, *objects, _ in self.things.values():
            for thing in objects:
                thing.setTransform(fcl.Transform(self.data.geom_xmat[i].reshape(3, 3), self.data.geom_xpos[i]))

    def distance(self, a, b):
        (*_, core_a, radius_a), (*_, core_b, radius_b) = self.things[a], self.things[b]
        return fcl.distance(core_a, core_b, fcl.DistanceRequest(), fcl.DistanceResult()) - radius_a - radius_b

    def collide(self, a, b):
        return fcl.collide(self.things[a][1], self.things[b][1], fcl.CollisionRequest(), fcl.CollisionResult()) > 0


@pytest.mark.parametrize("index", range(len(OBJECTS)), ids=lambda i: OBJECTS[i].shape)
def test_agrees_with_fcl(carries, index):
    """Over all pairs of primitives: gaps to 1e-4 m, and who collides wherever the depth is no hair's breadth.

    Both measure between points of the two bodies, so an iteration that ends early errs upwards: in fcl some do at the
    rims of cylinders.
    """
    rng = np.random.default_rng(index)
    scene, carry = clutter(rng), carries[index]
    checker, oracle = CollisionChecker(scene, carry.carried, kinds=KINDS), Oracle(carry, scene)
    round_rim = {"object"} if isinstance(carry.carried, Cylinder) else set()
    round_rim |= {f"obstacle/{o.name}" for o in scene.obstacles if o.shape.type == "cylinder"}
    more, rims, overlaps = [], [], 0
    for _ in range(STATES):
        qpos = random_qpos(carry, rng)
        oracle.place(qpos)
        report = checker.query(RobotState.from_mujoco(qpos, carried=carry.carried, wrist_pos=carry.wrist_pos))
        for row in np.union1d(report.closest(60), rng.choice(len(report.distance), 60)):
            a, b = report.names[row]
            if report.distance[row] > 1e-4:
                more.append(oracle.distance(a, b) - report.distance[row])
                rims.append(not round_rim.isdisjoint((a, b)))
            elif report.distance[row] < -1e-4:
                assert oracle.collide(a, b), (a, b)
                overlaps += report.kind[row] in (ROBOT_OBSTACLE, OBJECT_OBSTACLE)
    more, rims = np.array(more), np.array(rims)
    assert overlaps > 20 and rims.sum() > 100 and (~rims).sum() > 100
    assert more.min() > -2e-6
    assert more[~rims].max() < 1e-4
    assert np.quantile(more[rims], 0.99) < 1e-4 and more[rims].max() < 1e-3


def test_axes_of_round_links_are_as_far_as_the_scene_says(carries):
    """Capsules and spheres of the robot by the exact signed distance along their axes, cylinders and boxes included."""
    rng = np.random.default_rng(4)
    scene, carry = clutter(rng), carries[0]
    checker, model = CollisionChecker(scene, kinds=(ROBOT_OBSTACLE,)), Oracle(carry, scene)
    along = np.linspace(-1.0, 1.0, 2001)[:, None]
    compared = 0
    for _ in range(5):
        qpos = random_qpos(carry, rng)
        model.place(qpos)
        state = RobotState.from_mujoco(qpos, carried=carry.carried, wrist_pos=carry.wrist_pos)
        report = checker.query(state)
        for row in report.closest(100):
            name, other = report.names[row]
            i, radius = model.things[name][0], model.things[name][3]
            if radius == 0.0 or report.distance[row] < 1e-4:
                continue
            half = model.model.geom_size[i, 1]
            axis = model.data.geom_xpos[i] + along * half * model.data.geom_xmat[i].reshape(3, 3)[:, 2]
            obstacle = next(o for o in scene.obstacles if other == f"obstacle/{o.name}")
            exact = obstacle.signed_distance(axis).min() - radius
            assert report.distance[row] == pytest.approx(exact, abs=1e-5), (name, other)
            compared += 1
    assert compared > 200


def test_depth_of_spheres_and_boxes_in_closed_form():
    """A ball of 0.14 m radius against a ball, the face of a box and the side of a capsule, apart and pressed in."""
    ball, capsule_axis = Sphere(0.14, 1.0), 0.3
    obstacles = (
        Obstacle("ball", "side", SphereShape(0.1), (3.0, 0, 0.5)),
        Obstacle("box", "side", BoxShape((1, 1, 1)), (0, 3.0, 0.5)),
        Obstacle("capsule", "side", CapsuleShape(0.05, capsule_axis), (-3.0, 0, 0.5)),
    )
    scene = Scene("s", ((-4, -4, 0), (4, 4, 2)), (0, 0, 0), (1, 1), obstacles)
    checker = CollisionChecker(scene, ball, kinds=(OBJECT_OBSTACLE,))
    for gap in (0.2, 0.01, -0.01, -0.05):
        for row, (place, out, reach) in enumerate(
            [((3, 0, 0.5), (1, 0, 0), 0.1), ((0, 3, 0.5), (0, 1, 0), 0.5), ((-3, 0, 0.5), (0, 1, 0), 0.05)]
        ):
            p_WO = np.array(place) + np.array(out) * (reach + 0.14 + gap)
            report = checker.query(RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29), carried=ball, p_WO=p_WO))
            assert report.names[row] == ("object", f"obstacle/{obstacles[row].name}")
            assert report.distance[row] == pytest.approx(gap, abs=1e-6)
            np.testing.assert_allclose(report.normal_W[row], -np.array(out), atol=1e-4)
            np.testing.assert_allclose(report.p_WA[row], p_WO - 0.14 * np.array(out), atol=1e-4)


@pytest.mark.parametrize("joints", [20, 29])
def test_jacobian_is_the_slope_of_the_distance(carries, joints):
    rng = np.random.default_rng(joints)
    checker = CollisionChecker(clutter(rng), carries[0].carried, joints, kinds=KINDS)
    state = RobotState.from_mujoco(random_qpos(carries[0], rng, joints), carried=carries[0].carried)
    report = checker.query(state)
    apart = np.flatnonzero(np.abs(report.distance) > 1e-3)
    rows = rng.choice(apart, 300, replace=False)
    jacobian = report.jacobian(rows)
    assert jacobian.shape == (300, 6 + joints + 6)
    model = pin.buildModelFromMJCF(g1.xml_path())
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "object")
    index = [*range(6), *(6 + g1.ALL_JOINTS.index(j) for j in (g1.ACTION_JOINTS if joints == 20 else g1.ALL_JOINTS))]
    q, step = state.to_pinocchio()[0], 1e-5
    slope = np.empty_like(jacobian)
    for n, column in enumerate([*index, *range(35, 41)]):
        v = np.zeros(41)
        v[column] = step
        ahead, behind = (checker.query(from_pinocchio(pin.integrate(model, q, s * v), state)).distance for s in (1, -1))
        slope[:, n] = (ahead - behind)[rows] / (2 * step)
    error = np.abs(slope - jacobian).max(axis=1)
    assert np.quantile(error, 0.95) < 1e-4  # the rest has edges and parallel faces, where the witness jumps
    np.testing.assert_array_equal(report.jacobian(rows[:3]), jacobian[:3])


def from_pinocchio(q, state):
    return RobotState(
        p_WP=q[:3],
        quat_WP=np.roll(q[3:7], 1),
        joint_pos=q[7:36],
        carried=state.carried,
        p_WO=q[36:39],
        quat_WO=np.roll(q[39:], 1),
    )


def test_witness_points_span_the_distance(carries):
    rng = np.random.default_rng(5)
    report = CollisionChecker(clutter(rng), OBJECTS[0], kinds=KINDS).query(
        RobotState.from_mujoco(random_qpos(carries[0], rng), carried=OBJECTS[0], wrist_pos=carries[0].wrist_pos)
    )
    np.testing.assert_allclose(np.linalg.norm(report.normal_W, axis=1), 1.0, atol=1e-9)
    np.testing.assert_allclose(report.p_WA + report.distance[:, None] * report.normal_W, report.p_WB, atol=1e-5)
    order = report.closest(len(report.distance))
    assert (np.diff(report.distance[order]) >= 0).all()
    assert set(report.colliding) == set(np.flatnonzero(report.distance < 0))
    assert (report.kind[report.closest(4, SELF)] == SELF).all()
    assert str(report).count("mm") == 5


def test_a_later_query_does_not_change_an_earlier_report(carries):
    checker = CollisionChecker(clutter(np.random.default_rng(6)), OBJECTS[0])
    states = [
        RobotState.from_carry(carries[0]),
        RobotState(p_WP=np.ones(3), joint_pos=np.zeros(29), carried=OBJECTS[0]),
    ]
    first, second = (checker.query(s) for s in states)
    fresh = checker.query(states[0])
    np.testing.assert_allclose(first.distance, fresh.distance, atol=1e-7)
    assert np.abs(first.distance - second.distance).max() > 0.1
    np.testing.assert_allclose(first.p_WA, fresh.p_WA, atol=1e-4)
    np.testing.assert_allclose(first.p_WB - first.p_WA, first.distance[:, None] * first.normal_W, atol=1e-5)


def test_carrying_is_no_collision(carries):
    """Hands touch the object by design and are listed apart; no link strikes another."""
    for carry in carries:
        report = CollisionChecker(None, carry.carried, kinds=KINDS).query(RobotState.from_carry(carry))
        assert (report.distance[report.kind == SELF] > 0).all()
        palms = [row for row in np.flatnonzero(report.kind == GRASP) if "_palm_" in report.names[row][0]]
        assert np.abs(report.distance[palms]).max() < 2e-3
        assert report.distance[report.kind == ROBOT_OBJECT].min() > -2e-3
    assert GRASP not in CollisionChecker(None, OBJECTS[0]).kind


@pytest.mark.parametrize("joints", [20, 29])
def test_self_collision(joints):
    checker = CollisionChecker(joints=joints)
    stand = RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29))
    assert checker.query(stand).distance.min() > -0.005  # arms that hang straight down graze the torso
    crossed = np.zeros(29)
    for side in g1.SIDES:
        crossed[g1.ALL_JOINTS.index(f"{side}_hip_roll_joint")] = -0.4 if side == "left" else 0.4
    report = checker.query(RobotState(p_WP=np.zeros(3), joint_pos=crossed))
    deepest = report.colliding[0]
    assert report.distance[deepest] < -0.03
    assert {name.split("_")[0] for name in report.names[deepest]} == {"left", "right"}


def mesh_scene(shape):
    low = ((-2, -2, 0), (2, 2, 2))
    return Scene(
        "mesh", low, (-1.9, -1.9, 0), (1.9, 1.9), (Obstacle("m", "side", shape, (0.5, 0.2, 0.8), (0.8, 0, 0.6, 0)),)
    )


def test_a_mesh_box_is_as_far_as_a_box(tmp_path, carries):
    import trimesh

    trimesh.creation.box((0.3, 0.4, 0.5)).export(tmp_path / "box.obj")
    rng = np.random.default_rng(7)
    checkers = [
        CollisionChecker(mesh_scene(s), OBJECTS[2], kinds=(ROBOT_OBSTACLE, OBJECT_OBSTACLE))
        for s in (MeshShape("box.obj", 1.0, tmp_path), BoxShape((0.3, 0.4, 0.5)))
    ]
    overlaps = 0
    for _ in range(20):
        qpos = random_qpos(carries[2], rng)
        state = RobotState.from_mujoco(qpos, carried=OBJECTS[2], wrist_pos=carries[2].wrist_pos)
        mesh, box = (c.query(state) for c in checkers)
        apart = box.distance > 1e-5
        np.testing.assert_allclose(mesh.distance[apart], box.distance[apart], atol=1e-5)
        assert (mesh.distance[~apart] < 1e-5).all()
        overlaps += (~apart).sum()
    assert overlaps > 20


def test_inside_a_mesh_counts_as_collision(tmp_path):
    """A ball in the middle of a solid cube: minus the distance to its faces, and the way out leads through the
    nearest."""
    import trimesh

    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "cube.obj")
    ball = Sphere(0.1, 1.0)
    obstacle = Obstacle(
        "cube", "side", MeshShape("cube.obj", 1.0, tmp_path), (0, 0, 2.5), tuple(frames.quat_from_yaw(0.3))
    )
    scene = Scene("s", ((-4, -4, 0), (4, 4, 4)), (2, 2, 0), (3, 3), (obstacle,))
    checker = CollisionChecker(scene, ball, kinds=(OBJECT_OBSTACLE,))
    report = checker.query(
        RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29), carried=ball, p_WO=np.array([0, 0, 2.7]))
    )
    assert report.distance[0] == pytest.approx(-0.2, abs=1e-6)
    np.testing.assert_allclose(report.normal_W[0], [0, 0, -1], atol=1e-6)
    assert report.jacobian()[0, -4] == pytest.approx(1.0, abs=1e-6)  # up is out
    far = checker.query(RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29), carried=ball, p_WO=np.array([0, 0, 3.4])))
    assert far.distance[0] == pytest.approx(0.3, abs=1e-6)
    assert (CollisionChecker(scene, kinds=(SELF,)).query(far.state).kind == SELF).all()


def test_errors():
    with pytest.raises(UnknownName, match="kind of pairs 'hands'"):
        CollisionChecker(kinds=("hands",))
    with pytest.raises(HoticeError, match="12 joints"):
        CollisionChecker(joints=12)
    checker = CollisionChecker(None, OBJECTS[0])
    with pytest.raises(InvalidState, match="carries no object"):
        checker.query(RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29)))
    empty = CollisionChecker(Scene("empty"), kinds=(ROBOT_OBSTACLE,))
    report = empty.query(RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29)))
    assert report.distance.shape == (0,) and report.p_WA.shape == (0, 3) and report.jacobian().shape == (0, 26)
    with pytest.raises(UnknownName, match="kind of pairs"):
        report.closest(3, "hands")
