"""`redirecting_film`: samples, energy, where the light goes, and derivatives by every parameter."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import chi2

FILM = {
    "type": "redirecting_film",
    "transmittance": 0.6,
    "redirected": 0.7,
    "tilt": 12.0,
    "spread": 14.0,
    "reflectance_front": 0.25,
}
WI = [(0, 0, 1), (0.3, 0.5, 0.8), (0.6, -0.75, 0.2), (0, 0, -1), (-0.3, -0.8, -0.4)]
MODES = ("Radiance", "Importance")
BOUNDS = [
    {},
    {"tilt": 0.0},
    {"tilt": -90.0},
    {"tilt": 90.0},
    {"spread": 0.25},
    {"spread": 90.0},
    {"transmittance": 0.0},
    {"transmittance": 1.0, "reflectance_front": 0.0},
    {"redirected": 0.0},
    {"redirected": 1.0},
]
"""One parameter each at an end of its range."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def unit(v):
    return (np.array(v, float) / np.linalg.norm(v)).tolist()


def context(mode):
    ctx = mi.BSDFContext()
    ctx.mode = getattr(mi.TransportMode, mode)
    return ctx


def interaction(wi):
    """A horizontal pane: its y axis is the world's."""
    wi = np.atleast_2d(wi)
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.n = mi.Normal3f(0, 0, 1)
    si.sh_frame = mi.Frame3f(si.n)
    si.wi = vector(wi)
    return si


def vector(w):
    return mi.Vector3f(*(mi.Float(np.ascontiguousarray(c, np.float32)) for c in np.atleast_2d(w).T))


def sphere(n=512):
    """Directions of equal solid angle, and the solid angle of each."""
    z, phi = np.meshgrid((np.arange(n) + 0.5) / n * 2 - 1, (np.arange(2 * n) + 0.5) / n * np.pi)
    r = np.sqrt(1 - z * z)
    w = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1).reshape(-1, 3)
    return w, 4 * np.pi / len(w)


def adapter(wi, ctx, change=None):
    """`mi.chi2.BSDFAdapter` leaves the shading frame empty, and this film asks where up is."""
    bsdf, wi = mi.load_dict(FILM | (change or {})), unit(wi)

    def sample(u):
        si = interaction(np.tile(wi, (dr.width(u), 1)))
        bs, weight = bsdf.sample(ctx, si, u[0], mi.Point2f(u[1], u[2]))
        return bs.wo, dr.select(dr.all(weight == 0), mi.Float(0), 1)

    return sample, lambda wo: bsdf.pdf(ctx, interaction(np.tile(wi, (dr.width(wo), 1))), wo)


# Samples


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("wi", WI)
def test_samples_follow_their_density(wi, mode):
    passed, messages = chi2(adapter(wi, context(mode)), 3)
    assert passed, messages


def test_samples_follow_their_density_in_every_variant(variant):
    passed, messages = chi2(adapter(WI[4], context("Radiance")), 3)
    assert passed, messages


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("change", [{"tilt": 60.0}, {"tilt": -45.0, "spread": 40.0}, {"spread": 6}])
def test_folded_lobes_follow_their_density(change, mode):
    passed, messages = chi2(adapter((0.1, 0.7, 0.5), context(mode), change), 3)
    assert passed, messages


@pytest.mark.parametrize("kind", ["DiffuseReflection", "GlossyTransmission", "DiffuseTransmission"])
def test_one_component_alone(kind):
    ctx = context("Importance")
    ctx.type_mask = +getattr(mi.BSDFFlags, kind)
    passed, messages = chi2(adapter(WI[1], ctx), 3)
    assert passed, messages
    bsdf = mi.load_dict(FILM)
    w, solid_angle = sphere()
    total = bsdf.eval(ctx, interaction(unit(WI[1])), vector(w))[0].numpy().sum() * solid_angle
    albedo = {"DiffuseReflection": 0.25, "GlossyTransmission": 0.42, "DiffuseTransmission": 0.18}
    assert total == pytest.approx(albedo[kind], rel=1e-3)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("change", BOUNDS)
@pytest.mark.parametrize("wi", WI[1:4:2])
def test_weight_is_eval_over_density(wi, change, mode):
    bsdf, count, ctx = mi.load_dict(FILM | change), 1 << 12, context(mode)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    si = interaction(np.tile(unit(wi), (count, 1)))
    bs, weight = bsdf.sample(ctx, si, sampler.next_1d(), sampler.next_2d())
    value, pdf = bsdf.eval_pdf(ctx, si, bs.wo)
    # A wo that is rounded on its way to the local frame moves far on the flank of a narrow lobe.
    rtol = 0.02 if change.get("spread") == 0.25 else 1e-3
    np.testing.assert_allclose(np.array(pdf), np.array(bs.pdf), rtol=rtol)
    np.testing.assert_allclose(np.array(weight[0] * bs.pdf), np.array(value[0]), rtol=rtol)
    assert np.isfinite(np.array(weight[0])).all()
    if mode == "Importance":
        front = FILM["reflectance_front"] if wi[2] > 0 else 0
        albedo = (FILM | change)["transmittance"] + min(front, (FILM | change)["reflectance_front"])
        np.testing.assert_allclose(np.array(weight[0])[np.array(bs.pdf) > 0], albedo, rtol=rtol)


