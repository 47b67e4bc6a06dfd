import subprocess
import sys

import numpy as np
import pytest
import torch

from hotice.fields.alignment import ENCODE_SCALE, cosine, encode, observed, residual_cosine


def test_cosine_values():
    a = torch.tensor([[2.0, 0, 0], [0, 3.0, 0], [1.0, 1, 0], [0, 0, 0]])
    b = torch.tensor([1.0, 0, 0]).expand(4, 3)
    want = torch.tensor([1.0, 0, 2**-0.5, 0])
    torch.testing.assert_close(cosine(a, b), want, atol=2e-3, rtol=0)
    torch.testing.assert_close(cosine(-a, b), -want, atol=2e-3, rtol=0)
    g = torch.Generator().manual_seed(0)
    x, y = torch.randn(2, 1000, 3, generator=g) * 10
    assert cosine(x, y).abs().max() <= 1.0
    torch.testing.assert_close(cosine(x, y, 1e-9), torch.nn.functional.cosine_similarity(x, y, dim=-1))


def test_cosine_has_finite_gradient_at_zero():
    v = torch.zeros(2, 5, 3, requires_grad=True)
    cosine(v, torch.ones(2, 5, 3)).sum().backward()
    assert v.grad is not None and v.grad.isfinite().all()


def test_residual_removes_the_common_command():
    c = torch.tensor([[0.4, 0.0, 0.0]])
    lift = torch.tensor([[[0.0, 0.0, 0.2], [0.0, 0.1, 0.0]]])
    together = residual_cosine(c[:, None] + lift, c[:, None] + 2 * lift, c)
    torch.testing.assert_close(together, torch.ones(1, 2), atol=0.03, rtol=0)
    assert residual_cosine(c[:, None] + lift, c[:, None].expand(1, 2, 3), c).abs().max() == 0


@pytest.mark.parametrize("scale", [ENCODE_SCALE, 1.0])
def test_numpy_and_torch_give_the_same(scale):
    rng = np.random.default_rng(0)
    a, b, c, away = rng.normal(size=(7, 3)), rng.normal(size=(7, 3)), rng.normal(size=3), rng.uniform(-1.0, 1.0, 7)
    a[0] = 0.0
    tensors = [torch.from_numpy(x) for x in (a, b, c, away)]
    ours = (cosine(a, b, 0.1), residual_cosine(a, b, c, 0.1), encode(a, scale), observed(a, away))
    theirs = (
        cosine(*tensors[:2], 0.1),
        residual_cosine(*tensors[:3], 0.1),
        encode(tensors[0], scale),
        observed(tensors[0], tensors[3]),
    )
    for one, other in zip(ours, theirs, strict=True):
        assert isinstance(one, np.ndarray) and isinstance(other, torch.Tensor)
        np.testing.assert_allclose(one, other, atol=1e-14)
    np.testing.assert_allclose(ours[2][:, 3], np.tanh(np.linalg.norm(a, axis=1) / scale), atol=1e-9)
    np.testing.assert_allclose(ours[3][:, 4], 2.0 * away.clip(-0.1, 0.5))


def test_encode():
    f = torch.tensor([[0.0, 0, 0], [0.6, 0, 0], [0, 0, -100.0]])
    e = encode(f)
    assert e.shape == (3, 4) and e.isfinite().all()
    want = torch.tensor([[0.0, 0, 0, 0], [1, 0, 0, 0.76159], [0, 0, -1, 1]])
    torch.testing.assert_close(e, want, atol=1e-4, rtol=0)


def test_building_fields_needs_no_torch():
    code = (
        "import sys; sys.modules['torch'] = None; import numpy as np\n"
        "from hotice.fields import build_hod_pf\nfrom hotice.model import load_scene\n"
        "f = build_hod_pf(load_scene('gap'), resolution_m=0.1).sgf\n"
        "print(f.sample(np.zeros((2, 3))).shape, f.geodesic_distance(np.zeros(3)).shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "(2, 3) ()"
