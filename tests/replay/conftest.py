import mujoco
import numpy as np
import pytest

from hotice.model import Box, Obstacle, Scene
from hotice.model.geometry.shapes import BoxShape, CapsuleShape, CylinderShape, MeshShape, SphereShape
from hotice.replay import RolloutRecord

TOY = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <geom name="obstacle/post" type="box" size="0.1 0.1 0.5" pos="1 0.5 0.5"/>
    <body name="pelvis" pos="0 0 0.8">
      <freejoint/>
      <geom name="trunk" type="box" size="0.06 0.1 0.2" pos="0 0 0.2" rgba="0.3 0.3 0.35 1"/>
      <geom name="head" type="ellipsoid" size="0.06 0.07 0.09" pos="0 0 0.5"/>
      <geom name="hidden" type="sphere" size="0.02" group="3"/>
      <geom name="glass" type="sphere" size="0.02" rgba="1 1 1 0"/>
      <body name="left_leg">
        <joint name="left_hip" axis="0 1 0"/>
        <geom name="left_leg" type="capsule" size="0.05" fromto="0 0.1 0 0 0.1 -0.7"/>
      </body>
      <body name="right_leg">
        <joint name="right_hip" axis="0 1 0"/>
        <geom name="right_leg" type="cylinder" size="0.05 0.35" pos="0 -0.1 -0.35"/>
      </body>
    </body>
    <body name="object" pos="0.4 0 0.9">
      <freejoint/>
      <geom name="object" type="box" size="0.15 0.15 0.1" rgba="0.8 0.6 0.35 1"/>
    </body>
  </worldbody>
</mujoco>
"""
SHOWN = ["trunk", "head", "left_leg", "right_leg", "object"]
WEDGE = """
v 0 0 0
v 0.3 0 0
v 0 0.3 0
v 0 0 0.4
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


@pytest.fixture(scope="session")
def scene(tmp_path_factory) -> Scene:
    folder = tmp_path_factory.mktemp("meshes")
    (folder / "wedge.obj").write_text(WEDGE)
    tilted = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
    return Scene(
        "five_shapes",
        obstacles=(
            Obstacle("beam", "overhead", BoxShape((0.2, 2.0, 0.2)), (1.0, 0.0, 1.4)),
            Obstacle("pipe", "ground", CylinderShape(0.03, 2.0), (0.6, 0.0, 0.03), tilted),
            Obstacle("post", "side", CapsuleShape(0.08, 0.8), (1.3, 0.7, 0.5)),
            Obstacle("ball", "side", SphereShape(0.15), (1.3, -0.7, 0.15)),
            Obstacle("wedge", "side", MeshShape("wedge.obj", 1.0, folder), (0.3, 0.6, 0.0)),
        ),
    )


@pytest.fixture(scope="session")
def toy() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TOY)


def walk(toy: mujoco.MjModel, frames: int) -> np.ndarray:
    """Two metres forward with swinging legs."""
    phase = np.linspace(0.0, 1.0, frames)
    qpos = np.tile(toy.qpos0, (frames, 1))
    qpos[:, 0] = 2.0 * phase
    qpos[:, 7] = 0.5 * np.sin(12 * phase)
    qpos[:, 8] = -qpos[:, 7]
    qpos[:, 9] = 2.0 * phase + 0.4
    return qpos


@pytest.fixture(scope="session")
def record(toy, scene) -> RolloutRecord:
    frames = 101
    qpos = walk(toy, frames)
    arrow_pos = np.stack([qpos[:, :3], qpos[:, 9:12]], axis=1)
    force = np.broadcast_to(np.array([[0.6, 0.0, 0.0], [0.3, 0.0, -0.8]]), (frames, 2, 3))
    return RolloutRecord.from_states(
        toy,
        qpos,
        scene=scene,
        carried=Box((0.3, 0.3, 0.2), 1.5),
        time_s=np.arange(frames) * 0.02,
        outcome="success",
        policy="toy",
        arrow_pos_W=arrow_pos,
        arrow_force_W=force,
        arrow_is_ogf=[False, True],
    )
