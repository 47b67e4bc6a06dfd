"""The same robot, object and scene as a Drake MultibodyPlant, behind the ports of the MuJoCo plant."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    Shape,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    ContactResults,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import PdControllerGains, SpatialInertia, UnitInertia
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, Multiplexer

from hotice.errors import NotAvailable
from hotice.model import builder as models
from hotice.model import g1, self_contact
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.systems.drake_dampers import DrakeDampers
from hotice.systems.drake_shapes import pose, primitive
from hotice.systems.signals import CONTACT_FORCE, NUM_JOINTS, TOUCHING_BODIES

Array = NDArray[np.float64]
STIFFNESS_N_M, DISSIPATION_S_M = 5e4, 10.0
"""Stiffness and dissipation of each contact point: a standing robot sinks in by less than 1 mm."""
FLOOR_M = (100.0, 100.0, 1.0)
"""A box: Drake warns of half spaces."""
FRICTION = {
    "object_in_hands": 2.0,
    "object": 2.0 / 3.0,
    "palm": 2.0,
    "floor": 1.0,
    "obstacle": 1.0,
    "obstacle_at_palms": 2.0,
    "robot": 1.0,
}
"""Such that Drake's mean 2 ab / (a + b) gives MuJoCo's pairs: palms with all that they meet 2, the robot's other bodies
with floor and obstacles 1, the object with all but palms 0.8. No single friction of the object or of an obstacle does:
each has two geometries of one shape, one that only palms meet."""


class DrakePlant(Diagram):
    """Lagged point contact at the points that MuJoCo's model has (four spheres a sole and a palm), joints 20.

    Input `actuation` (20,): torques [N m], or with `servo` targets [rad] of Drake's implicit joint servos.
    `damped` (20,), optional: joints where it is above 0 are only damped, implicitly, whatever they are told.
    Outputs `state` (67,): [q; v] of the plant; `contact_force` (12,): see `signals`.
    `index` (66,): see `DrakeStateAdaptor`. `plant`, `scene_graph`: Drake's.

    Args:
        scene: obstacles; triangle meshes are refused.
        carried: the object. wrist_pos: (6,) angles of the welded wrists [rad].
        qpos: (34,) where the default Context starts, in MuJoCo's order. time_step_s: of the plant.
        servo: whether commands are joint targets.

    Raises:
        NotAvailable: an obstacle is a triangle mesh, which Drake's point contact replaces by its convex hull.
    """

    def __init__(
        self, scene: Scene, carried: CarriedObject, wrist_pos: Array, qpos: Array, time_step_s: float, servo: bool
    ) -> None:
        Diagram.__init__(self)
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=time_step_s,
            contact_model="point",
            discrete_contact_approximation="lagged",
            use_sampled_output_ports=False,
        )
        dampers = builder.AddNamedSystem("dampers", DrakeDampers(time_step_s))
        plant, scene_graph = AddMultibodyPlant(config, builder)
        (robot,) = models.add_to_plant(plant, 20, wrist_pos)
        groups, meeting = _robot_geometry(plant, scene_graph)
        groups["object"], groups["object_in_hands"] = _add_object(plant, carried)
        floor = RigidTransform([0.0, 0.0, -0.5 * FLOOR_M[2]])
        groups["floor"] = [_add_fixed(plant, floor, Box(*FLOOR_M), "floor", "floor")]
        for kind in ("obstacle", "obstacle_at_palms"):
            # a prefix: an obstacle may be called `floor`
            groups[kind] = [
                _add_fixed(plant, pose(o.position_m, o.quaternion_wxyz), _shape(o), f"{kind}/{o.name}", kind)
                for o in scene.obstacles
            ]
        _filter(scene_graph, groups, meeting)
        if servo:
            for joint, kp, kd in zip(g1.ACTION_JOINTS, *g1.gains(), strict=True):
                actuator = plant.GetJointActuatorByName(joint.removesuffix("_joint"))
                actuator.set_controller_gains(PdControllerGains(p=kp, d=kd))
        plant.Finalize()
        self.plant, self.scene_graph = plant, scene_graph
        self.index = _index(plant)
        _check_order(plant, robot)
        plant.SetDefaultPositions(self._positions(qpos))
        dampers.drive([plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices(robot)])
        self._add_ports(builder, robot, servo, dampers)
        builder.BuildInto(self)

    def _add_ports(self, builder: DiagramBuilder, robot: Any, servo: bool, dampers: DrakeDampers) -> None:
        plant = self.plant
        desired = builder.AddNamedSystem("desired_state", Multiplexer([NUM_JOINTS, NUM_JOINTS]))
        rest = builder.AddNamedSystem("at_rest", ConstantVectorSource(np.zeros(NUM_JOINTS)))
        builder.Connect(rest.get_output_port(), desired.get_input_port(1))
        builder.Connect(desired.get_output_port(), plant.get_desired_state_input_port(robot))
        if servo:
            builder.ExportInput(desired.get_input_port(0), "actuation")
        else:
            # dampers, which the actuators may become, need a state to damp to
            builder.Connect(rest.get_output_port(), desired.get_input_port(0))
            builder.ExportInput(dampers.GetInputPort("actuation"), "actuation")
            builder.Connect(dampers.get_output_port(), plant.get_actuation_input_port(robot))
        builder.ExportInput(dampers.GetInputPort("damped"), "damped")
        touch = builder.AddNamedSystem("contact_forces", _ContactForces(plant, dampers))
        builder.Connect(plant.get_contact_results_output_port(), touch.get_input_port(0))
        builder.ConnectInput("damped", touch.GetInputPort("damped"))
        builder.ExportOutput(plant.get_state_output_port(), "state")
        builder.ExportOutput(touch.GetOutputPort("contact_force"), "contact_force")

    def _positions(self, qpos: Array) -> Array:
        q = np.zeros(self.plant.num_positions())
        parts = (g1.ROOT_QUAT, g1.ROOT_POS, g1.JOINT_POS, g1.OBJECT_QUAT, g1.OBJECT_POS)
        q[self.index[: len(qpos)]] = np.concatenate([qpos[part] for part in parts])
        return q

    def set_state(self, context: Context, qpos: Array) -> None:
        """Puts this diagram's Context into a configuration (34,) in MuJoCo's order, at rest."""
        mine = self.plant.GetMyMutableContextFromRoot(context)
        self.plant.SetPositionsAndVelocities(
            mine, np.concatenate([self._positions(qpos), np.zeros(self.plant.num_velocities())])
        )


class _ContactForces(LeafSystem):
    """Inputs the plant's contact results and `damped`; output `contact_force` (12,), see `signals`."""

    def __init__(self, plant: MultibodyPlant, dampers: DrakeDampers) -> None:
        super().__init__()
        self._dampers = dampers
        self._touching = {plant.GetBodyByName(name).index(): i for i, name in enumerate(TOUCHING_BODIES)}
        self._results = self.DeclareAbstractInputPort("contact_results", AbstractValue.Make(ContactResults()))
        self._damped = self.DeclareVectorInputPort("damped", NUM_JOINTS)
        self.DeclareVectorOutputPort("contact_force", CONTACT_FORCE, self._output)

    def _output(self, context: Context, output: BasicVector) -> None:
        # contacts are solved with the motors as they are in this Context
        self._dampers.set_gains(self._dampers.wanted(self._damped, context))
        results = self._results.Eval(context)
        force = np.zeros((len(TOUCHING_BODIES), 3))
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            on_B_W = info.contact_force()
            for body, sign in ((info.bodyA_index(), -1.0), (info.bodyB_index(), 1.0)):
                if body in self._touching:
                    force[self._touching[body]] += sign * on_B_W
        output.SetFromVector(force.ravel())


