"""Exact distances between robot, carried object and obstacles, by Pinocchio and coal.

Where `CollisionReport.distance` is positive it is the gap, where negative the penetration depth: the shortest
translation that parts the two. A mesh is its surface: a geometry that pokes through it has the depth of the deepest
triangle, and one wholly inside gets minus its distance to the surface, which is less than what would part them.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter, methodcaller
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hotice.errors import UnknownName
from hotice.model import builder
from hotice.model.collision_geometry import GRASP, KINDS, SELF, geometry_model, pair_table, robot_geoms
from hotice.model.frames import quat_to_mat
from hotice.model.kinematics import Kinematics
from hotice.model.objects import CarriedObject
from hotice.model.robot_state import RobotState
from hotice.model.scene import Obstacle, Scene

if TYPE_CHECKING:
    import pinocchio

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
GJK_TOLERANCE = 1e-8
"""Relative, of distances; coal's 1e-6 leaves normals of cylinders a few percent off."""
_DISTANCE, _NORMAL = attrgetter("min_distance"), attrgetter("normal")
_ON_A, _ON_B = methodcaller("getNearestPoint1"), methodcaller("getNearestPoint2")


@dataclass(frozen=True, eq=False)
class CollisionReport:
    """Distances of P pairs (A, B) in one state; witness points are worked out when first asked for.

    Attributes:
        distance: (P,) [m], negative where A and B overlap.
    """

    checker: CollisionChecker
    state: RobotState
    distance: Array

    @property
    def names(self) -> tuple[tuple[str, str], ...]:
        """Names of A and B of each pair: geometries of g1.xml, `object`, `obstacle/<name>`."""
        return self.checker.names

    @property
    def kind(self) -> NDArray[np.str_]:
        """(P,) one of `collision_geometry.KINDS`."""
        return self.checker.kind

    @property
    def p_WA(self) -> Array:
        """(P, 3) the point of A nearest to B, or deepest in it, in W [m]."""
        return self._witness[0]

    @property
    def p_WB(self) -> Array:
        """(P, 3) the same of B: p_WA + distance * normal_W."""
        return self._witness[1]

    @property
    def normal_W(self) -> Array:
        """(P, 3) unit vectors from A to B: moving B along them increases the distance."""
        return self._witness[2]

    @property
    def colliding(self) -> Rows:
        """Rows of the pairs that overlap, deepest first."""
        return self.closest(int((self.distance < 0).sum()))

    def closest(self, count: int, kind: str | None = None) -> Rows:
        """Rows of the `count` smallest distances, ascending; of one kind of pairs only, where given.

        Raises `UnknownName`.
        """
        if kind is not None and kind not in KINDS:
            raise UnknownName("kind of pairs", kind, KINDS)
        rows = np.arange(len(self.distance)) if kind is None else np.flatnonzero(self.kind == kind)
        return rows[np.argsort(self.distance[rows], kind="stable")[:count]]

    def jacobian(self, rows: Rows | None = None) -> Array:
        """d(distance)/dv of the given rows (default all), (R, nv).

        v: twist of the pelvis in its own frame (linear, angular), the 20 or 29 joints, twist of the object in its
            frame.
        """
        rows = np.arange(len(self.distance)) if rows is None else np.asarray(rows)
        return self.checker._jacobian(self.state, rows, self.p_WA[rows], self.normal_W[rows])

    @cached_property
    def _witness(self) -> tuple[Array, Array, Array]:
        return self.checker._witness(self.state)

    def __str__(self) -> str:
        lines = [f"{len(self.distance)} pairs, {len(self.colliding)} overlap"]
        for row in self.closest(5):
            a, b = self.names[row]
            lines.append(f"{1e3 * self.distance[row]:8.1f} mm  {self.kind[row]:15s} {a} - {b}")
        return "\n".join(lines)


