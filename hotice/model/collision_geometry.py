"""Collision geometries of robot, object and obstacles for coal, and the pairs worth asking about.

The robot's primitives are read from the model that MuJoCo compiles, so both test the same shapes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.model import builder, g1
from hotice.model.objects import CarriedObject
from hotice.model.scene import Obstacle, Scene

if TYPE_CHECKING:
    import coal
    import pinocchio

    from hotice.model.kinematics import Kinematics

ROBOT_OBSTACLE, OBJECT_OBSTACLE, ROBOT_OBJECT = "robot-obstacle", "object-obstacle", "robot-object"
GRASP, SELF = "grasp", "self"
KINDS = (ROBOT_OBSTACLE, OBJECT_OBSTACLE, ROBOT_OBJECT, GRASP, SELF)
"""Kinds of pairs. `grasp`: hands (wrist yaw links, palms) and object, which are meant to touch."""
HAND_LINKS = tuple(f"{side}_wrist_yaw_link" for side in g1.SIDES)
_NAMES = {
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
}


@dataclass(frozen=True, kw_only=True)
class RobotGeom:
    """A primitive of the robot: its MuJoCo type and size, pose in its link (wxyz), and what the link moves with.

    `groups`: the rigid group of its link (links that cannot move against each other), and the next two towards the
    pelvis.
    """

    name: str
    link: str
    kind: str
    size: tuple[float, ...]
    position: NDArray[np.float64]
    quat: NDArray[np.float64]
    groups: tuple[int, int, int]

    def joints_to(self, other: RobotGeom) -> int:
        """Joints between the two links; 3 stands for more than two."""
        shared = [i + j for i, a in enumerate(self.groups) for j, b in enumerate(other.groups) if a == b]
        return min([*shared, 3])


def robot_geoms(joints: int) -> list[RobotGeom]:
    """Every primitive of the robot with 20 or 29 joints, soles and palms included. Raises `InvalidConfig`."""
    model = builder.robot_spec(joints).compile()  # type: ignore[arg-type]
    geoms = []
    for i in range(model.ngeom):
        body = int(model.geom_bodyid[i])
        groups = [int(model.body_weldid[body])]
        for _ in range(2):
            groups.append(int(model.body_weldid[model.body_parentid[groups[-1]]]))
        geoms.append(
            RobotGeom(
                name=model.geom(i).name,
                link=model.body(body).name,
                kind=_NAMES[int(model.geom_type[i])],
                size=tuple(model.geom_size[i]),
                position=model.geom_pos[i].copy(),
                quat=model.geom_quat[i].copy(),
                groups=(groups[0], groups[1], groups[2]),
            )
        )
    return geoms


def coal_primitive(kind: str, size: tuple[float, ...]) -> coal.ShapeBase:
    """The coal shape of a MuJoCo primitive: half extents, or radius and half length along z [m]."""
    import coal

    if kind == "box":
        return coal.Box(*(2.0 * v for v in size[:3]))
    if kind == "sphere":
        return coal.Sphere(size[0])
    return {"cylinder": coal.Cylinder, "capsule": coal.Capsule}[kind](size[0], 2.0 * size[1])


def coal_obstacle(obstacle: Obstacle) -> coal.CollisionGeometry:
    """The coal shape of an obstacle; a mesh becomes a hierarchy of its triangles."""
    import coal

    if obstacle.shape.type != "mesh":
        return coal_primitive(*obstacle.shape.mujoco_geom())
    vertices, faces = obstacle.shape.triangles()
    tree = coal.BVHModelOBBRSS()
    tree.beginModel(len(faces), len(vertices))
    tree.addVertices(vertices)
    tree.addTriangles(np.asarray(faces))
    tree.endModel()
    return tree


def geometry_model(
    scene: Scene | None, carried: CarriedObject | None, robot: list[RobotGeom], kinematics: Kinematics
) -> pinocchio.GeometryModel:
    """Robot, then object, then obstacles, as geometries of the joints of `kinematics`, without pairs."""
    import pinocchio as pin

    model = pin.GeometryModel()

    def add(name: str, joint: int, X_JG: pin.SE3, shape: coal.CollisionGeometry) -> None:
        model.addGeometryObject(pin.GeometryObject(name, joint, X_JG, shape))

    for geom in robot:
        joint, X_JL = kinematics.body_frame(geom.link)
        add(geom.name, joint, X_JL * _pose(geom.position, geom.quat), coal_primitive(geom.kind, geom.size))
    if carried is not None:
        add(builder.OBJECT_BODY, kinematics.object_joint, pin.SE3.Identity(), coal_primitive(*carried.mujoco_geom()))
    for obstacle in scene.obstacles if scene is not None else ():
        pose = _pose(obstacle.position_m, obstacle.quaternion_wxyz)
        add(builder.OBSTACLE_PREFIX + obstacle.name, 0, pose, coal_obstacle(obstacle))
    return model


def pair_table(robot: list[RobotGeom], carried: bool, obstacles: int) -> list[tuple[int, int, str]]:
    """Indices into `geometry_model` and kind of every pair, those of links that share a joint left out."""
    count = len(robot)
    first = count + carried
    pairs = [(i, j, ROBOT_OBSTACLE) for i in range(count) for j in range(first, first + obstacles)]
    if carried:
        pairs += [(count, j, OBJECT_OBSTACLE) for j in range(first, first + obstacles)]
        pairs += [(i, count, GRASP if geom.link in HAND_LINKS else ROBOT_OBJECT) for i, geom in enumerate(robot)]
    pairs += [(i, j, SELF) for (i, a), (j, b) in combinations(enumerate(robot), 2) if a.joints_to(b) > 1]
    return pairs


def _pose(position: NDArray[np.float64] | tuple[float, ...], quat: NDArray[np.float64] | tuple[float, ...]):
    import pinocchio as pin

    w, x, y, z = quat
    return pin.SE3(pin.Quaternion(w, x, y, z), np.asarray(position, dtype=np.float64))
