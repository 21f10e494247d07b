"""BSDFs `glazing` and `diffuser`: shares, samples, gradients."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import (
    DIFFUSER,
    ORIGIN,
    UP,
    chi2,
    load,
    local,
    lossless,
    plate,
    tensor,
)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


# Panes


COSINES = np.array([1.0, 0.9, 0.7, 0.5, 0.3, 0.1, 0.02])


def test_null_transmission_is_tau0_1_minus_1_minus_c_to_the_4_5(variant):
    pane = mi.load_dict({"type": "glazing", "transmittance": 0.65})
    exact = 0.65 * (1 - (1 - COSINES) ** 4.5)
    for side in (1, -1):
        got = pane.eval_null_transmission(local(side * COSINES, len(COSINES)))[0]
        np.testing.assert_allclose(np.array(got), exact, atol=2e-6)  # linear in 1024 steps


def tregenza_sharples(c):
    """6 mm clear glass, CIE 171:2006 equation 19."""
    return np.polyval([-1.775827, 4.014235, -1.428919, -3.058376, 3.156075, -0.028378], c)


def test_a_table_gives_any_pane_such_as_that_of_cie_171():
    c = np.linspace(0, 1, 501)
    table = np.maximum(tregenza_sharples(c), 0)
    pane = mi.load_dict({"type": "glazing", "transmittance": tensor(table)})
    got = pane.eval_null_transmission(local(COSINES, len(COSINES)))[0]
    np.testing.assert_allclose(np.array(got), tregenza_sharples(COSINES), atol=2e-5)
    assert np.array(got)[0] == pytest.approx(0.8788, abs=5e-5)


@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.15, -0.15, -0.7])
def test_pane_passes_and_mirrors_in_the_shares_of_its_tables(variant, cosine):
    c = np.linspace(0, 1, 11)
    tau, front, back = 0.6 * c, 0.1 + 0.3 * (1 - c), 0.05 + 0.2 * (1 - c)
    reflectances = {"reflectance_front": tensor(front), "reflectance_back": tensor(back)}
    pane = mi.load_dict({"type": "glazing", "transmittance": tensor(tau), **reflectances})
    count = 1 << 16
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(3, count)
    si = local(cosine, count)
    ctx = mi.BSDFContext()
    bs, weight = pane.sample(ctx, si, sampler.next_1d(), sampler.next_2d())
    t = np.interp(abs(cosine), c, tau)
    r = np.interp(abs(cosine), c, front if cosine > 0 else back)
    straight = np.array(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null))
    share = t / (t + r)
    assert abs(straight.mean() - share) < 4.5 * np.sqrt(share * (1 - share) / count)
    np.testing.assert_allclose(np.array(weight[0]), t + r, rtol=1e-5)
    np.testing.assert_allclose(np.array(bs.pdf), np.where(straight, share, 1 - share), rtol=1e-5)
    wi, wo = np.array(si.wi), np.array(bs.wo)
    mirrored = wi * np.array([[-1], [-1], [1]])
    np.testing.assert_allclose(wo, np.where(straight, -wi, mirrored), atol=1e-6)
    assert np.all(np.array(pane.eval(ctx, si, bs.wo)[0]) == 0)  # delta lobes
    assert np.all(np.array(pane.pdf(ctx, si, bs.wo)) == 0)


@pytest.mark.parametrize(("component", "expected"), [(0, 0.3), (1, 0.7)])
def test_one_component_of_a_pane_alone(component, expected):
    pane = mi.load_dict(lossless("glazing"))
    ctx = mi.BSDFContext()
    ctx.component = component
    bs, weight = pane.sample(ctx, local(1.0), mi.Float(0.5), mi.Point2f(0.5))
    assert float(weight[0][0]) == pytest.approx(expected, rel=1e-6)
    assert int(bs.sampled_component[0]) == component


def pane_over_the_world(bsdf):
    return load(sky={"type": "tregenza_sky"}, pane=plate(0.1, bsdf, half=500.0))


def test_pane_over_the_sensor_dims_every_patch_by_its_angle(same, plain_coefficients):
    scene = pane_over_the_world({"type": "glazing", "transmittance": 0.8})
    c = plain_coefficients(scene, ORIGIN, UP, spp=1 << 15)
    assert np.all(c[1] == 0)  # a pane is no diffuse surface

    # ∫ τ cos θ dΩ of a row is τ₀ ∫ (1 − (1−x)^4.5) x dx with x = cos θ, times the patch's width.
    def antiderivative(x):
        return x**2 / 2 + (1 - x) ** 5.5 / 5.5 - (1 - x) ** 6.5 / 6.5

    low, high, west, east = Patches().bounds[1:].T
    exact = 0.8 * (antiderivative(np.sin(high)) - antiderivative(np.sin(low))) * (east - west)
    same(c[0][..., 1:], exact=exact, within=0.002)
    assert exact.sum() == pytest.approx(0.8 * np.pi * (1 - 2 / (5.5 * 6.5)))


def test_diffuser_over_the_sensor_passes_t_of_every_patch(same, plain_coefficients):
    scene = pane_over_the_world({"type": "diffuser", "transmittance": 0.35})
    c = plain_coefficients(scene, ORIGIN, UP, spp=1 << 15)
    exact = 0.35 * Patches().projected_solid_angles[1:]
    same(c[0][..., 1:], exact=exact, within=0.005)


def test_a_table_dims_the_scattered_light_of_every_patch_by_its_angle(same, plain_coefficients):
    # T(x) = 0.1 + 0.3 x over x = cos θ: of a row ∫ T x dx, times the patch's width.
    table = tensor(0.1 + 0.3 * np.linspace(0, 1, 9))
    scene = pane_over_the_world({"type": "diffuser", "transmittance": table})
    c = plain_coefficients(scene, ORIGIN, UP, spp=1 << 15)
    low, high, west, east = Patches().bounds[1:].T
    at_low, at_high = (0.1 * x**2 / 2 + 0.3 * x**3 / 3 for x in (np.sin(low), np.sin(high)))
    same(c[0][..., 1:], exact=(at_high - at_low) * (east - west), within=0.005)


@pytest.mark.parametrize("mode", [mi.TransportMode.Radiance, mi.TransportMode.Importance])
def test_light_comes_along_wo_or_wi_where_the_transmittance_has_a_table(mode):
    table = tensor([0.1, 0.4])
    pane = mi.load_dict({"type": "diffuser", "transmittance": table, "reflectance_front": 0.2})
    si, ctx = local(0.9), mi.BSDFContext(mode)
    wo = mi.Vector3f(float(np.sqrt(0.84)), 0, -0.4)
    light = 0.4 if mode == mi.TransportMode.Radiance else 0.9
    exact = (0.1 + 0.3 * light) * 0.4 / np.pi
    assert float(pane.eval(ctx, si, wo)[0][0]) == pytest.approx(exact, rel=1e-6)


DIFFUSER_WI = [(0, 0, 1), (0.6, 0, 0.8), (0.8, 0.59, 0.1), (0, 0, -1), (-0.3, 0.9, -0.3)]


@pytest.mark.parametrize("wi", DIFFUSER_WI)
@pytest.mark.parametrize("table", [False, True])
def test_diffuser_samples_follow_their_density(variant, wi, table):
    bsdf = DIFFUSER | {"reflectance_back": 0.1}
    if table:
        bsdf |= {"transmittance": tensor([0.05, 0.2, 0.3])}
    wi = (np.array(wi) / np.linalg.norm(wi)).tolist()
    passed, messages = chi2(mi.chi2.BSDFAdapter("diffuser", bsdf, wi=wi), 3)
    assert passed, messages


@pytest.mark.parametrize("wi", DIFFUSER_WI)
def test_weight_of_a_diffuser_sample_is_eval_over_density(wi):
    bsdf = mi.load_dict(DIFFUSER | {"reflectance_back": 0.1})
    count = 1 << 14
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = dr.normalize(mi.Vector3f(*map(float, wi)))
    ctx = mi.BSDFContext()
    bs, weight = bsdf.sample(ctx, si, sampler.next_1d(), sampler.next_2d())
    value, pdf = bsdf.eval_pdf(ctx, si, bs.wo)
    np.testing.assert_allclose(np.array(pdf), np.array(bs.pdf), rtol=1e-5)
    np.testing.assert_allclose(np.array(weight[0] * bs.pdf), np.array(value[0]), rtol=1e-5)
    reflectance = 0.5 if wi[2] > 0 else 0.1
    reflected = np.array(bs.wo.z) * wi[2] > 0
    f = np.where(reflected, reflectance, 0.3) * np.abs(np.array(bs.wo.z)) / np.pi
    np.testing.assert_allclose(np.array(value[0]), f, rtol=1e-5)
    # Unit variance: the lobe is chosen in proportion to its albedo.
    np.testing.assert_allclose(np.array(weight[0]), reflectance + 0.3, rtol=1e-5)


@pytest.mark.parametrize("straight", [0.15, np.linspace(0, 0.2, 65).tolist()])
@pytest.mark.parametrize("wi", DIFFUSER_WI)
def test_a_fabric_passes_a_part_straight_on_and_scatters_the_rest(wi, straight):
    wi = np.array(wi) / np.linalg.norm(wi)
    given = straight if np.ndim(straight) == 0 else tensor(straight)
    bsdf = mi.load_dict(DIFFUSER | {"straight": given})
    count, ctx = 1 << 16, mi.BSDFContext()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.wi = mi.Vector3f(*map(float, wi))
    bs, weight = bsdf.sample(ctx, si, sampler.next_1d(), sampler.next_2d())
    tau = straight if np.ndim(straight) == 0 else 0.2 * abs(wi[2])
    total = 0.5 + 0.3 + tau
    np.testing.assert_allclose(np.array(weight[0]), total, rtol=1e-4)
    passes = np.array(mi.has_flag(bs.sampled_type, mi.BSDFFlags.Null))
    share = tau / total
    assert abs(passes.mean() - share) < 4.5 * np.sqrt(share * (1 - share) / count)
    assert (np.array(bs.sampled_component) == 2)[passes].all()
    np.testing.assert_allclose(np.array(bs.wo)[:, passes].T, -np.tile(wi, (passes.sum(), 1)),
                               atol=1e-6)  # fmt: skip
    np.testing.assert_allclose(np.array(bsdf.eval_null_transmission(si)[0]), tau, rtol=1e-4)
    value, pdf = bsdf.eval_pdf(ctx, si, bs.wo)
    ratio = (np.array(value[0]) / np.array(pdf))[~passes]
    np.testing.assert_allclose(ratio, total, rtol=1e-4)
    np.testing.assert_allclose(np.array(pdf)[~passes], np.array(bs.pdf)[~passes], rtol=1e-4)


# Gradients


def test_gradient_of_null_transmission_is_the_weight_of_each_entry():
    table = np.linspace(0.1, 0.9, 5)
    pane = mi.load_dict({"type": "glazing", "transmittance": tensor(table)})
    params = mi.traverse(pane)
    dr.enable_grad(params["transmittance"])
    params.update()
    tau = pane.eval_null_transmission(local(0.3))[0]
    dr.backward(tau)
    # cos θ = 0.3 lies 0.2 of the way from entry 1 (0.25) to entry 2 (0.5).
    gradient = dr.grad(params["transmittance"]).numpy()
    np.testing.assert_allclose(gradient, [0, 0.8, 0.2, 0, 0], atol=1e-6)


def test_gradient_of_a_diffuser_is_cos_over_pi():
    bsdf = mi.load_dict(DIFFUSER)
    params = mi.traverse(bsdf)
    keys = ("transmittance", "reflectance_front", "reflectance_back")
    for key in keys:
        dr.enable_grad(params[key])
    params.update()
    wo = mi.Vector3f([0.6, 0.6], [0, 0], [-0.8, 0.8])
    value = bsdf.eval(mi.BSDFContext(), local(0.5, 2), wo)[0]
    dr.backward(value)
    gradient = [float(dr.grad(params[key])[0]) for key in keys]
    np.testing.assert_allclose(gradient, [0.8 / np.pi, 0.8 / np.pi, 0], rtol=1e-6)