class CollisionChecker:
    """Every geometry of the robot against object, obstacles and itself.

    Links that share a joint, and links two joints apart that touch at zero angles (as in an ankle), are no pair.
    Working memory is shared by all queries: use one checker per thread.

    Args:
        scene: obstacles, if any. carried: the object, if any.
        joints: 20 (waist and wrists locked) or 29; decides self-collision pairs and the columns of Jacobians.
        kinds: of pairs to test, of `collision_geometry.KINDS`; by default all but `grasp`, the contact of hands and
            object.

    Raises:
        UnknownName: a kind that does not exist.
        HoticeError: another number of joints, a mesh that cannot be read.
    """

    def __init__(
        self,
        scene: Scene | None = None,
        carried: CarriedObject | None = None,
        joints: int = 20,
        kinds: Collection[str] = tuple(k for k in KINDS if k != GRASP),
    ) -> None:
        for kind in kinds:
            if kind not in KINDS:
                raise UnknownName("kind of pairs", kind, KINDS)
        robot = robot_geoms(joints)
        self._kinematics = Kinematics(carried is not None)
        self._columns = self._kinematics.columns(joints)
        self._geometry = geometry_model(scene, carried, robot, self._kinematics)
        obstacles = scene.obstacles if scene is not None else ()
        pairs = [p for p in pair_table(robot, carried is not None, len(obstacles)) if p[2] in kinds]
        self._prepare(pairs)
        rest = self._compute(RobotState(p_WP=np.zeros(3), joint_pos=np.zeros(29), carried=carried))
        self._prepare(
            [
                (a, b, kind)
                for (a, b, kind), distance in zip(pairs, rest, strict=True)
                if not (kind == SELF and distance < 0 and robot[a].joints_to(robot[b]) == 2)
            ]
        )
        names = [g.name for g in self._geometry.geometryObjects]
        self.names = tuple((names[p.first], names[p.second]) for p in self._geometry.collisionPairs)
        self._meshes = self._mesh_rows(obstacles)

    def query(self, state: RobotState) -> CollisionReport:
        """Distances of all pairs. Raises `InvalidState` when the object is missing."""
        distance = self._compute(state)
        for obstacle, rows in self._meshes:
            distance[rows[self._inside(obstacle, rows)]] *= -1.0
        return CollisionReport(self, state, distance)

    @property
    def geometry(self) -> tuple[pinocchio.GeometryModel, Sequence[pinocchio.SE3]]:
        """Pinocchio's geometries and pairs, and the poses X_WG of the geometries in the state queried last."""
        return self._geometry, self._scratch.oMg

    def _prepare(self, pairs: list[tuple[int, int, str]]) -> None:
        import pinocchio as pin

        self._geometry.removeAllCollisionPairs()
        for a, b, _ in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self.kind = np.array([kind for *_, kind in pairs], dtype=np.str_)
        objects = self._geometry.geometryObjects
        self._joint = np.array([[objects[i].parentJoint for i in p[:2]] for p in pairs], dtype=np.int64).reshape(-1, 2)
        self._scratch = self._geometry.createData()
        for request in self._scratch.distanceRequests:
            request.gjk_tolerance = GJK_TOLERANCE
        self._results = list(self._scratch.distanceResults)  # live views: reading them spares a lookup a value

    def _compute(self, state: RobotState) -> Array:
        import pinocchio as pin

        kinematics = self._kinematics
        kinematics.update(state)
        pin.updateGeometryPlacements(kinematics.model, kinematics.data, self._geometry, self._scratch)
        pin.computeDistances(self._geometry, self._scratch)
        return np.fromiter(map(_DISTANCE, self._results), dtype=np.float64, count=len(self._results))

    def _witness(self, state: RobotState) -> tuple[Array, Array, Array]:
        self._compute(state)
        p_WA, p_WB, normal = (np.array(list(map(f, self._results))).reshape(-1, 3) for f in (_ON_A, _ON_B, _NORMAL))
        for obstacle, rows in self._meshes:
            normal[rows[self._inside(obstacle, rows)]] *= -1.0
        return p_WA, p_WB, normal

    def _jacobian(self, state: RobotState, rows: Rows, p_WA: Array, normal_W: Array) -> Array:
        """Jacobian of the distance: it grows by n · (v_B − v_A).

        Both witness points lie on one line along n, so one arm serves both.
        """
        self._kinematics.update(state)
        wrench = np.concatenate([normal_W, np.cross(p_WA, normal_W)], axis=1)
        joint, support = self._joint[rows], self._kinematics.support
        moved = support[joint[:, 1]] - support[joint[:, 0]]
        return ((wrench @ self._kinematics.data.J) * moved)[:, self._columns]

    def _mesh_rows(self, obstacles: tuple[Obstacle, ...]) -> list[tuple[Obstacle, Rows]]:
        second = np.array([b for _, b in self.names], dtype=np.str_)
        meshes = [o for o in obstacles if o.shape.type == "mesh"]
        rows = [(o, np.flatnonzero(second == builder.OBSTACLE_PREFIX + o.name)) for o in meshes]
        return [(o, index) for o, index in rows if len(index)]

    def _inside(self, obstacle: Obstacle, rows: Rows) -> NDArray[np.bool_]:
        """Mask of the rows whose A, not crossing the mesh's surface, lies behind it."""
        p_WA = np.array([_ON_A(self._results[row]) for row in rows])
        apart = np.array([_DISTANCE(self._results[row]) for row in rows]) > 0
        p_B = (p_WA - obstacle.position_m) @ quat_to_mat(obstacle.quaternion_wxyz)
        return apart & (obstacle.shape.signed_distance(p_B) < 0)