# Energy and directions


@pytest.mark.parametrize("change", [c for c in BOUNDS if c.get("spread") != 0.25])
@pytest.mark.parametrize("light", [(0, 0, -1), (0.3, 0.5, -0.8), (-0.5, 0.86, -0.05), (0, -1, -1)])
def test_exactly_t_of_the_light_leaves(light, change):
    chosen = FILM | change
    bsdf = mi.load_dict(chosen)
    w, solid_angle = sphere()
    leaves = bsdf.eval(context("Importance"), interaction(unit(light)), vector(w))[0].numpy()
    assert leaves.min() >= 0
    assert leaves[w[:, 2] < 0].max() == 0  # nothing is sent back outside
    assert leaves.sum() * solid_angle == pytest.approx(chosen["transmittance"], rel=1e-3, abs=1e-9)


def test_light_from_the_room_is_reflected_and_let_out():
    bsdf = mi.load_dict(FILM)
    w, solid_angle = sphere()
    leaves = bsdf.eval(context("Importance"), interaction(unit(WI[1])), vector(w))[0].numpy()
    back = leaves[w[:, 2] > 0].sum() * solid_angle
    assert back == pytest.approx(0.25, rel=1e-3)
    assert leaves.sum() * solid_angle == pytest.approx(0.85, rel=1e-3)


def test_both_modes_are_one_bsdf():
    bsdf = mi.load_dict(FILM)
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=(256, 3)) for _ in range(2))
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    by_light = bsdf.eval(context("Importance"), interaction(a), vector(b))[0].numpy()
    by_view = bsdf.eval(context("Radiance"), interaction(b), vector(a))[0].numpy()
    np.testing.assert_allclose(by_light / abs(b[:, 2]), by_view / abs(a[:, 2]), rtol=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 10.0, -20.0])
@pytest.mark.parametrize("elevation", [-20.0, 0.0, 35.0, 60.0])
def test_the_lobe_lies_about_the_mirrored_elevation(elevation, tilt):
    """A vertical pane that faces south: its normal into the room is north."""
    bsdf = mi.load_dict(
        FILM | {"redirected": 1.0, "tilt": tilt, "spread": 0.5, "reflectance_front": 0.0}
    )
    e, count = np.radians(elevation), 1 << 12
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    si.n = mi.Normal3f(0, 1, 0)
    si.sh_frame = mi.Frame3f(si.n)
    sun = mi.Vector3f(0, -float(np.cos(e)), float(np.sin(e)))
    si.wi = si.to_local(sun)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    bs, _ = bsdf.sample(context("Importance"), si, sampler.next_1d(), sampler.next_2d())
    out = np.array(si.to_world(bs.wo))
    up = np.degrees(np.arctan2(out[2], out[1]))
    sideways = np.degrees(np.arcsin(out[0]))
    for angle, expected in ((up, elevation + tilt), (sideways, 0.0)):
        assert angle.mean() == pytest.approx(expected, abs=4 * 0.5 / count**0.5)
        assert angle.std() == pytest.approx(0.5, rel=0.06)


# Derivatives


def attached(change=None):
    bsdf = mi.load_dict(FILM | (change or {}))
    params = mi.traverse(bsdf)
    keys = [key for key in params.keys() if key in FILM]  # noqa: SIM118  no mapping
    for key in keys:
        dr.enable_grad(params[key])
    params.update()
    return bsdf, params, keys


