import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from hotice.model import Scene, load_scene
from hotice.model.moving.person import walking_person
from hotice.replay.maps import draw_map


def test_a_map_shows_the_way_of_what_moves():
    axes, people = Figure().subplots(), walking_person("ann", [(1.0, -0.9), (1.0, 0.9)], 0.9)
    draw_map(axes, Scene("s", obstacles=people))
    for line in axes.lines:
        np.testing.assert_allclose(line.get_xydata()[[0, -1]], [(1.0, -0.9), (1.0, 0.9)])
    assert len(axes.lines) == 2


def test_a_map_shows_every_obstacle_where_it_stands_and_the_path():
    scene = load_scene("gap")
    axes = Figure().subplots()
    path_W = np.array([[0.0, 0.0, 0.1], [1.0, 0.2, 0.0], [2.0, 0.0, 0.0]])
    draw_map(axes, scene, path_W)
    shapes = [c for c in axes.collections if isinstance(c, PolyCollection)]
    assert len(shapes) == len(scene.obstacles)
    for obstacle, shape in zip(scene.obstacles, shapes, strict=True):
        corners = shape.get_paths()[0].vertices
        np.testing.assert_allclose(
            0.5 * (corners.min(axis=0) + corners.max(axis=0)), obstacle.position_m[:2], atol=1e-6
        )
    (line,) = axes.lines
    np.testing.assert_array_equal(line.get_xydata(), path_W[:, :2])
    assert axes.get_xlim() == (scene.bounds_m[0][0], scene.bounds_m[1][0])
