import numpy as np
import pytest

pytest.importorskip("cv2", reason="tags are found with OpenCV: the extra `deploy`")

from hotice.deploy.camera import HEAD_CAMERA
from hotice.deploy.frames import Pose
from hotice.deploy.tags import TagDetector, box_bundle
from hotice.deploy.tags.markers import black_cells
from hotice.deploy.tags.rendering import NO_OPTICS, mirrored
from hotice.errors import InvalidState, UnknownName
from tests.deploy.tags_fixture import BOX, CARRY, PICK_UP, X_PC, near_pose, take

BUNDLE = box_bundle(BOX)


@pytest.mark.parametrize("place, ids", [(CARRY, [0, 1, 2, 3]), (PICK_UP, [0, 1, 2, 3, 4, 5, 6, 7])])
def test_corners_are_where_the_bundle_has_them_in_its_order(place, ids, rng):
    X_PO = near_pose(rng, place)
    found = TagDetector(BUNDLE.ids).detect(take(X_PO, rng))
    assert found.ids.tolist() == ids and found.foreign == found.doubled == 0
    wished = HEAD_CAMERA.pixels((X_PC.inverse @ X_PO).points(BUNDLE.corners_O[ids]))
    assert np.abs(found.corners_px - wished).max() < 0.8
    # no bias: a whole number is the middle of a pixel
    assert np.abs((found.corners_px - wished).mean(axis=(0, 1))).max() < 0.1


def test_a_mirrored_print_is_no_tag(rng):
    found = TagDetector(BUNDLE.ids).detect(take(near_pose(rng), rng, printing=mirrored))
    assert found.ids.tolist() == [] and found.corners_px.shape == (0, 4, 2)


def test_foreign_tags_are_dropped_and_counted(rng):
    found = TagDetector((0, 2, 99)).detect(take(near_pose(rng), rng))
    assert found.ids.tolist() == [0, 2] and found.foreign == 2
    assert TagDetector((99,)).detect(take(near_pose(rng), rng)).foreign == 4


def test_an_id_that_is_there_twice_is_not_believed(rng):
    """Another box with the same sheets stands half behind the carried one."""
    other = Pose(np.eye(3), np.array([0.75, 0.05, -0.07]))
    behind = take(other, rng, optics=NO_OPTICS)
    X_PO = near_pose(rng)
    found = TagDetector(BUNDLE.ids).detect(take(X_PO, rng, onto=behind))
    assert found.ids.tolist() == [] and found.doubled == 8
    # a single one beside them may be the other box's
    half = TagDetector((0, 1)).detect(_without(take(X_PO, rng, onto=behind), X_PO, tag=1))
    assert half.ids.tolist() == [] and half.doubled == 2


def _without(picture, X_PO, *, tag):
    """A picture in which something dark hides a tag."""
    pixels = HEAD_CAMERA.pixels((X_PC.inverse @ X_PO).points(BUNDLE.corners_O[tag]))
    (left, upper), (right, lower) = np.round(pixels.min(axis=0)).astype(int), np.round(pixels.max(axis=0)).astype(int)
    picture[upper:lower, left:right] = 60
    return picture


def test_no_tag_in_noise(rng):
    found = TagDetector(BUNDLE.ids).detect(rng.integers(0, 256, (480, 640)).astype(np.uint8))
    assert not len(found.ids)


@pytest.mark.parametrize("picture", [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.zeros((0, 4), np.uint8)])
def test_only_grey_pictures(picture):
    with pytest.raises(InvalidState, match="grey is needed"):
        TagDetector(BUNDLE.ids).detect(picture)


def test_a_pattern_has_a_black_border():
    cells = black_cells(7)
    assert cells.shape == (8, 8) and cells[[0, -1]].all() and cells[:, [0, -1]].all() and not cells.all()
    with pytest.raises(UnknownName, match="0 to 586"):
        black_cells(587)


@pytest.mark.parametrize("place", [(-0.8, 0.0, 0.0), (0.1, 0.0, 0.4), (0.0537, 0.0175, 0.3489)])
def test_a_box_behind_or_around_the_camera_can_be_drawn(place, rng):
    picture = take(Pose(np.eye(3), np.array(place)), rng)
    assert picture.shape == (480, 640) and not len(TagDetector(BUNDLE.ids).detect(picture).ids)