PAIRS = [
    # light, leaving: in the lobe, on its flank, folded, from the ground, at a grazing direction
    ((0.0, 0.5, -0.8), (0.05, 0.6, 0.7)),
    ((0.3, 0.5, -0.8), (-0.1, 0.5, 0.8)),
    ((0.0, 0.95, -0.3), (0.1, 0.97, 0.05)),
    ((0.2, -0.4, -0.9), (-0.2, -0.2, 0.9)),
    ((-0.5, 0.86, -0.05), (0.5, 0.8, 0.1)),
]


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("change", [c for c in BOUNDS if c.get("spread") != 0.25])
def test_derivatives_of_eval_are_central_differences(change, mode):
    light, leaving = (np.array([unit(p[i]) for p in PAIRS]) for i in (0, 1))
    wi, wo = (leaving, light) if mode == "Radiance" else (light, leaving)
    # Reflection too: two directions of the room.
    wi, wo = np.vstack([wi, leaving[:1]]), np.vstack([wo, leaving[1:2]])
    ctx, si = context(mode), interaction(wi)
    bsdf, params, keys = attached(change)

    def value():
        return bsdf.eval(ctx, si, vector(wo))[0]

    for key in keys:
        dr.set_grad(params[key], 1.0)
        derivative = dr.forward_to(value()).numpy()
        at = float(dr.detach(params[key])[0])
        step = 0.02 if key in ("tilt", "spread") else 1e-2
        sides = []
        for h in (step, -step):
            params[key] = mi.Float(at + h)
            params.update()
            sides.append(dr.detach(value()).numpy().astype(float))
        params[key] = mi.Float(at)
        dr.enable_grad(params[key])
        params.update()
        expected = (sides[0] - sides[1]) / (2 * step)
        scale = max(abs(sides[0]).max(), 0.1)
        np.testing.assert_allclose(derivative, expected, rtol=0.01, atol=2e-4 * scale, err_msg=key)
        assert abs(derivative).max() > 0 or 0 in (
            change.get("transmittance"),
            change.get("redirected"),
        )


@pytest.mark.parametrize("change", BOUNDS)
def test_reverse_equals_forward_and_is_finite(change):
    w, _ = sphere(16)
    wi, wo = np.repeat(w, len(w), axis=0), np.tile(w, (len(w), 1))
    ctx, si = context("Radiance"), interaction(wi)
    bsdf, params, keys = attached(change)
    dr.backward(dr.mean(bsdf.eval(ctx, si, vector(wo))[0]))
    reverse = [float(dr.grad(params[key])[0]) for key in keys]
    assert np.isfinite(reverse).all()
    for key, derivative in zip(keys, reverse, strict=True):
        bsdf, params, _ = attached(change)
        dr.set_grad(params[key], 1.0)
        values = dr.forward_to(bsdf.eval(ctx, si, vector(wo))[0]).numpy()
        assert np.isfinite(values).all()
        assert values.mean() == pytest.approx(derivative, rel=1e-3, abs=1e-6), key


def test_a_narrow_lobe_has_finite_derivatives_at_its_peak():
    bsdf, params, keys = attached({"spread": 0.25})
    light = np.array(unit((0.1, 0.5, -0.8)))
    turn = np.radians(12.0)
    y, z = light[1], -light[2]
    out = [-light[0], np.cos(turn) * y + np.sin(turn) * z, np.cos(turn) * z - np.sin(turn) * y]
    value = bsdf.eval(context("Radiance"), interaction(out), vector(light))[0]
    dr.backward(value)
    kappa = 1 / np.radians(0.25) ** 2
    peak = 0.6 * (0.7 * kappa / (2 * np.pi) * z / out[2] + 0.3 * z / np.pi)
    assert float(value[0]) == pytest.approx(peak, rel=1e-3)
    gradient = {key: float(dr.grad(params[key])[0]) for key in keys}
    assert np.isfinite(list(gradient.values())).all()
    assert gradient["spread"] == pytest.approx(-2 * peak / 0.25, rel=0.01)  # ∝ 1/σ²
    assert gradient["transmittance"] == pytest.approx(peak / 0.6, rel=1e-3)


def test_weights_of_samples_carry_the_gradient_of_the_albedo():
    """Importance: E[weight] = T + R, so its derivatives by T and R are 1, by the others 0."""
    bsdf, params, keys = attached()
    count = 1 << 16
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    si = interaction(np.tile(unit(WI[1]), (count, 1)))
    _, weight = bsdf.sample(context("Importance"), si, sampler.next_1d(), sampler.next_2d())
    dr.backward(dr.mean(weight[0]))
    gradient = {key: float(dr.grad(params[key])[0]) for key in keys}
    assert gradient["transmittance"] == pytest.approx(1, abs=0.02)
    assert gradient["reflectance_front"] == pytest.approx(1, abs=0.02)
    # Per degree: the score's standard deviation is 1/σ = 1/14 for a mean of 65,536 draws.
    assert gradient["tilt"] == pytest.approx(0, abs=1e-3)
    assert gradient["spread"] == pytest.approx(0, abs=1e-3)


BAD = [
    ("transmittance", {"transmittance": 1.5}),
    ("redirected", {"redirected": -0.1}),
    ("tilt", {"tilt": 91.0}),
    ("spread", {"spread": 0.1}),
    ("spread", {"spread": float("nan")}),
    ("reflectance_front", {"reflectance_front": 2.0}),
    (r"transmittance \+ reflectance_front", {"transmittance": 0.8}),
    ("up", {"up": [0.0, 0.0, float("nan")]}),
]


@pytest.mark.parametrize(("field", "change"), BAD)
def test_bad_parameters_raise_and_are_named(field, change):
    with pytest.raises(Exception, match=rf"(?s)redirecting_film: {field}"):
        mi.load_dict(FILM | change)
