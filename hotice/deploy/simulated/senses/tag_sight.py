"""Sight of a simulated robot's head camera: corners of the tags on its box, with pixel noise, what hides them too."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from hotice.deploy.camera import HEAD_CAMERA, Camera
from hotice.deploy.frames import X_TC, Pose
from hotice.deploy.simulated.senses.posting import Posting
from hotice.deploy.simulated.world import World
from hotice.deploy.sources.protocol import Sender
from hotice.deploy.sources.records import TagSample
from hotice.deploy.tags import TagBundle
from hotice.model import builder, g1

Array = NDArray[np.float64]
RATE_HZ = 30.0
CORNER_PX = 0.3
"""Standard deviation of a corner's noise: between a sharp picture's and a blurred one's (ours)."""
LATENCY_S = 0.033
"""From exposure to corners (ours)."""
LEAST_FACING = 0.15
"""Least cosine between a tag's normal and the way to the camera at which it is found (ours)."""
HIDDEN = 0.99
"""A ray that ends before this share of its way is hidden."""
FOREIGN = 400
"""Added to the id of a foreign tag."""


class TagSight:
    """Finds tags at 30 Hz; a tag is found if all of its corners are in the picture, and none is hidden."""

    def __init__(
        self,
        world: World,
        bundle: TagBundle,
        sender: Sender,
        rng: np.random.Generator,
        *,
        corner_px: float = CORNER_PX,
        latency_s: float = LATENCY_S,
        occlusion: bool = True,
        camera: Camera = HEAD_CAMERA,
    ) -> None:
        self._world, self._bundle, self._camera, self._rng = world, bundle, camera, rng
        self._posting = Posting(sender, RATE_HZ, latency_s)
        self._corner_px, self._occlusion = corner_px, occlusion
        self._torso = world.model.body(g1.TORSO_BODY).id
        self._object = world.model.body(builder.OBJECT_BODY).id
        self.lost = self.foreign = False

    def live(self, time_s: float, stamp_s: float | None = None) -> None:
        """Takes a picture if it is time, and sends what is due; `stamp_s` as of localization. Raises `LinkError`."""
        if self._posting.due(time_s):
            ids, corners = ([], np.zeros((0, 4, 2))) if self.lost else self.look()
            found = np.array(ids, dtype=np.int64) + (FOREIGN if self.foreign else 0)
            sample = TagSample(
                number=self._posting.number,
                measured_s=time_s if stamp_s is None else stamp_s,
                ids=found,
                corners_px=corners,
            )
            self._posting.post(sample.encode(), time_s)
        self._posting.send(time_s)

    def look(self) -> tuple[list[int], Array]:
        """Ids and noisy corners (T, 4, 2) [px] of the tags that are found now."""
        data = self._world.data
        X_WC = Pose.of(data.xpos[self._torso], data.xquat[self._torso]) @ X_TC
        X_WO = Pose.of(data.xpos[self._object], data.xquat[self._object])
        corners_W = X_WO.points(self._bundle.corners_O)
        pixels = self._camera.pixels(X_WC.inverse.points(corners_W))
        noise = self._corner_px * self._rng.standard_normal(pixels.shape)
        sight = X_WC.p - corners_W.mean(axis=1)
        facing = np.einsum("ti,ti->t", sight, self._bundle.normals_O @ X_WO.R.T) / np.linalg.norm(sight, axis=1)
        found = (facing > LEAST_FACING) & self._camera.inside(pixels).all(axis=1)
        if self._occlusion:
            found &= np.array([bool(f) and self._open(X_WC.p, c) for f, c in zip(found, corners_W, strict=True)])
        index = np.flatnonzero(found)
        return [self._bundle.ids[i] for i in index], (pixels + noise)[index]

    def _open(self, eye: Array, corners_W: Array) -> bool:
        """Whether nothing but the torso, in which the camera sits, is between it and the corners (4, 3)."""
        hit = np.zeros(1, np.int32)
        for corner in corners_W:
            share = mujoco.mj_ray(self._world.model, self._world.data, eye, corner - eye, None, True, self._torso, hit)
            if 0.0 <= share < HIDDEN:
                return False
        return True
