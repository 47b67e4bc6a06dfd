import numpy as np
import pytest
import torch

from hotice.errors import InvalidConfig, UnknownName
from hotice.fields import FieldBank, FieldParams, build_hod_pf, torch_sample
from hotice.fields import sample as compiled
from hotice.fields.potential import f_rep, f_rep_scalar, u_rep
from hotice.fields.volumes import Volumes, pack
from hotice.model import Obstacle, Scene, load_scene
from hotice.model.geometry.shapes import BoxShape

PARAMS = FieldParams()


def wide_scene():
    box = Obstacle("box", "side", BoxShape((0.4, 0.4, 1.0)), (1.0, 0.4, 0.5))
    return Scene("wide", ((-1.0, -1.5, 0.0), (3.0, 1.5, 1.6)), (0, 0, 0.5), (2.5, -0.5), (box,))


@pytest.fixture(scope="module")
def scenes():
    return [load_scene("gap"), load_scene("table_edge"), wide_scene()]


@pytest.fixture(scope="module")
def bank(scenes):
    return FieldBank.build(scenes)


def affine_volumes(dtype=np.float32):
    """Two scenes of different extent whose distance and geodesic are affine; returns the coefficients too."""
    rng = np.random.default_rng(0)
    h, shapes = 0.1, np.array([[7, 5, 4], [4, 6, 8]])
    origin = rng.uniform(-1, 1, (2, 3)).astype(np.float32)
    coefficients = rng.uniform(-1, 1, (2, 5, 4)) * [[1.0], [1.0], [0.2], [0.2], [0.2]]
    coefficients[:, 1, 3] += 10.0
    sdf, packed = [], []
    for s in range(2):
        p = origin[s] + np.stack(np.meshgrid(*map(np.arange, shapes[s]), indexing="ij"), -1).reshape(-1, 3) * h
        values = np.column_stack([p, np.ones(len(p))]) @ coefficients[s].T
        sdf.append(values[:, 0] + 20.0)
        packed.append(pack(values[:, 1], values[:, 2:]))
    sizes = shapes.prod(axis=1)
    offset = np.array([0, sizes[0]])
    volumes = Volumes(
        h,
        origin,
        shapes,
        offset,
        np.array([[step] for _, step in packed], np.float32),
        np.concatenate(sdf).astype(dtype),
        (np.concatenate([g for g, _ in packed]),),
    )
    return volumes, coefficients


@pytest.mark.parametrize("count", [10, compiled.PARALLEL_FROM])
@pytest.mark.parametrize("kind", ["compiled", "torch"])
def test_sampling_is_exact_on_affine_fields(kind, count):
    volumes, coefficients = affine_volumes()
    rng = np.random.default_rng(1)
    ids = np.arange(6) % 2
    u = rng.uniform(-0.5, 0.5, (6, count, 3))
    p = volumes.origin[ids][:, None] + (u + 0.5) * (volumes.shape[ids][:, None] * 0.1) - 0.05
    p = p.astype(np.float32)
    if kind == "compiled":
        force, s, g, raw = np.empty_like(p), *(np.empty(p.shape[:2], np.float32) for _ in range(3))
        compiled.sample_field(volumes, 0, 0.5, PARAMS, ids, p, force, s, g)
        compiled.sample_distance(volumes, ids, p, raw)
    else:
        v = torch_sample.TorchVolumes.of(volumes)
        tp, tids = torch.from_numpy(p), torch.from_numpy(ids)
        force, s, g = (t.numpy() for t in torch_sample.sample_field(v, 0, 0.5, PARAMS, tids, tp))
        raw = torch_sample.sample_distance(v, tids, tp).numpy()
    truth = np.einsum("nij,nkj->nki", coefficients[ids], np.concatenate([p, np.ones_like(p[..., :1])], axis=-1))
    np.testing.assert_allclose(raw, truth[..., 0] + 20.0, atol=1e-5)
    np.testing.assert_allclose(s, truth[..., 0] + 19.5, atol=1e-5)
    np.testing.assert_allclose(g, truth[..., 1], atol=4 * volumes.step.max())
    # half a step, tripled along each axis beyond nodes
    np.testing.assert_allclose(force, -0.6 * truth[..., 2:], atol=1e-4)


