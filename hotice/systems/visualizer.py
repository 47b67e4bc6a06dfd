"""The station in Meshcat: robot, object, obstacles, field arrows, footsteps and contact forces. Always optional."""

# pydrake's stubs type arrays as numpy does not:
# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, MeshcatParams, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem

from hotice import checks
from hotice.checks import Range
from hotice.errors import InvalidConfig
from hotice.model import builder
from hotice.model.objects import CarriedObject
from hotice.model.scene import Scene
from hotice.policy.guidance import NUM_FIELD, FieldReading
from hotice.policy.percept import NUM_SGF, Percept
from hotice.systems.drake_shapes import pose, primitive, shape_of
from hotice.systems.robot_meshes import robot_meshes
from hotice.systems.signals import CONTACT_FORCE, GUIDANCE, NQ, PERCEPT, ROBOT_STATE, TOUCHING_BODIES

Array = NDArray[np.float64]
ROOT = "station"
SGF_COLOUR, OGF_COLOUR, FORCE_COLOUR = Rgba(0.16, 0.44, 0.82), Rgba(0.93, 0.52, 0.10), Rgba(0.75, 0.10, 0.15)
METRES_PER_M_S, METRES_PER_N = 0.25, 1.0 / 800.0
LONGEST_M = 0.5
CATEGORY_COLOURS = {
    "ground": Rgba(0.62, 0.55, 0.45),
    "side": Rgba(0.55, 0.62, 0.70),
    "overhead": Rgba(0.60, 0.50, 0.66),
}
_ZERO_M = 1e-3


def open_meshcat(host: str = "127.0.0.1", port: int | None = None) -> Meshcat:
    """A pydrake Meshcat that only this machine can open; `host` "*": everybody who reaches it; port None: a free one.

    Whoever opens it can move sliders and press buttons. Raises `InvalidConfig`.
    """
    parameters = MeshcatParams()
    parameters.host = host
    if port is not None:
        parameters.port = checks.whole("port", port, Range(least=1024, most=65535))
    try:
        return Meshcat(parameters)
    except RuntimeError as error:
        raise InvalidConfig(f"host is {host!r} and port {port!r}: no server there: {error}") from None


