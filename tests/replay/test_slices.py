import numpy as np
import pytest
from matplotlib.figure import Figure

from hotice.errors import InvalidConfig, UnknownName
from hotice.fields import build_hod_pf
from hotice.fields.descent import descend
from hotice.model import load_scene
from hotice.replay.slices import draw_descent, draw_slice, slice_points


@pytest.fixture(scope="module")
def beam():
    return build_hod_pf(load_scene("beam"), resolution_m=0.08)


def test_points_lie_in_the_plane_and_fill_the_scene(beam):
    p_W = slice_points(beam, "xz", 0.3, 0.1)
    low, high = np.array(beam.scene.bounds_m)
    assert p_W.shape == (15, 30, 3)
    assert (p_W[..., 1] == 0.3).all()
    np.testing.assert_allclose(p_W[0, 0], [low[0] + 0.05, 0.3, low[2] + 0.05])
    np.testing.assert_allclose(p_W[-1, -1], [high[0] - 0.05, 0.3, high[2] - 0.05])


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
@pytest.mark.parametrize("quantity", ["potential", "geodesic_distance", "signed_distance", "force"])
def test_a_slice_shows_the_asked_quantity(beam, plane, quantity):
    axes = Figure().subplots()
    image = draw_slice(axes, beam, "ogf", plane=plane, at_m=1.0, quantity=quantity)
    p_W = slice_points(beam, plane, 1.0, 0.04)
    guide = beam.ogf
    expected = np.linalg.norm(guide.sample(p_W), axis=-1) if quantity == "force" else getattr(guide, quantity)(p_W)
    shown = image.get_array()
    visible = ~np.ma.getmaskarray(shown)
    np.testing.assert_allclose(shown[visible], expected[visible])
    assert quantity == "signed_distance" or not visible[guide.signed_distance(p_W) <= 0].any()


def test_descent_reaches_the_goal_and_keeps_clear(beam):
    starts_W = np.array([[0.0, 0.0, 1.3], [0.0, 0.4, 0.2]])
    path = descend(beam.ogf, starts_W)
    np.testing.assert_array_equal(path[0], starts_W)
    assert (np.linalg.norm(path[-1] - beam.scene.goal_W, axis=-1) < 0.08).all()
    assert beam.ogf.signed_distance(path).min() > 0
    assert beam.sgf.signed_distance(path).min() > 0.08


def test_a_drawn_descent_returns_its_paths(beam):
    starts_W = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(draw_descent(Figure().subplots(), beam, "sgf", starts_W), descend(beam.sgf, starts_W))


@pytest.mark.parametrize("change", [{"plane": "zx"}, {"quantity": "colour"}, {"field": "ogg"}])
def test_unknown_names_list_the_known(beam, change):
    with pytest.raises(UnknownName, match="known are"):
        draw_slice(Figure().subplots(), beam, **{"field": "sgf", **change})


@pytest.mark.parametrize("at_m, spacing_m", [(1.5, 0.1), (0.0, 0.0), (0.0, 9.0)])
def test_a_plane_that_misses_the_scene_is_refused(beam, at_m, spacing_m):
    with pytest.raises(InvalidConfig):
        slice_points(beam, "xz", at_m, spacing_m)


def test_the_explorer_redraws_when_a_slider_moves():
    pytest.importorskip("ipywidgets")
    from hotice.replay.explorer import field_explorer

    widget = field_explorer(load_scene("gap"), np.array([[0.0, 0.0, 0.75]]), plane="xy", at_m=0.75)
    first, _, picture = widget.children
    before = bytes(picture.value)
    first.children[0].value = 0.2
    after = bytes(picture.value)
    assert before.startswith(b"\x89PNG") and after.startswith(b"\x89PNG") and after != before