def test_slope_of_an_affine_distance_is_exact_up_to_the_border():
    """With distance x and d0 large, the repulsive force along x is f_rep(x) exactly."""
    scene = Scene("x", obstacles=(Obstacle("w", "side", BoxShape((2.0, 90, 90)), (-1.5, 0, 0)),), start=(0, 0, 0))
    params = FieldParams(influence_distance_m=5.0, repulsion=1.0)
    with_push, without = (build_hod_pf(scene, 0.1, params=p).sgf for p in (params, FieldParams(repulsion=1e-12)))
    p = np.random.default_rng(2).uniform([-0.5, -1, 0], [2.5, 1, 1.5], (500, 3))
    push = with_push.sample(p) - without.sample(p)
    np.testing.assert_allclose(push[:, 0], f_rep(p[:, 0] + 0.5, params), rtol=2e-4)
    np.testing.assert_allclose(push[:, 1:], 0, atol=1e-3)


def test_compiled_equals_torch_everywhere(bank):
    rng = np.random.default_rng(3)
    p = torch.tensor(rng.uniform([-2, -2, -1], [4, 2, 3], (60, 50, 3)), dtype=torch.float32)
    ids = torch.tensor(rng.integers(0, 3, 60))
    v = torch_sample.TorchVolumes.of(bank.volumes)
    for field, name, margin in ((0, "sgf", 0.0), (1, "ogf", 0.08)):
        got = bank.sample(name, ids, p)
        want = torch_sample.sample_field(v, field, margin, bank.params, ids, p)
        scale = 1 + want[0].abs()
        assert ((got.force_W - want[0]).abs() / scale).max() < 2e-3
        torch.testing.assert_close(got.signed_distance, want[1], atol=2e-6, rtol=1e-5)
        torch.testing.assert_close(got.geodesic, want[2], atol=2e-6, rtol=1e-5)
    torch.testing.assert_close(bank.signed_distance(ids, p), torch_sample.sample_distance(v, ids, p), atol=2e-6, rtol=0)


def test_bank_equals_guidance_field(scenes, bank):
    rng = np.random.default_rng(4)
    p = rng.uniform([-0.5, -1, 0], [2.5, 1, 1.5], (len(scenes), 300, 3)).astype(np.float32)
    for i, scene in enumerate(scenes):
        pf = build_hod_pf(scene)
        for name in ("sgf", "ogf"):
            field = getattr(pf, name)
            got = bank.sample(name, torch.tensor([i]), torch.from_numpy(p[i : i + 1]))
            np.testing.assert_allclose(got.force_W[0], field.sample(p[i]), rtol=1e-3, atol=1e-4)
            np.testing.assert_allclose(got.signed_distance[0], field.signed_distance(p[i]), atol=1e-6)
            np.testing.assert_allclose(got.geodesic[0], field.extended_geodesic_distance(p[i]), atol=1e-6)
        raw = bank.signed_distance(torch.tensor([i]), torch.from_numpy(p[i : i + 1]))[0]
        np.testing.assert_allclose(raw, scene.signed_distance(p[i]).clip(max=10), atol=0.03)


def test_bank_on_another_device_takes_the_torch_path(bank):
    other = FieldBank(bank.scenes, bank.volumes, bank.margin_m, bank.params)
    other._torch = torch_sample.TorchVolumes.of(bank.volumes, "cpu")
    p = torch.rand(5, 7, 3, generator=torch.Generator().manual_seed(0)) + torch.tensor([0.0, -0.5, 0.2])
    ids = torch.arange(5) % 3
    for a, b in zip(bank.sample("ogf", ids, p), other.sample("ogf", ids, p), strict=True):
        torch.testing.assert_close(a, b, rtol=2e-3, atol=1e-4)
    torch.testing.assert_close(bank.signed_distance(ids, p), other.signed_distance(ids, p), rtol=1e-5, atol=2e-6)


