"""Polished surfaces: their formula, their density, their energy, both directions of light."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.scene.materials import bsdf, mean_albedo
from tests.unit.plugins.small_scenes import chi2

COUNT = 1 << 16
MATERIAL = MirrorMaterial(type="mirror", reflectance=0.5, specular=0.1, polished=True)
COSINES = [1.0, 0.5, 0.2, 0.05]


@pytest.fixture(autouse=True)
def _variant(variant):
    """Each of them."""


def interaction(cosine, count):
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(mi.Float(np.full(count, np.sqrt(1 - cosine**2))), 0, cosine)
    return si


def exact(cosine):
    """Mirrored and diffuse share at an incidence."""
    more = np.exp(-5.85 * cosine) - np.exp(-5.85)
    return 0.05 + 0.95 * more, 0.45 * (1 - more)


def sampled(cosine, mode=mi.TransportMode.Radiance):
    made = mi.load_dict(bsdf(MATERIAL))
    rng = np.random.default_rng(1)
    a, b, c = (mi.Float(rng.random(COUNT)) for _ in range(3))
    si = interaction(cosine, COUNT)
    bs, weight = made.sample(mi.BSDFContext(mode), si, a, mi.Point2f(b, c))
    delta = np.array(mi.has_flag(bs.sampled_type, mi.BSDFFlags.DeltaReflection))
    return made, bs, np.array(weight[0]), delta


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("cosine", COSINES)
def test_the_eye_sees_the_share_of_its_angle(cosine, side):
    _, bs, weight, delta = sampled(side * cosine)
    mirrored, matt = exact(cosine)
    np.testing.assert_allclose(weight, mirrored + matt, rtol=1e-5)  # no sample wastes light
    share = mirrored / (mirrored + matt)
    assert abs(delta.mean() - share) < 4.5 * np.sqrt(share * (1 - share) / COUNT)
    direction = [-np.sqrt(1 - cosine**2), 0, side * cosine]
    there = np.array(bs.wo)[:, delta]
    np.testing.assert_allclose(there, np.tile(direction, (there.shape[1], 1)).T, atol=1e-6)


@pytest.mark.parametrize("cosine", COSINES)
def test_light_leaves_as_the_eye_will_see_it(cosine):
    """A photon's diffuse share is that of the angle at which it leaves; its mean is that of F."""
    _, _, weight, delta = sampled(cosine, mi.TransportMode.Importance)
    mirrored, _ = exact(cosine)
    assert np.where(delta, weight, 0).mean() == pytest.approx(mirrored, rel=0.03)
    c = (np.arange(10_000) + 0.5) / 10_000
    mean = 2 * (exact(c)[1] * c).mean()
    matt = np.where(delta, 0, weight)
    assert abs(matt.mean() - mean) < 4.5 * matt.std() / np.sqrt(COUNT)


@pytest.mark.parametrize("mode", ["Radiance", "Importance"])
def test_weight_is_value_over_density(mode):
    mode = getattr(mi.TransportMode, mode)
    made, bs, weight, delta = sampled(0.3, mode)
    ctx, si = mi.BSDFContext(mode), interaction(0.3, COUNT)
    value, pdf = made.eval_pdf(ctx, si, bs.wo)
    np.testing.assert_allclose(
        (np.array(value[0]) / np.array(pdf))[~delta], weight[~delta], rtol=1e-4
    )
    np.testing.assert_allclose(np.array(pdf)[~delta], np.array(bs.pdf)[~delta], rtol=1e-4)


@pytest.mark.parametrize("wi", [(0, 0, 1), (0.6, 0, 0.8), (0.98, 0, 0.199)])
def test_diffuse_samples_follow_their_density(wi):
    ctx = mi.BSDFContext()
    ctx.type_mask = +mi.BSDFFlags.DiffuseReflection
    made = mi.load_dict({"type": "polished", "mirrored": 0.05, "matt": 0.4})

    def si(count):
        one = dr.zeros(mi.SurfaceInteraction3f, count)
        one.wi = mi.Vector3f(*wi)
        return one

    def sample(u):
        bs, weight = made.sample(ctx, si(dr.width(u)), u[0], mi.Point2f(u[1], u[2]))
        return bs.wo, dr.select(weight[0] > 0, mi.Float(1), 0)

    passed, messages = chi2((sample, lambda wo: made.pdf(ctx, si(dr.width(wo)), wo)), 3)
    assert passed, messages


def test_gradient_by_both_shares():
    made = mi.load_dict({"type": "polished", "mirrored": 0.1, "matt": 0.4})
    params = mi.traverse(made)
    for name in ("mirrored", "matt"):
        dr.enable_grad(params[name])
    params.update()
    _, weight = made.sample(mi.BSDFContext(), interaction(0.3, COUNT), *_numbers())
    dr.backward(dr.mean(weight[0]))
    more = np.exp(-5.85 * 0.3) - np.exp(-5.85)
    for name in ("mirrored", "matt"):
        assert float(dr.grad(params[name])[0]) == pytest.approx(1 - more, rel=0.03)


def _numbers():
    rng = np.random.default_rng(2)
    return mi.Float(rng.random(COUNT)), mi.Point2f(*(mi.Float(rng.random(COUNT)) for _ in "uv"))


@pytest.mark.parametrize("changes", [{"roughness": 0.1}, {"coating": 1.5}])
def test_polish_is_for_smooth_surfaces_without_a_coating(changes):
    with pytest.raises(ValueError, match="leave out roughness and coating"):
        MirrorMaterial(type="mirror", reflectance=0.5, polished=True, **changes)


def test_the_mean_albedo_is_that_of_light_from_everywhere():
    """∫ 2 c [ρ + (1 − ρ) F(c)] dc in closed form: the plan's depth follows from it, not from 1."""
    mirror = MirrorMaterial(type="mirror", reflectance=0.2, specular=0.15, polished=True)
    k = 5.85
    mean = 2 * (1 - (1 + k) * np.exp(-k)) / k**2 - np.exp(-k)
    assert mean_albedo(mirror) == pytest.approx(0.2 + 0.8 * mean, abs=1e-4)
    assert mean_albedo(mirror.model_copy(update={"polished": False})) == 0.2
