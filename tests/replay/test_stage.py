"""Every film needs OpenGL without a screen; where there is none these tests are skipped, with the reason."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb

from hotice.model import Box
from hotice.model.geometry.shapes import BoxShape, MeshShape
from hotice.model.moving import Motion, WayPoint
from hotice.model.scene import Obstacle, Scene
from hotice.replay.offscreen import NoRenderer, find_renderer
from hotice.replay.palette import CATEGORY_COLORS, GOAL_COLOR, SGF_COLOR, SKY
from hotice.replay.rollout import RolloutRecord
from hotice.replay.stage import SEE_THROUGH, Stage

SIZE_PX = (320, 180)


@pytest.fixture(scope="module", autouse=True)
def renderer():
    try:
        find_renderer()
    except NoRenderer as error:
        pytest.skip(str(error))


def a_record(*obstacles, arrows=False):
    """Two frames of a dark cube that stands on the floor at the start, and of a small one far above it."""
    more = dict(arrow_pos_W=np.full((2, 1, 3), 0.6), arrow_force_W=np.full((2, 1, 3), 9.0), arrow_is_ogf=[False])
    return RolloutRecord(
        scene=Scene("made", goal=(1.2, 0.0), obstacles=obstacles),
        carried=Box((0.1, 0.1, 0.1), 1.0),
        time_s=[0.0, 1.0],
        geom_names=["pelvis", "load"],
        geom_types=["box", "box"],
        geom_sizes=[[0.2, 0.2, 0.2], [0.02, 0.02, 0.02]],
        geom_rgba=[[0.1, 0.1, 0.1, 1.0], [0.9, 0.6, 0.3, 1.0]],
        geom_pos_W=[[[0.0, 0.0, 0.2], [0.0, 0.0, 0.7]]] * 2,
        geom_quat_W=[[[1.0, 0.0, 0.0, 0.0]] * 2] * 2,
        geom_is_object=[False, True],
        root_pos_W=[[0.0, 0.0, 0.75]] * 2,
        object_pos_W=[[0.0, 0.0, 0.7]] * 2,
        outcome="success",
        policy="none",
        **(more if arrows else {}),
    )


def drawn(record, frame=0):
    with Stage(record, SIZE_PX) as stage:
        return stage.draw(frame) / 255.0


def is_of(image, color, within=0.04):
    """(H, W) where the hue is a colour's: light and haze change the rest."""
    ratio = image / np.maximum(image.sum(axis=-1, keepdims=True), 1e-9)
    wanted = np.array(to_rgb(color)) / np.sum(to_rgb(color))
    return np.abs(ratio - wanted).max(axis=-1) < within


def share_of(image, color, within=0.04):
    return float(is_of(image, color, within).mean())


def test_the_sky_meets_the_floor_without_an_edge():
    image = drawn(a_record())
    assert np.abs(image[0] - to_rgb(SKY)).max() < 0.02
    # down the left side, where nothing stands: no step of brightness but the lines of the floor
    assert np.abs(np.diff(image[:, 4].mean(axis=-1))).max() < 0.04


def test_the_cube_throws_a_shadow_away_from_the_sun():
    with Stage(a_record(), SIZE_PX) as stage:
        image = stage.draw(0).mean(axis=-1)
        stage._model.light_castshadow[:] = 0
        without = stage.draw(0).mean(axis=-1)
    darker = np.argwhere(without - image > 15)
    lighter = np.argwhere(image - without > 15)
    assert len(darker) > 100 and len(lighter) == 0
    # the sun stands behind and to the left: the shadow falls ahead, to the right of the cube
    cube = np.argwhere(without < 60)
    assert darker[:, 1].mean() > cube[:, 1].mean()


def test_goal_arrows_and_obstacles_have_the_colours_of_the_palette():
    beam = Obstacle("beam", "overhead", BoxShape((0.3, 0.3, 0.3)), (0.7, 0.9, 0.9))
    bare, full = drawn(a_record()), drawn(a_record(beam, arrows=True))
    assert share_of(bare, GOAL_COLOR) > 3e-4
    # an arrow is two pixels wide here
    for color, within in ((CATEGORY_COLORS["overhead"], 0.04), (SGF_COLOR, 0.12)):
        assert share_of(bare, color, within) == 0.0 and share_of(full, color, within) > 1e-4


def test_no_face_is_black():
    """Faces that the sun does not reach keep half of their colour at least."""
    beam = Obstacle("beam", "overhead", BoxShape((0.6, 0.6, 0.6)), (0.7, 0.0, 1.1))
    image = drawn(a_record(beam))
    color = CATEGORY_COLORS["overhead"]
    faces = image[is_of(image, color)]
    assert len(faces) > 1000 and (faces.sum(axis=-1) > 0.5 * sum(to_rgb(color))).mean() > 0.99


def test_what_moves_is_where_it_is_at_the_frames_time():
    way = Motion(way_points=tuple(WayPoint(time_s=t, position_m=(0.7 + 1.5 * t, 0.9, 0.9)) for t in (0.0, 1.0)))
    record = a_record(Obstacle("lamp", "overhead", BoxShape((0.3, 0.3, 0.3)), (0.7, 0.9, 0.9), motion=way))
    places = []
    with Stage(record, SIZE_PX) as stage:
        for frame in (0, 1):
            image = stage.draw(frame) / 255.0
            places.append(np.argwhere(is_of(image, CATEGORY_COLORS["overhead"])).mean(axis=0))
    # 1.5 m ahead is to the right of the camera
    assert places[1][1] - places[0][1] > 0.15 * SIZE_PX[0]


def test_meshes_are_drawn(tmp_path):
    (tmp_path / "tip.obj").write_text("v 0 0 0\nv .5 0 0\nv 0 .5 0\nv 0 0 .5\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    tip = Obstacle("tip", "overhead", MeshShape(str(tmp_path / "tip.obj")), (0.7, 0.9, 0.9))
    assert share_of(drawn(a_record(tip)), CATEGORY_COLORS["overhead"]) > 0.002


def test_an_obstacle_before_the_robot_is_seen_through():
    before = Obstacle("before", "side", BoxShape((0.9, 0.1, 1.4)), (0.4, -0.8, 0.7))
    beside = Obstacle("beside", "side", BoxShape((0.2, 0.2, 1.4)), (0.3, 1.2, 0.7))
    with Stage(a_record(before, beside), SIZE_PX) as stage:
        stage.draw(0)
        opacity = stage._model.geom_rgba[stage._obstacles, 3]
    assert opacity.tolist() == pytest.approx([SEE_THROUGH, 1.0])