def test_bank_facts_and_errors(scenes, bank):
    assert bank.names == ["gap", "table_edge", "wide"] and bank.num_scenes == 3
    torch.testing.assert_close(bank.goal_W[2], torch.tensor([2.5, -0.5, 0.75]))
    torch.testing.assert_close(bank.start[2], torch.tensor([0.0, 0.0, 0.5]))
    assert bank.index("wide") == 2 and bank.to("cpu") is bank
    default = FieldBank.build(scenes[:1])
    assert default.volumes.nbytes < 6e6
    p = torch.zeros(2, 4, 3)
    for ids in ([0, 3], [-1, 0]):
        with pytest.raises(IndexError, match="holds 0 .. 2"):
            bank.signed_distance(torch.tensor(ids), p)
    with pytest.raises(ValueError, match="are needed"):
        bank.sample("sgf", torch.zeros(3, dtype=torch.long), p)
    with pytest.raises(UnknownName, match="known are ogf, sgf"):
        bank.sample("f", torch.zeros(2, dtype=torch.long), p)
    with pytest.raises(UnknownName, match="gap"):
        bank.index("lost")
    with pytest.raises(InvalidConfig, match="no scenes"):
        FieldBank.build([])
    assert bank.sample("sgf", torch.zeros(0, dtype=torch.long), torch.zeros(0, 4, 3)).force_W.shape == (0, 4, 3)


def test_nan_and_infinite_positions(bank):
    p = torch.tensor([[[float("nan"), 0, 0], [float("inf"), 0, 0], [0, -float("inf"), 1e30]]])
    ids = torch.zeros(1, dtype=torch.long)
    d = bank.signed_distance(ids, p)
    f = bank.sample("sgf", ids, p).force_W
    assert d[0, 0].isnan() and f[0, 0].isnan().any()
    assert d[0, 1:].isfinite().all() and f[0, 1:].isfinite().all()


def test_zero_margin_makes_the_fields_equal():
    pf = build_hod_pf(load_scene("table_edge"), margin_m=0.0)
    p = np.random.default_rng(5).uniform([-1, -1.5, -0.5], [3, 1.5, 2], (2000, 3))
    np.testing.assert_array_equal(pf.sgf.sample(p), pf.ogf.sample(p))
    np.testing.assert_array_equal(pf.sgf.potential(p), pf.ogf.potential(p))
    np.testing.assert_array_equal(pf.sgf.geodesic_distance(p), pf.ogf.geodesic_distance(p))


def test_ogf_is_the_sgf_of_inflated_obstacles():
    """A wall is inflated by moving its face: OGF of one equals SGF of the other (on the far side, exactly)."""
    thin, thick = (
        Scene("w", obstacles=(Obstacle("w", "side", BoxShape((t, 90, 0.4)), (1.0, 0, z)),))
        for t, z in ((0.2, 0.1), (0.36, 0.18))
    )
    ogf, sgf = build_hod_pf(thin, margin_m=0.08).ogf, build_hod_pf(thick).sgf
    p = np.random.default_rng(6).uniform([-0.5, -1, 0], [0.8, 1, 0.25], (500, 3))
    np.testing.assert_allclose(ogf.signed_distance(p), sgf.signed_distance(p), atol=1e-3)
    difference = np.linalg.norm(ogf.sample(p) - sgf.sample(p), axis=1) / np.linalg.norm(sgf.sample(p), axis=1)
    assert np.median(difference) < 0.05


def test_inflation_acts_earlier():
    pf = build_hod_pf(load_scene("gap"))
    p = np.array([[1.0, 0.25, 0.8]])
    np.testing.assert_allclose(pf.sgf.signed_distance(p) - pf.ogf.signed_distance(p), 0.08, atol=1e-6)
    assert abs(pf.ogf.sample(p)[0, 1]) > 3 * abs(pf.sgf.sample(p)[0, 1])


def test_force_is_minus_the_gradient_of_the_potential():
    """Facing a wall (smooth distance), away from corners and the goal; differences over one cell."""
    scene = Scene("w", obstacles=(Obstacle("w", "side", BoxShape((3.4, 0.2, 3.0)), (1.0, 0.6, 0.75)),))
    field = build_hod_pf(scene).sgf
    p = np.random.default_rng(7).uniform([0.0, 0.2, 0.3], [1.5, 0.45, 1.2], (400, 3))
    p = p[(field.signed_distance(p) > 0.06)]
    h, gradient = 0.01, np.zeros_like(p)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        gradient[:, axis] = (field.potential(p + step) - field.potential(p - step)) / (2 * h)
    force = field.sample(p)
    error = np.linalg.norm(force + gradient, axis=1) / np.linalg.norm(force, axis=1)
    assert error.max() < 0.08 and error.mean() < 0.015
    assert (field.sample(p)[field.signed_distance(p) < 0.1, 1] < 0).all()


