"""The compiled pass over spheres on frames against plain torch, and against single points."""

import numpy as np
import pytest
import torch

from hotice.fields.bank import FieldBank
from hotice.fields.clearance import Spheres, lowest_clearance_torch
from hotice.fields.torch_sample import TorchVolumes
from hotice.model.frames import quat_to_mat
from hotice.model.geometry.shapes import BoxShape, SphereShape
from hotice.model.scene import Obstacle, Scene

FRAMES, SPHERES, VARIANTS = 5, 23, 4


@pytest.fixture(scope="module")
def bank():
    """Two scenes of different extents."""
    box = Obstacle("box", "side", BoxShape((0.3, 0.4, 1.0)), (1.0, 0.6, 0.5))
    ball = Obstacle("ball", "overhead", SphereShape(0.2), (1.2, -0.3, 1.2))
    wide = Scene("wide", ((-1.0, -1.5, 0.0), (3.0, 1.5, 1.6)), (0.0, 0.0, 0.0), (2.5, 0.0), (ball, box))
    return FieldBank.build([Scene("one", obstacles=(box,)), wide], 0.1)


def random_case(n, seed=0):
    """Scenes (n,), frames that stick out of the scenes here and there, spheres, variants (n,)."""
    rng = np.random.default_rng(seed)
    quat = rng.normal(size=(n, FRAMES, 4))
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)

    def tensor(a):
        return torch.tensor(a, dtype=torch.float32)

    spheres = Spheres(
        frame=torch.tensor(rng.integers(0, FRAMES, SPHERES)),
        centre=tensor(rng.normal(0.0, 0.2, (VARIANTS, SPHERES, 3))),
        radius=tensor(rng.uniform(0.01, 0.1, (VARIANTS, SPHERES))),
    )
    xpos = tensor(rng.uniform([-1.2, -1.7, -0.2], [3.2, 1.7, 1.8], (n, FRAMES, 3)))
    xmat = tensor(np.stack([quat_to_mat(q) for q in quat.reshape(-1, 4)]).reshape(n, FRAMES, 3, 3))
    return torch.tensor(rng.integers(0, 2, n)), xpos, xmat, spheres, torch.tensor(rng.integers(0, VARIANTS, n))


@pytest.mark.parametrize("n", [1, 40, 400])
def test_the_compiled_pass_is_the_plain_formula(bank, n):
    """Also for so many that several threads share them."""
    case = random_case(n)
    fast, plain = bank.lowest_clearance(*case), lowest_clearance_torch(TorchVolumes.of(bank.volumes), *case)
    assert fast.dtype == torch.float32 and fast.shape == (n,)
    torch.testing.assert_close(fast, plain, atol=2e-6, rtol=0)
    assert n == 1 or (float(fast.min()) < 0.0 < float(fast.max()))


def test_it_is_the_smallest_gap_of_single_spheres(bank):
    scene, xpos, xmat, spheres, variant = random_case(6, seed=1)
    lowest = bank.lowest_clearance(scene, xpos, xmat, spheres, variant)
    for n in range(6):
        gaps = []
        for q in range(SPHERES):
            b, m = int(spheres.frame[q]), int(variant[n])
            p = xpos[n, b] + xmat[n, b] @ spheres.centre[m, q]
            gaps.append(float(bank.signed_distance(scene[n : n + 1], p[None, None])) - float(spheres.radius[m, q]))
        assert float(lowest[n]) == pytest.approx(min(gaps), abs=2e-6)


def test_a_frame_that_is_not_finite_gives_nan_there_alone(bank):
    scene, xpos, xmat, spheres, variant = random_case(3)
    xpos[1, int(spheres.frame[0])] = float("nan")
    found = bank.lowest_clearance(scene, xpos, xmat, spheres, variant)
    assert found.isnan().tolist() == [False, True, False]


def test_strided_frames_give_the_same(bank):
    scene, xpos, xmat, spheres, variant = random_case(8)
    apart = torch.cat([xmat, xmat], dim=1)[:, :FRAMES], torch.cat([xpos, xpos], dim=1)[:, :FRAMES]
    expected = bank.lowest_clearance(scene, xpos, xmat, spheres, variant)
    assert torch.equal(bank.lowest_clearance(scene, apart[1], apart[0], spheres, variant), expected)


def test_scenes_that_are_not_there_are_refused(bank):
    scene, *rest = random_case(3)
    with pytest.raises(IndexError):
        bank.lowest_clearance(scene + 2, *rest)
    with pytest.raises(ValueError):
        bank.lowest_clearance(scene[:2], *rest)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_on_a_gpu(bank):
    scene, xpos, xmat, spheres, variant = random_case(40)
    there = Spheres(**{name: value.cuda() for name, value in vars(spheres).items()})
    found = bank.to("cuda").lowest_clearance(scene.cuda(), xpos.cuda(), xmat.cuda(), there, variant.cuda())
    torch.testing.assert_close(
        found.cpu(), bank.lowest_clearance(scene, xpos, xmat, spheres, variant), atol=2e-6, rtol=0
    )