def _properties(kind: str) -> ProximityProperties:
    properties, mu = ProximityProperties(), FRICTION[kind]
    AddContactMaterial(
        dissipation=DISSIPATION_S_M,
        point_stiffness=STIFFNESS_N_M,
        friction=CoulombFriction(mu, mu),
        properties=properties,
    )
    return properties


def _robot_geometry(
    plant: MultibodyPlant, scene_graph: SceneGraph
) -> tuple[dict[str, list[GeometryId]], list[tuple[GeometryId, GeometryId]]]:
    """Geometries of the robot: all, those that miss floor or object, and pairs that meet; also sets their materials."""
    bits = {}
    model = models.robot_spec(20).compile()
    for i in range(model.ngeom):
        bits[model.geom(i).name] = int(model.geom_conaffinity[i])
    groups: dict[str, list[GeometryId]] = {"robot": [], "palm": [], "no_floor": [], "no_object": []}
    named: dict[str, GeometryId] = {}
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        name = inspector.GetName(geometry).split("::")[-1]
        if name not in bits:
            continue
        groups["robot"].append(geometry)
        named[name] = geometry
        if not bits[name] & models.FLOOR:
            groups["no_floor"].append(geometry)
        if not bits[name] & models.OBJECT:
            groups["no_object"].append(geometry)
        kind = "palm" if "_palm_" in name else "robot"
        if kind == "palm":
            groups["palm"].append(geometry)
        scene_graph.AssignRole(plant.get_source_id(), geometry, _properties(kind), RoleAssign.kReplace)
    return groups, [(named[one], named[other]) for one, other in self_contact.pairs()]


