"""Emitters against exact answers, and their samples against their densities."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import (
    ORIGIN,
    SUNS,
    UP,
    chi2,
    load,
    suns,
    tensor,
    tipped,
    turned,
    varied_sky,
)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


# The sky and the suns, unobstructed


@pytest.mark.parametrize("subdivision", [1, 3])
def test_free_sensor_gets_the_projected_solid_angle_of_every_patch(
    variant, subdivision, same, plain_coefficients
):
    patches = Patches(subdivision)
    scene = load(sky={"type": "tregenza_sky", "subdivision": subdivision})
    c = plain_coefficients(scene, ORIGIN, UP, spp=1 << 15).sum(axis=0)
    assert np.all(c[..., 0] == 0)  # the ground is below a sensor that looks up
    exact = np.where(np.arange(len(patches)) > 0, patches.projected_solid_angles, 0)
    same(c, exact=exact, within=0.002)
    assert exact.sum() == pytest.approx(np.pi)


@pytest.mark.parametrize("normal", [(0, 0, -1), (1, 0, 0), (0, -0.6, 0.8), (0.48, 0.6, -0.64)])
def test_a_turned_sensor_sees_ground_in_its_share_and_pi_in_all(normal, same, plain_coefficients):
    c = plain_coefficients(load(sky={"type": "tregenza_sky"}), ORIGIN, normal, spp=1 << 15)[0]
    ground = np.pi * (1 - normal[2]) / 2
    same(np.stack([c[..., 0], c[..., 1:].sum(axis=-1)], -1), exact=[ground, np.pi - ground],
         within=0.002)  # fmt: skip


@pytest.mark.parametrize("diameter", [0.01, 0.5, 10.0])
def test_disk_gives_pi_sin2_h_cos(variant, diameter, same, plain_coefficients):
    # ∫ cos θ dΩ over a cap of half angle h around θ is π sin² h cos θ; it is h − sin h cos h for
    # one whose centre lies on the horizon, by the contour integral ½ ∮ n·(r × dr).
    h = np.radians(diameter) / 2
    exact = np.append(np.pi * np.sin(h) ** 2 * SUNS[:3, 2], h - np.sin(h) * np.cos(h))
    c = plain_coefficients(load(suns=suns(diameter=diameter)), ORIGIN, UP, spp=1 << 15)[0]
    same(c, exact=exact, within=0.003)


def test_sampled_suns_lie_on_their_disks_evenly():
    emitter = mi.load_dict(suns(diameter=20.0, radiance=tensor([1, 2, 3, 4])))
    count = 1 << 18
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    ds, weight = emitter.sample_direction(dr.zeros(mi.Interaction3f), sampler.next_2d())
    d = np.array(ds.d, np.float64)
    index = np.array(emitter.bin_of(ds.d))
    outside = index == len(SUNS)
    assert outside.mean() < 1e-3  # float32 rounds the rim of a disk in or out
    assert (
        np.array(emitter.eval_direction(dr.zeros(mi.Interaction3f), ds)[0])[~outside].tolist()
        == (index[~outside] + 1.0).tolist()
    )
    np.testing.assert_allclose(
        (np.array(weight[0]) * np.array(ds.pdf))[~outside], index[~outside] + 1, rtol=1e-6
    )
    share = np.bincount(index[~outside], minlength=4) / count
    assert np.abs(share - np.array([1, 2, 3, 4]) / 10).max() < 5 * np.sqrt(0.25 / count)
    np.testing.assert_allclose(np.linalg.norm(d, axis=0), 1, atol=1e-6)
    # (chord / chord of the rim)² is uniform on [0, 1].
    radius = ((d - SUNS.T[:, np.minimum(index, 3)]) ** 2).sum(axis=0)[~outside]
    u = radius / (4 * np.sin(np.radians(10) / 2) ** 2)
    n = len(u)
    np.testing.assert_allclose(np.quantile(u, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=3 / n**0.5)


# Emitters as Mitsuba samples them


SKIES = {
    "uniform": lambda: {"type": "tregenza_sky"},
    "varied": varied_sky,
    "fine": lambda: varied_sky(subdivision=2),
    "turned": lambda: varied_sky(to_world=turned()),
    "tipped": lambda: varied_sky(to_world=tipped()),
}


@pytest.mark.parametrize("sky", SKIES)
def test_sky_samples_follow_their_density(variant, sky):
    passed, messages = chi2(mi.chi2.EmitterAdapter("tregenza_sky", SKIES[sky]()), 2)
    assert passed, messages


def test_chi2_would_notice_a_wrong_density():
    sample, _ = mi.chi2.EmitterAdapter("tregenza_sky", varied_sky())
    _, pdf = mi.chi2.EmitterAdapter("tregenza_sky", varied_sky(to_world=turned()))
    assert not chi2((sample, pdf), 2)[0]


@pytest.mark.parametrize("sky", SKIES)
def test_weight_of_a_sky_sample_is_radiance_over_density(sky):
    emitter = mi.load_dict(SKIES[sky]())
    count = 1 << 17
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, count)
    it = dr.zeros(mi.Interaction3f)
    ds, weight = emitter.sample_direction(it, sampler.next_2d())
    value, pdf = emitter.eval_direction(it, ds)[0], emitter.pdf_direction(it, ds)
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = -ds.d
    assert np.array_equal(np.array(emitter.eval(si)[0]), np.array(value))
    # A sample on a border may round into the neighbour: no more than a few in 10⁵.
    off = ~np.isclose(np.array(pdf), np.array(ds.pdf), rtol=1e-5)
    off |= ~np.isclose(np.array(weight[0] * ds.pdf), np.array(value), rtol=1e-5)
    assert off.mean() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(np.array(ds.d), axis=0), 1, atol=1e-6)
