import re
import zlib

import numpy as np
import pytest

pytest.importorskip("cv2", reason="tags are printed from OpenCV's patterns: the extra `deploy`")

from hotice.deploy.tags import TagDetector, box_bundle
from hotice.deploy.tags.rendering import PIXELS_MM, page_picture
from hotice.deploy.tags.sheet import draw_sheets, on_page_mm, write_sheets
from hotice.errors import InvalidConfig, OutputError
from hotice.model.objects import Box
from tests.deploy.tags_fixture import BOX

FACES = box_bundle(BOX).faces


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.name)
def test_printed_tags_are_where_the_bundle_has_them(face):
    """The page's own drawing, rastered: 0.2 mm is 1.6 of its pixels."""
    page = page_picture(face)
    assert page.shape == (297 * PIXELS_MM, 210 * PIXELS_MM)
    found = TagDetector(face.ids).detect(page)
    assert found.ids.tolist() == list(face.ids) and found.foreign == found.doubled == 0
    across = (found.corners_px + 0.5) / PIXELS_MM
    on_page = np.stack([across[..., 0], 297.0 - across[..., 1]], axis=-1)
    assert np.abs(on_page - on_page_mm(face, face.corners_O())).max() < 0.2
    assert np.linalg.norm(on_page[:, 0] - on_page[:, 1], axis=-1) == pytest.approx(np.full(4, 50.0), abs=0.2)


def test_a_white_margin_of_a_cell_is_around_each_tag():
    page = page_picture(FACES[0])
    for corners in on_page_mm(FACES[0], FACES[0].corners_O()):
        (left, lower), (right, upper) = corners.min(axis=0), corners.max(axis=0)
        outer = page[_rows(upper + 6.2, lower - 6.2), _columns(left - 6.2, right + 6.2)].copy()
        assert outer.min() < 10
        inner = round(6.0 * PIXELS_MM)
        outer[inner:-inner, inner:-inner] = 255
        assert outer.min() > 250


def _rows(upper: float, lower: float) -> slice:
    return slice(round((297.0 - upper) * PIXELS_MM), round((297.0 - lower) * PIXELS_MM))


def _columns(left: float, right: float) -> slice:
    return slice(round(left * PIXELS_MM), round(right * PIXELS_MM))


def test_the_pdf_has_a_page_of_a4_for_each_face_in_vectors(tmp_path):
    data = write_sheets(BOX, tmp_path / "tags.pdf").read_bytes()
    boxes = re.findall(rb"/MediaBox \[ ([\d. ]+) \]", data)
    assert len(boxes) == 2
    for box in boxes:
        # 72 points an inch
        assert np.array(box.split(), float) * 25.4 / 72.0 == pytest.approx([0.0, 0.0, 210.0, 297.0], abs=0.01)
    assert b"/Subtype /Image" not in data
    assert write_sheets(BOX, tmp_path / "again.pdf").read_bytes() == data


def test_the_pdf_has_the_ruler_and_the_tags_at_true_scale(tmp_path):
    """Read from the page's own operators: the ruler's ends, and the outline of all black cells."""
    data = write_sheets(BOX, tmp_path / "tags.pdf").read_bytes()
    page = next(each for each in _streams(data) if b"re f" in each or b" l\n" in each)
    mm = np.array(re.findall(rb"^([\d.]+) ([\d.]+) [ml]$", page, re.M), float) * 25.4 / 72.0
    for x in (55.0, 155.0):
        assert np.isclose(mm, (x, 45.0), atol=0.02).all(axis=1).any()
    for corner in on_page_mm(FACES[0], FACES[0].corners_O()).reshape(-1, 2):
        assert np.isclose(mm, corner, atol=0.02).all(axis=1).any()


def _streams(data: bytes) -> list[bytes]:
    """Compressed streams of a PDF."""
    found = []
    for match in re.finditer(rb"/FlateDecode.*?stream\r?\n(.*?)\r?\nendstream", data, re.S):
        found.append(zlib.decompress(match[1]))
    return found


def test_a_page_says_what_to_do_with_it():
    top, near = ([text.get_text() for text in page.axes[0].texts] for page in draw_sheets(BOX))
    assert "box of 300 × 300 × 250 mm: top face" in top and "box of 300 × 300 × 250 mm: near face" in near
    assert {"id 0", "id 1", "id 2", "id 3", "this edge: away from the robot", "this edge: toward the robot"} <= set(top)
    assert {"id 4", "id 7", "this edge: up", "this edge: down"} <= set(near)
    # 150 mm to the far edge, the sheet's middle 35 mm ahead and its half 70 mm
    assert any("upper edge 45 mm" in text and "80 mm from the left" in text for text in top)
    assert any("upper edge 55 mm" in text for text in near)


def test_each_box_may_have_its_own_ids():
    top, near = box_bundle(BOX, first_id=16).faces
    assert top.ids == (16, 17, 18, 19) and near.ids == (20, 21, 22, 23)
    assert TagDetector(near.ids).detect(page_picture(near)).ids.tolist() == [20, 21, 22, 23]
    assert box_bundle(BOX, first_id=579).ids[-1] == 586
    with pytest.raises(InvalidConfig, match="0 to 586"):
        box_bundle(BOX, first_id=580)


def test_what_cannot_be_printed(tmp_path):
    with pytest.raises(InvalidConfig, match=r"side z is too small, a sheet of tags needs at least 0.14 m"):
        write_sheets(Box((0.3, 0.3, 0.13), 1.5), tmp_path / "tags.pdf")
    with pytest.raises(OutputError):
        write_sheets(BOX, tmp_path / "nowhere" / "deeper" / "\0")