def _filter(
    scene_graph: SceneGraph, groups: dict[str, list[GeometryId]], meeting: list[tuple[GeometryId, GeometryId]]
) -> None:
    """Leaves the pairs that MuJoCo's model lets collide, see `hotice.model.builder`."""
    sets = {name: GeometrySet(ids) for name, ids in groups.items()}
    rules = CollisionFilterDeclaration()
    rules.ExcludeWithin(sets["robot"])
    for one, other in meeting:
        rules.AllowBetween(GeometrySet([one]), GeometrySet([other]))
    rules.ExcludeBetween(sets["no_floor"], sets["floor"])
    rules.ExcludeBetween(sets["no_object"], sets["object"])
    rules.ExcludeBetween(sets["palm"], sets["object"])
    rules.ExcludeBetween(sets["palm"], sets["obstacle"])
    at_palms = GeometrySet([*groups["object_in_hands"], *groups["obstacle_at_palms"]])
    rules.ExcludeWithin(at_palms)
    for name in ("robot", "floor", "object", "obstacle"):
        rules.ExcludeBetween(sets[name], at_palms)
    rules.AllowBetween(sets["palm"], at_palms)
    scene_graph.collision_filter_manager().Apply(rules)


def _add_object(plant: MultibodyPlant, carried: CarriedObject) -> tuple[list[GeometryId], list[GeometryId]]:
    """Geometries of the object: what everything but palms meets, and what palms meet."""
    unit = UnitInertia(*(np.array(carried.inertia_diag_kgm2) / carried.mass_kg))
    body = plant.AddRigidBody(
        models.OBJECT_BODY,
        plant.AddModelInstance(models.OBJECT_BODY),
        SpatialInertia(carried.mass_kg, np.zeros(3), unit),
    )
    shape = primitive(*carried.mujoco_geom())
    plant.RegisterVisualGeometry(body, RigidTransform(), shape, "object", np.array([0.80, 0.60, 0.35, 1.0]))
    met, held = (
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, kind, _properties(kind))
        for kind in ("object", "object_in_hands")
    )
    return [met], [held]


def _add_fixed(plant: MultibodyPlant, X_WG: RigidTransform, shape: Shape, name: str, kind: str) -> GeometryId:
    return plant.RegisterCollisionGeometry(plant.world_body(), X_WG, shape, name, _properties(kind))


def _shape(obstacle: Any) -> Shape:
    if obstacle.shape.type == "mesh":
        raise NotAvailable(
            f"obstacle {obstacle.name!r} is a triangle mesh, which plant 'drake' cannot touch exactly: "
            "use plant 'mujoco'"
        )
    return primitive(*obstacle.shape.mujoco_geom())


def _index(plant: MultibodyPlant) -> Array:
    """Places in [q; v], see `DrakeStateAdaptor`."""
    q, v, nq = [], [], plant.num_positions()
    for name in (g1.ROOT_BODY, models.OBJECT_BODY):
        body = plant.GetBodyByName(name)
        q.append(body.floating_positions_start() + np.arange(7))
        v.append(body.floating_velocities_start_in_v() + np.arange(6))
    joints = [plant.GetJointByName(name) for name in g1.ACTION_JOINTS]
    q.insert(1, np.array([j.position_start() for j in joints]))
    v.insert(1, np.array([j.velocity_start() for j in joints]))
    return np.concatenate([*q, *(nq + part for part in v)])


def _check_order(plant: MultibodyPlant, robot: Any) -> None:
    names = [plant.get_joint_actuator(i).joint().name() for i in plant.GetJointActuatorIndices(robot)]
    assert tuple(names) == g1.ACTION_JOINTS, names
