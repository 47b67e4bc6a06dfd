"""One builder for every simulator: the robot, what it carries and what stands in its way.

`build_model` compiles for MuJoCo, `pinocchio_model` and `add_to_plant` give the same robot to Pinocchio and Drake.
Contact bits: 1 floor, 2 carried object, 4 obstacles. The floor meets soles, every other link and the object, the object
meets palms, trunk and thighs, obstacles meet every link and the object; links meet each other by the pairs of
`self_contact`. Friction is not combined: the geom of higher priority has it, palms 2, soles and object 1, everything
else 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from hotice.errors import InvalidConfig, InvalidScene
from hotice.model import g1
from hotice.model.frames import quat_from_axis_angle
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.model.self_contact import add_self_contact

__all__ = [
    "add_object",
    "add_obstacles",
    "add_to_plant",
    "build_model",
    "pinocchio_model",
    "plant_text",
    "robot_spec",
]

if TYPE_CHECKING:
    import pinocchio
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import ModelInstanceIndex

FLOOR, OBJECT, OBSTACLE = 1, 2, 4
OBJECT_BODY = "object"
OBSTACLE_BODY = "obstacles"
HIT_SENSORS = ("robot_hits", "object_hits")
SELF_SENSOR = "self_contact"
ANY_CONTACT, DEEPEST_CONTACT = 0, 1
"""Choice of the contact that a sensor reads: MuJoCo's `reduce` "none" and "mindist"."""
OBSTACLE_PREFIX = "obstacle/"
MESH_SKIN_M = 0.001
POINT_M = 1e-5
MAX_MESH_FACES = 4000


def robot_spec(joints: Literal[20, 29] = 20, wrist_pos: ArrayLike | None = None) -> mujoco.MjSpec:
    """The robot alone: 29 joints, or 20 with waist and wrists welded; actuators are position servos.

    The servo law is τ = kp (ctrl − q) − kd q̇, cut at the torque limit of the description. `wrist_pos` (6,) [rad], in
    the order of `g1.WRIST_JOINTS`, are the angles at which the wrists of the 20-joint robot are welded (default zero).
    """
    if joints not in (20, 29):
        raise InvalidConfig(f"robot with {joints!r} joints: allowed are 20 (waist and wrists locked) and 29 (all)")
    spec = mujoco.MjSpec.from_file(g1.xml_path())
    if joints == 20:
        for name in g1.LOCKED_JOINTS:
            spec.delete(spec.actuator(name.removesuffix("_joint")))
            spec.delete(spec.joint(name))
        if wrist_pos is not None:
            for name, quat in zip(g1.WRIST_LINKS, wrist_quats(wrist_pos), strict=True):
                spec.body(name).quat = quat
    for actuator in spec.actuators:
        kp, kd = (float(v[0]) for v in g1.gains([actuator.target]))
        limit = list(actuator.ctrlrange)
        actuator.set_to_position(kp=kp, kv=kd)
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = limit
    add_self_contact(spec)
    return spec


def wrist_quats(wrist_pos: ArrayLike) -> np.ndarray:
    """Orientation of each wrist link in its parent, (..., 6) [rad] -> (..., 6, 4) wxyz."""
    axes = np.array([g1.WRIST_AXES[g1.stem(j)] for j in g1.WRIST_JOINTS])
    return quat_from_axis_angle(axes, np.asarray(wrist_pos, dtype=float))


def build_model(
    carried: CarriedObject | None = None,
    scene: Scene | None = None,
    *,
    joints: Literal[20, 29] = 20,
    wrist_pos: ArrayLike | None = None,
    object_shapes: Sequence[str] = (),
    floor: bool = True,
    fixed_base: bool = False,
    timestep_s: float = 0.005,
    elliptic: bool = False,
    movable: bool = False,
) -> mujoco.MjModel:
    """Compiles robot, floor, carried object and obstacles for MuJoCo.

    With object and scene, contact sensors `robot_hits` and `object_hits` count the contacts of robot and object with
    obstacles, which exact collision scoring reads, and further ones those with each that moves; `self_contact` is the
    signed distance of the deepest contact within the robot, 0 where there is none.

    Args:
        carried: adds body `object` with a free joint, after the robot in qpos and qvel.
        scene: adds every obstacle as a static geom named `obstacle/<name>`; what moves is a mocap body of that name.
        joints: 20 for training (waist and wrists welded), 29 for cross-checks.
        wrist_pos: (6,) angles of the welded wrists [rad], default zero (20 joints only).
        object_shapes: gives the object a geom of each of these shapes, see `add_object`.
        floor: adds the ground plane.
        fixed_base: welds the pelvis to the world at its initial height (for tests of the grasp).
        timestep_s: physics step.
        elliptic: elliptic friction cones and Newton to convergence instead of the training settings.
        movable: obstacles can be moved, see `add_obstacles`; there are no contact sensors then.
    """
    spec = robot_spec(joints, wrist_pos)
    spec.option.timestep = timestep_s
    # robot and object are one island; a contact moves one limb: sparse Jacobians take a quarter less time with elliptic
    # cones
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    if elliptic:
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.iterations, spec.option.ls_iterations = 100, 50
    if fixed_base:
        spec.delete(spec.joint("floating_base"))
    if floor:
        spec.worldbody.add_geom(
            name="floor",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0, 0, 1],
            contype=FLOOR,
            conaffinity=0,
            group=1,
            friction=[1.0, 0.005, 0.0001],
            rgba=[0.9, 0.9, 0.88, 1],
        )
    if carried is not None:
        add_object(spec, carried, object_shapes)
    if scene is not None:
        add_obstacles(spec, scene, movable)
        if carried is not None and not movable:
            add_contact_sensors(spec, [o.name for o in scene.moving])
    return spec.compile()


