"""Mirrors: coated ones against Fresnel's equations, partly diffuse ones against their shares."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.model.materials import MirrorMaterial
from drcmitsuba.scene.materials import bsdf

ANGLES = np.array([0.0, 20, 45, 60, 75, 85, 89])


@pytest.fixture(autouse=True)
def _variant(variant):
    """Each of them."""


def local(cosine, count=1):
    si = dr.zeros(mi.SurfaceInteraction3f, count)
    c = mi.Float(np.broadcast_to(np.asarray(cosine, np.float32), (count,)).copy())
    si.wi = mi.Vector3f(dr.safe_sqrt(1 - c * c), 0, c)
    return si


def fresnel(degrees, n):
    """Unpolarised reflectance of a surface from air, by the two polarisations."""
    i = np.radians(degrees)
    t = np.arcsin(np.sin(i) / n)
    s = (np.cos(i) - n * np.cos(t)) / (np.cos(i) + n * np.cos(t))
    p = (n * np.cos(i) - np.cos(t)) / (n * np.cos(i) + np.cos(t))
    return (s**2 + p**2) / 2


def sampled(made, cosine, count=1, seed=0):
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    si = local(cosine, count)
    bs, weight = made.sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    return si, bs, np.array(weight[0])


@pytest.mark.parametrize("n", [1.0, 1.33, 1.5, 2.0])
@pytest.mark.parametrize("rho", [0.0, 0.6, 0.95, 1.0])
def test_light_bounces_below_the_coating_until_nothing_is_left(n, rho):
    """One order after the other is summed: in, mirrored, out, or mirrored back again."""
    made = mi.load_dict({"type": "coated_mirror", "reflectance": rho, "ior": n})
    r = fresnel(ANGLES, n)
    exact, inside = r.copy(), (1 - r) * rho
    for _ in range(1000):
        exact += inside * (1 - r)
        inside *= r * rho
    _, _, weight = sampled(made, np.cos(np.radians(ANGLES)), len(ANGLES))
    np.testing.assert_allclose(weight, exact, atol=2e-5)
    assert (weight <= 1 + 1e-6).all()
    if rho == 1:
        np.testing.assert_allclose(weight, 1, atol=1e-6)
    if n == 1:
        np.testing.assert_allclose(weight, rho, atol=1e-6)


def test_it_goes_in_the_mirrored_direction_and_is_one_sided():
    made = mi.load_dict({"type": "coated_mirror", "reflectance": 0.9, "ior": 1.5})
    si, bs, weight = sampled(made, [0.3, -0.3], 2)
    wi, wo = np.array(si.wi), np.array(bs.wo)
    np.testing.assert_allclose(wo, wi * [[-1], [-1], [1]], atol=1e-7)
    assert weight[0] > 0
    assert weight[1] == 0
    assert float(made.pdf(mi.BSDFContext(), si, bs.wo)[0]) == 0
    assert np.all(np.array(made.eval(mi.BSDFContext(), si, bs.wo)[0]) == 0)


def test_gradient_by_the_mirror_below():
    made = mi.load_dict({"type": "coated_mirror", "reflectance": 0.8, "ior": 1.5})
    params = mi.traverse(made)
    rho = params["reflectance"]
    dr.enable_grad(rho)
    params["reflectance"] = rho
    params.update()
    cosine = np.cos(np.radians(ANGLES))
    si = local(cosine, len(ANGLES))
    _, weight = made.sample(mi.BSDFContext(), si, mi.Float(0.5), mi.Point2f(0.5))
    dr.backward(dr.sum(weight[0]))
    r = fresnel(ANGLES, 1.5)
    exact = (1 - r) ** 2 / (1 - 0.8 * r) ** 2
    assert float(dr.grad(rho)[0]) == pytest.approx(exact.sum(), rel=1e-4)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(
    "changes", [{"coating": 1.5}, {"roughness": 0.2}, {"specular": 0.0}, {"specular": 0.7}, {}]
)
def test_a_mirror_is_the_same_on_both_sides_and_keeps_its_reflectance(side, changes):
    mirror = MirrorMaterial(type="mirror", reflectance=0.9, **changes)
    made, count = mi.load_dict(bsdf(mirror)), 1 << 16
    _, bs, weight = sampled(made, 0.8 * side, count, seed=1)
    assert (np.array(bs.wo)[2] * side)[weight > 0].min() >= 0
    if "coating" in changes:
        r = fresnel(np.degrees(np.arccos(0.8)), 1.5)
        np.testing.assert_allclose(weight, r + (1 - r) ** 2 * 0.9 / (1 - 0.9 * r), rtol=1e-4)
        return
    error = max(weight.std() / np.sqrt(count), 1e-5)
    if "roughness" in changes:  # GGX's microfacets shadow each other: some light is lost
        assert 0.8 < weight.mean() < 0.9 + 4 * error
    else:
        assert abs(weight.mean() - 0.9) < 4 * error
    matt = np.array(mi.has_flag(bs.sampled_type, mi.BSDFFlags.DiffuseReflection))
    share = 1 - changes.get("specular", 1.0)
    assert abs(matt.mean() - share) <= 4.5 * np.sqrt(share * (1 - share) / count) + 1e-12


@pytest.mark.parametrize(
    ("field", "parameters"),
    [
        ("ior", {"reflectance": 0.9, "ior": 0.9}),
        ("ior", {"reflectance": 0.9}),
        ("reflectance", {"reflectance": 1.2, "ior": 1.5}),
        ("reflectance", {"ior": 1.5}),
    ],
)
def test_bad_parameters_are_named(field, parameters):
    with pytest.raises(Exception, match=rf"(?s)coated_mirror.*{field}"):
        mi.load_dict({"type": "coated_mirror", **parameters})