def test_formulas():
    s = np.array([-0.1, 0.0, 0.01, 0.02, 0.05, 0.1, 0.19, 0.2, 0.3, 10.0])
    eq2 = 0.5e-3 * (1 / 0.05 - 1 / 0.2) ** 2
    assert u_rep(s, PARAMS)[4] == pytest.approx(eq2)
    assert f_rep(s, PARAMS)[4] == pytest.approx(1e-3 * (1 / 0.05 - 1 / 0.2) / 0.05**2)
    assert (u_rep(s, PARAMS)[-3:] == 0).all() and (f_rep(s, PARAMS)[-3:] == 0).all()
    e = 1e-7
    slope = -(u_rep(s + e, PARAMS) - u_rep(s - e, PARAMS)) / (2 * e)
    np.testing.assert_allclose(f_rep(s, PARAMS), slope, atol=1e-3, rtol=1e-4)
    t = torch.from_numpy(s)
    np.testing.assert_allclose(u_rep(t, PARAMS), u_rep(s, PARAMS))
    one = [f_rep_scalar(x, 0.2, 1e-3, 0.02) for x in s]
    np.testing.assert_allclose(one, f_rep(s, PARAMS))
    for bad in ({"attraction": 0.0}, {"repulsion": float("nan")}, {"nearest_distance_m": 0.3}):
        with pytest.raises(InvalidConfig):
            FieldParams(**bad)


@pytest.mark.parametrize("name", ["gap", "table_edge", "pillars", "open_floor"])
def test_finite_everywhere(name):
    pf = build_hod_pf(load_scene(name), resolution_m=0.08)
    p = np.random.default_rng(8).uniform([-2, -3, -1], [5, 3, 3], (20_000, 3))
    bound = 0.6 + 1.01 * f_rep(np.array(0.0), PARAMS) * np.sqrt(3)
    for field in (pf.sgf, pf.ogf):
        force = field.sample(p)
        assert np.isfinite(force).all() and np.linalg.norm(force, axis=1).max() < bound
        assert np.isfinite(field.potential(p)).all() and np.isfinite(field.signed_distance(p)).all()
        assert not np.isnan(field.geodesic_distance(p)).any()


def test_kinds_shapes_and_dtypes():
    field = build_hod_pf(load_scene("gap"), resolution_m=0.1).sgf
    p = np.random.default_rng(9).uniform([-0.5, -1, 0], [2.5, 1, 1.5], (4, 5, 3))
    for dtype in (np.float32, np.float64):
        for lead in ((), (4,), (2, 2), (0,)):
            a = p.reshape(-1, 3)[: int(np.prod(lead))].reshape(*lead, 3).astype(dtype)
            t = torch.from_numpy(a)
            for query, tail in (
                ("sample", (3,)),
                ("potential", ()),
                ("signed_distance", ()),
                ("geodesic_distance", ()),
            ):
                x, y = getattr(field, query)(a), getattr(field, query)(t)
                assert x.dtype == dtype and y.dtype == t.dtype
                assert x.shape == (*lead, *tail) == tuple(y.shape)
                np.testing.assert_allclose(x, y.numpy(), rtol=1e-3, atol=1e-4)
    assert field.sample(np.array([1, 0, 1])).dtype == np.float64
    with pytest.raises(ValueError, match="last axis"):
        field.sample(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="last axis"):
        field.sample(torch.zeros(3, 2))


def test_torch_field_is_differentiable():
    field = build_hod_pf(load_scene("open_floor"), resolution_m=0.1).sgf
    p = torch.tensor([[0.33, 0.21, 0.5]], requires_grad=True)
    field.potential(p).sum().backward()
    torch.testing.assert_close(-p.grad, field.sample(p.detach()), atol=0.02, rtol=0)  # type: ignore[operator]