class Visualizer(LeafSystem):
    """Publishes to a Meshcat at `publish_hz`, and on a forced publish; everything moves, so recordings replay it all.

    Inputs `robot_state` (84,); `percept` (119,) and `guidance` (122,): arrows stand where the robot believes its
    keypoints are; `contact_force` (12,): arrows at ankles and hands.

    Args:
        meshcat: a pydrake Meshcat.
        scene, carried: what stands and what is carried.
        publish_hz: rate.
        footsteps: (S, 4) planned footholds x, y [m], yaw [rad], side (0 left, 1 right), or None.
        meshes: draw Unitree's meshes where they are installed, else the primitives of the model.
    """

    def __init__(
        self,
        meshcat: Any,
        scene: Scene,
        carried: CarriedObject,
        publish_hz: float = 30.0,
        footsteps: ArrayLike | None = None,
        meshes: bool = True,
    ) -> None:
        super().__init__()
        self.meshcat = meshcat
        self._model = builder.build_model(carried, joints=29, floor=False)
        self._data = mujoco.MjData(self._model)
        self._touching = [self._model.body(name).id for name in TOUCHING_BODIES]
        self._state = self.DeclareVectorInputPort("robot_state", ROBOT_STATE)
        self._percept = self.DeclareVectorInputPort("percept", PERCEPT)
        self._guidance = self.DeclareVectorInputPort("guidance", GUIDANCE)
        self._force = self.DeclareVectorInputPort("contact_force", CONTACT_FORCE)
        self._bodies = self._draw_bodies(robot_meshes() if meshes else {})
        self._draw_scene(scene)
        self._moving = {i: o for i, o in enumerate(scene.obstacles) if o.motion is not None}
        self._draw_footsteps(footsteps)
        for k in range(NUM_FIELD):
            self._draw_arrow(f"{ROOT}/field/{k}", SGF_COLOUR if k < NUM_SGF else OGF_COLOUR)
        for name in TOUCHING_BODIES:
            self._draw_arrow(f"{ROOT}/force/{name}", FORCE_COLOUR)
        self.DeclarePeriodicPublishEvent(1.0 / publish_hz, 0.0, self._publish)
        self.DeclareForcedPublishEvent(self._publish)

    def _publish(self, context: Context) -> None:
        time_s = context.get_time()
        self._data.qpos[:] = self._state.Eval(context)[:NQ]
        mujoco.mj_kinematics(self._model, self._data)
        for body, path in self._bodies.items():
            X_WB = pose(self._data.xpos[body], self._data.xquat[body])
            self.meshcat.SetTransform(path, X_WB, time_in_recording=time_s)
        percept, reading = Percept(self._percept.Eval(context)), FieldReading(self._guidance.Eval(context))
        points = np.concatenate([percept.p_WK, percept.p_WOK])
        for k, (p_W, force_W) in enumerate(zip(points, reading.force_W, strict=True)):
            self._move_arrow(f"{ROOT}/field/{k}", p_W, METRES_PER_M_S * force_W, time_s)
        for i, obstacle in self._moving.items():
            then = obstacle.at(time_s)
            X_WB = pose(then.position_m, then.quaternion_wxyz)
            self.meshcat.SetTransform(f"{ROOT}/obstacles/{i}", X_WB, time_in_recording=time_s)
        forces = self._force.Eval(context).reshape(-1, 3)
        for name, body, force_W in zip(TOUCHING_BODIES, self._touching, forces, strict=True):
            self._move_arrow(f"{ROOT}/force/{name}", self._data.xpos[body], METRES_PER_N * force_W, time_s)

    def _draw_bodies(self, meshes: dict[str, Any]) -> dict[int, str]:
        model, shown = self._model, {}
        for body in range(1, model.nbody):
            name = model.body(body).name
            path = f"{ROOT}/{'object' if name == builder.OBJECT_BODY else f'robot/{name}'}"
            if name in meshes:
                vertices, faces = meshes[name]
                grey = Rgba(0.24, 0.26, 0.30) if "hip" in name or "knee" in name else Rgba(0.72, 0.73, 0.75)
                self.meshcat.SetTriangleMesh(
                    f"{path}/mesh", np.asfortranarray(vertices.T), np.asfortranarray(faces.T), grey
                )
                shown[body] = path
                continue
            for geom in range(model.ngeom):
                if model.geom_bodyid[geom] == body and (model.geom_group[geom] <= 2):
                    part = f"{path}/{model.geom(geom).name or geom}"
                    self.meshcat.SetObject(part, shape_of(model, geom), Rgba(*model.geom_rgba[geom].astype(float)))
                    self.meshcat.SetTransform(part, pose(model.geom_pos[geom], model.geom_quat[geom]))
                    shown[body] = path
        return shown

    def _draw_scene(self, scene: Scene) -> None:
        for i, obstacle in enumerate(scene.obstacles):
            path, colour = f"{ROOT}/obstacles/{i}", CATEGORY_COLOURS[obstacle.category]
            if obstacle.shape.type == "mesh":
                vertices, faces = obstacle.shape.triangles()
                triangles = np.asfortranarray(np.asarray(faces, dtype=np.int32).T)
                self.meshcat.SetTriangleMesh(path, np.asfortranarray(vertices.T), triangles, colour)
            else:
                self.meshcat.SetObject(path, primitive(*obstacle.shape.mujoco_geom()), colour)
            self.meshcat.SetTransform(path, pose(obstacle.position_m, obstacle.quaternion_wxyz))
        low, high = (np.array(b) for b in scene.bounds_m)
        size, middle = high - low, 0.5 * (low + high)
        self.meshcat.SetObject(f"{ROOT}/floor", Box(size[0], size[1], 0.01), Rgba(0.90, 0.90, 0.88))
        self.meshcat.SetTransform(f"{ROOT}/floor", RigidTransform([middle[0], middle[1], -0.006]))
        self.meshcat.SetObject(f"{ROOT}/goal", Cylinder(0.1, 0.004), Rgba(0.20, 0.60, 0.30))
        self.meshcat.SetTransform(f"{ROOT}/goal", RigidTransform([*scene.goal, 0.002]))
        self.meshcat.SetProperty("/Grid", "visible", False)

    def _draw_footsteps(self, footsteps: ArrayLike | None) -> None:
        for i, (x, y, yaw, side) in enumerate([] if footsteps is None else np.asarray(footsteps, dtype=float)):
            path = f"{ROOT}/footsteps/{i}"
            colour = Rgba(0.20, 0.55, 0.75, 0.8) if side < 0.5 else Rgba(0.80, 0.45, 0.25, 0.8)
            self.meshcat.SetObject(path, Box(0.21, 0.07, 0.004), colour)
            turn = RotationMatrix.MakeZRotation(yaw)
            offset = turn.multiply(np.array([0.038, 0.0, 0.0]))  # the sole reaches further ahead of the ankle
            self.meshcat.SetTransform(path, RigidTransform(turn, np.array([x, y, 0.003]) + offset))

    def _draw_arrow(self, path: str, colour: Rgba) -> None:
        """An arrow of length 1 m along z: `path` places it, `path`/length stretches it."""
        self.meshcat.SetObject(f"{path}/length/shaft", Cylinder(0.006, 0.8), colour)
        self.meshcat.SetTransform(f"{path}/length/shaft", RigidTransform([0.0, 0.0, 0.4]))
        self.meshcat.SetObject(f"{path}/length/head", MeshcatCone(0.2, 0.016, 0.016), colour)
        self.meshcat.SetTransform(
            f"{path}/length/head", RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 1.0])
        )

    def _move_arrow(self, path: str, p_W: Array, v_W: Array, time_s: float) -> None:
        length = float(np.linalg.norm(v_W))
        if not np.isfinite(length):
            return
        z = v_W / length if length > _ZERO_M else np.array([0.0, 0.0, 1.0])
        X_WA = RigidTransform(RotationMatrix.MakeFromOneVector(z, 2), p_W)
        self.meshcat.SetTransform(path, X_WA, time_in_recording=time_s)
        stretch = [1.0, 1.0, max(min(length, LONGEST_M), _ZERO_M)]
        self.meshcat.SetProperty(f"{path}/length", "scale", stretch, time_in_recording=time_s)
