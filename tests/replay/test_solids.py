import numpy as np
import pytest

from hotice.replay.solids import outline, triangles

VOLUMES = {
    ("box", (0.1, 0.2, 0.3)): 8 * 0.1 * 0.2 * 0.3,
    ("sphere", (0.2,)): 4 / 3 * np.pi * 0.2**3,
    ("ellipsoid", (0.1, 0.2, 0.3)): 4 / 3 * np.pi * 0.1 * 0.2 * 0.3,
    ("cylinder", (0.1, 0.4)): np.pi * 0.1**2 * 0.8,
    ("capsule", (0.1, 0.4)): np.pi * 0.1**2 * 0.8 + 4 / 3 * np.pi * 0.1**3,
}


@pytest.mark.parametrize(("solid", "volume"), VOLUMES.items())
def test_surface_is_closed_faces_outwards_and_holds_the_volume(solid, volume):
    vertices, faces = triangles(*solid, 64)
    corner = vertices[faces]
    # Divergence theorem: only a closed surface whose normals point outwards has the solid's volume.
    signed = np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6.0
    assert signed == pytest.approx(volume, rel=0.01)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ij,ij->i", normal, corner.mean(axis=1)) > 0).all()


def test_unknown_solid():
    with pytest.raises(ValueError, match="known are box"):
        triangles("cone", (1.0,))


def test_outline_is_the_convex_hull():
    rng = np.random.default_rng(0)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    hull = outline(np.concatenate([rng.uniform(0.05, 0.95, (100, 2)), square]))
    assert {tuple(p) for p in hull} == {tuple(p) for p in square}
    x, y = hull.T
    assert 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(1.0)