def add_object(spec: mujoco.MjSpec, carried: CarriedObject, shapes: Sequence[str] = ()) -> None:
    """Adds the carried object as a free body named `object` with one geom of the same name.

    With `shapes` it has a geom `object_<shape>` of each; all but its own are points at its centre, which nothing
    touches. Models of different shapes then have one layout, where a simulator holds the shapes once for all
    environments.
    """
    own, size = carried.mujoco_geom()
    if shapes and own not in shapes:
        raise InvalidConfig(f"object_shapes {tuple(shapes)} leave out the object's own shape {own!r}")
    body = spec.worldbody.add_body(name=OBJECT_BODY, pos=[0.4, 0, 0.9])
    body.add_freejoint(name="object_free")
    for kind in shapes or (own,):
        body.add_geom(
            name=f"{OBJECT_BODY}_{kind}" if shapes else OBJECT_BODY,
            type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"),
            size=[*size, 0, 0][:3] if kind == own else [POINT_M] * 3,
            contype=OBJECT,
            conaffinity=FLOOR | OBSTACLE,
            condim=3,
            friction=[0.8, 0.005, 0.0001],
            priority=1,
            group=2,
            rgba=[0.80, 0.60, 0.35, 1],
            mass=0,
        )
    body.explicitinertial = True
    body.mass = carried.mass_kg
    body.inertia = carried.inertia_diag_kgm2
    body.ipos = [0, 0, 0]
    body.iquat = [1, 0, 0, 0]


def add_obstacles(spec: mujoco.MjSpec, scene: Scene, movable: bool = False) -> None:
    """Adds every obstacle of the scene as static geoms.

    They belong to the static body `obstacles`; what has a motion, or, `movable`, each of them, to a mocap body of its
    own, `obstacle/<name>`, which MuJoCo's `mocap_pos` and `mocap_quat` move, bounding volumes and all. A triangle mesh
    becomes one thin prism (1 mm) per face, because MuJoCo would replace the mesh by its convex hull: what lies in a
    hollow of the mesh must not count as a collision. A body that is inside solid mesh from the start, without crossing
    its surface, makes no contact.
    """
    still = None if movable else spec.worldbody.add_body(name=OBSTACLE_BODY)
    for obstacle in scene.obstacles:
        name, pose = OBSTACLE_PREFIX + obstacle.name, dict(pos=obstacle.position_m, quat=obstacle.quaternion_wxyz)
        body = still
        if body is None or obstacle.motion is not None:
            body = spec.worldbody.add_body(name=name, mocap=True, **pose)
            pose = {}
        kind, size = obstacle.shape.mujoco_geom() if obstacle.shape.type != "mesh" else ("mesh", ())
        common = dict(
            **pose,
            contype=OBSTACLE,
            conaffinity=0,
            condim=3,
            friction=[0.6, 0.005, 0.0001],
            group=0,
            rgba=[0.55, 0.62, 0.70, 1],
        )
        if kind != "mesh":
            body.add_geom(
                name=name, type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"), size=[*size, 0, 0][:3], **common
            )
            continue
        vertices, faces = obstacle.shape.triangles()
        if len(faces) > MAX_MESH_FACES:
            raise InvalidScene(
                f"obstacle {obstacle.name!r}: mesh of {len(faces)} faces, at most {MAX_MESH_FACES} can be simulated "
                "exactly: simplify the mesh"
            )
        for index, prism in enumerate(face_prisms(vertices, faces)):
            spec.add_mesh(name=f"{name}#{index}", uservert=prism.reshape(-1).tolist())
            body.add_geom(name=f"{name}#{index}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{name}#{index}", **common)


def add_contact_sensors(spec: mujoco.MjSpec, moving: Sequence[str] = ()) -> None:
    """Adds the sensors of contacts with obstacles, `robot_hits` of any link and `object_hits`, and within the robot.

    After them two for each obstacle in `moving`, `robot_hits/<name>` and `object_hits/<name>`.
    """
    tree, body = mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtObj.mjOBJ_BODY
    found, distance = mujoco.mjtConDataField.mjCONDATA_FOUND, mujoco.mjtConDataField.mjCONDATA_DIST
    sensors = [
        (HIT_SENSORS[0], tree, g1.ROOT_BODY, body, OBSTACLE_BODY, found, ANY_CONTACT),
        (HIT_SENSORS[1], body, OBJECT_BODY, body, OBSTACLE_BODY, found, ANY_CONTACT),
        (SELF_SENSOR, tree, g1.ROOT_BODY, tree, g1.ROOT_BODY, distance, DEEPEST_CONTACT),
    ]
    for mover in moving:
        for name, kind, who, other_kind, _, field, reduce in sensors[:2]:
            sensors.append((f"{name}/{mover}", kind, who, other_kind, OBSTACLE_PREFIX + mover, field, reduce))
    for name, kind, who, other_kind, other, field, reduce in sensors:
        sensor = spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=kind,
            objname=who,
            reftype=other_kind,
            refname=other,
        )
        sensor.intprm[:3] = [1 << int(field), reduce, 1]


def face_prisms(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Prisms of thickness `MESH_SKIN_M` behind each triangle, (F, 6, 3) [m]; triangles without area are left out."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    area2 = np.linalg.norm(normal, axis=1)
    keep = area2 > 1e-10
    inward = -MESH_SKIN_M * normal[keep] / area2[keep, None]
    front = np.stack([a[keep], b[keep], c[keep]], axis=1)
    return np.concatenate([front, front + inward[:, None]], axis=1)


def pinocchio_model(joints: Literal[20, 29] = 29) -> pinocchio.Model:
    """The robot for Pinocchio: free flyer and 29 joints, or reduced to the 20 of the policy (locked at zero).

    Torque limits are those of the motors, which Pinocchio does not read from MJCF.
    """
    import pinocchio as pin

    model = pin.buildModelFromMJCF(g1.xml_path())
    for motor in mujoco.MjSpec.from_file(g1.xml_path()).actuators:
        v = model.joints[model.getJointId(motor.target)].idx_v
        model.lowerEffortLimit[v], model.upperEffortLimit[v] = motor.ctrlrange
    if joints == 29:
        return model
    for frame in model.frames:  # a body and a site may share a name in MJCF, frames of a reduced model may not
        if frame.type == pin.FrameType.OP_FRAME and frame.name == g1.ROOT_BODY:
            frame.name += "_site"
    locked = [model.getJointId(name) for name in g1.LOCKED_JOINTS]
    return pin.buildReducedModel(model, locked, pin.neutral(model))


def add_to_plant(
    plant: MultibodyPlant, joints: Literal[20, 29] = 29, wrist_pos: ArrayLike | None = None
) -> Sequence[ModelInstanceIndex]:
    """Adds the robot to a Drake plant from the same text; returns the model instances.

    With 20 joints waist and wrists are welded, the wrists at `wrist_pos` (6,) [rad], as in `robot_spec`.
    """
    import logging

    from pydrake.multibody.parsing import Parser

    text = plant_text(joints, wrist_pos)
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.ERROR)  # Drake warns about each MuJoCo-only attribute
    try:
        return Parser(plant).AddModelsFromString(text, "xml")
    finally:
        log.setLevel(level)


def plant_text(joints: Literal[20, 29] = 29, wrist_pos: ArrayLike | None = None) -> str:
    """The MJCF text of the robot with motors; with 20 joints without those of waist and wrists."""
    from xml.etree import ElementTree

    if joints not in (20, 29):
        raise InvalidConfig(f"robot with {joints!r} joints: allowed are 20 (waist and wrists locked) and 29 (all)")
    text = Path(g1.xml_path()).read_text()
    if joints == 29:
        return text
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            locked = child.get("name") if child.tag == "joint" else child.get("joint")
            if locked in g1.LOCKED_JOINTS:
                parent.remove(child)
    if wrist_pos is not None:
        quats = dict(zip(g1.WRIST_LINKS, wrist_quats(wrist_pos), strict=True))
        for body in root.iter("body"):
            if body.get("name") in quats:
                body.set("quat", " ".join(repr(float(v)) for v in quats[str(body.get("name"))]))
    return ElementTree.tostring(root, encoding="unicode")
