"""Emitters, panes and the unbiased integrator against exact answers and Mitsuba's own."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime import backend
from drcmitsuba.scene.scene import quad_mesh
from tests import ROOT

PRISM = ROOT / "scenes" / "films" / "prism.xml"
UP = [0.0, 0.0, 1.0]
ORIGIN = [0.0, 0.0, 0.0]
SUNS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.96, 0.28], [-0.8, 0.6, 0]])
"""The last one is cut in half by a horizontal sensor's horizon."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else None)


def tensor(values):
    return mi.TensorXf(np.asarray(values, np.float32))


def grey(value):
    return {"type": "uniform", "value": value}


def matt(reflectance):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": grey(reflectance)}}


def suns(directions=SUNS, **parameters):
    return {"type": "sun_disks", "directions": tensor(directions), **parameters}


def load(**parts):
    return mi.load_dict({"type": "scene", **parts}, optimize=False)


def plate(z, bsdf, half=0.5, at=(0.0, 0.0), tilt=0.0):
    """Square of `half` width at height z, front upward, tilted about the x axis [deg]."""
    T = mi.ScalarTransform4f
    place = T().translate([*at, z]).rotate([1, 0, 0], tilt).scale([half, half, 1])
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def furnished(reflectance=0.5):
    """A few things in the way of light: a screen, a ball and a bench, none of them convex alone."""
    return {
        "screen": plate(1.0, matt(reflectance), half=0.8, at=(0.5, 0.4), tilt=60),
        "ball": {"type": "sphere", "radius": 0.4, "center": [-0.8, 0.2, 0.5]}
        | {"bsdf": matt(reflectance)},
        "bench": plate(-0.2, matt(reflectance), half=2.0),
    }


def lossless(kind):
    if kind == "glazing":  # τ₀ (1 − (1−c)⁵) + ρ₀ + (1−ρ₀)(1−c)⁵ = 1 where τ₀ + ρ₀ = 1
        return {"type": "glazing", "transmittance": 0.7, "exponent": 5.0, "reflectance_front": 0.3}
    return {"type": "diffuser", "transmittance": 0.4, "reflectance_front": 0.6}


def white_sky_camera(**parts):
    """Two pixels that look straight down on the origin."""
    camera = {
        "type": "perspective",
        "fov": 2.0,
        "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 3], target=ORIGIN, up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": 2, "height": 2, "rfilter": {"type": "box"}},
    }
    return load(camera=camera, **parts)


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


def varied_sky(**parameters):
    n = len(Patches(parameters.get("subdivision", 1)))
    radiance = np.random.default_rng(7).uniform(0.2, 5, n)
    return {"type": "tregenza_sky", "radiance": tensor(radiance), **parameters}


def turned():
    return mi.ScalarTransform4f().rotate([0, 0, 1], 37.0)


def tipped():
    return mi.ScalarTransform4f().rotate([0.48, 0.6, 0.64], 50.0)


SKIES = {
    "uniform": lambda: {"type": "tregenza_sky"},
    "varied": varied_sky,
    "fine": lambda: varied_sky(subdivision=2),
    "turned": lambda: varied_sky(to_world=turned()),
    "tipped": lambda: varied_sky(to_world=tipped()),
}


def chi2(adapter, sample_dim, seed=1):
    # Densities jump between patches: 24² nodes a cell integrate what straddles a border.
    test = mi.chi2.ChiSquareTest(
        mi.chi2.SphericalDomain(), *adapter, sample_dim, 400_000, res=31, ires=24, seed=seed
    )
    passed = test.run(significance_level=1e-3, quiet=True)
    return passed, test.messages


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


# Any scene: furnace, Mitsuba's own integrators, linearity, turning


@pytest.mark.parametrize("kind", ["glazing", "diffuser"])
def test_white_furnace_is_pi_whatever_stands_in_it(variant, kind, same, plain_coefficients):
    panes = {
        "above": plate(0.3, lossless(kind), half=0.6, tilt=20),
        "below": plate(-0.1, lossless(kind), half=1.5, tilt=200),
    }
    scene = load(sky={"type": "tregenza_sky"}, **furnished(1.0), **panes)
    points = [[0, 0, 0], [0.4, -0.3, 0.6], [-0.3, 0.1, 0.05]]
    normals = [UP, [0.6, 0, -0.8], [0, 1, 0]]
    c = plain_coefficients(scene, points, normals, spp=1 << 13).sum(axis=(0, -1))
    same(c, exact=np.pi, within=0.002)


def test_inside_a_diffusing_sphere_it_is_pi_t_over_1_minus_r(same, plain_coefficients):
    # In a sphere every point of the wall gets the same reflected light from every other: with
    # π on the outside, inside radiance is L = T + R L.
    wall = {"type": "diffuser", "transmittance": 0.3, "reflectance_front": 0.6}
    ball = {"type": "sphere", "bsdf": wall}
    points, normals = [[0, 0, 0], [0.3, -0.5, 0.6], [0.5, 0.5, -0.4]], [UP, [0, 0.6, -0.8], UP]
    c = plain_coefficients(load(sky={"type": "tregenza_sky"}, ball=ball), points, normals)
    same(c.sum(axis=(0, -1)), exact=np.pi * 0.3 / (1 - 0.6), within=0.003)


def meter(**parts):
    """A small irradiancemeter at the origin, looking up, in a furnished scene."""
    shape = plate(-1e-3, matt(0.0), half=1e-3) | {"sensor": {
        "type": "irradiancemeter",
        "film": {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}},
    }}  # fmt: skip
    return load(integrator={"type": "path", "max_depth": -1}, meter=shape, **furnished(), **parts)


def renders(scene, integrator, spp=1 << 15, replicates=16):
    return np.stack(
        [
            np.array(mi.render(scene, integrator=integrator, spp=spp, seed=i))[..., :1]
            for i in range(replicates)
        ]
    )


def test_sum_is_what_the_built_in_path_tracer_finds_under_constant(
    variant, same, plain_coefficients
):
    built_in = meter(sky={"type": "constant", "radiance": grey(1.0)})
    there = renders(built_in, built_in.integrator())
    here = plain_coefficients(meter(sky={"type": "tregenza_sky"}), ORIGIN, UP, spp=1 << 15)
    same(here.sum(axis=(0, -1)), other=there, within=0.003)


def test_c_times_l_is_what_the_built_in_path_tracer_finds(same, plain_coefficients):
    # Linearity in L: one set of C serves any radiances, and holds none of its own.
    scene = meter(sky=varied_sky(to_world=turned()))
    there = renders(scene, scene.integrator())
    plain = meter(sky={"type": "tregenza_sky", "to_world": turned()})
    here = plain_coefficients(plain, ORIGIN, UP, spp=1 << 15, seed=5).sum(axis=0)
    L = mi.traverse(scene)["sky.radiance"].numpy()
    same(here @ L, other=there, within=0.003)
    loud = plain_coefficients(scene, ORIGIN, UP, spp=64, seed=5)
    assert np.array_equal(loud, plain_coefficients(plain, ORIGIN, UP, spp=64, seed=5))


def test_a_pane_that_scatters_gives_the_suns_by_its_form_factor(same, plain_coefficients):
    """Under the middle of a lit square pane: E = τ L Ω cos θ · F; the other pane adds nothing.

    F of a square of half width a at height h is 4/π · a/√(a² + h²) · atan(a/√(a² + h²)).
    """
    pane = {"type": "diffuser", "transmittance": 0.4, "reflectance_front": 0.0}
    panes = {
        "above": plate(1.0, pane, half=1.0),
        "below": plate(-1.0, pane, half=2.0),
        "between": plate(-0.5, matt(0.0), half=3.0),
    }
    high = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.5, np.sqrt(0.75)]])
    c = plain_coefficients(load(suns=suns(high), **panes), ORIGIN, UP, spp=1 << 13)[0]
    x = np.sqrt(0.5)
    factor = 4 / np.pi * x * np.arctan(x)
    exact = 0.4 * factor * disk_solid_angle(0.5) * high[:, 2]
    same(c, exact=exact, within=0.003)


def test_points_on_panes_change_no_mean(same, plain_coefficients, monkeypatch):
    """Suns by way of a film and a diffusing pane, with points on them and by BSDF sampling alone.

    Both panes lie above furniture that is lit through them and by the sun itself.
    """
    panes = {
        "film": plate(1.6, {"type": "tensor_tree", "filename": str(PRISM)}, at=(-0.5, 0.0)),
        "shade": plate(1.6, {"type": "diffuser", "transmittance": 0.3}, at=(0.6, 0.1), half=0.4),
    }
    scene = load(suns=suns(), **panes, **furnished())
    both = plain_coefficients(scene, [[0, 0, 0.2], [0.2, -1.0, 0.1]], [UP, [0, 0.6, 0.8]], seed=1)
    plugin = type(mi.load_dict({"type": "coefficient"}))
    monkeypatch.setattr(plugin, "_pane_sampling", lambda *arguments: None)
    monkeypatch.setattr(
        plugin.sensors.__globals__["_Panes"], "density", lambda *arguments: mi.Float(0)
    )
    one = plain_coefficients(
        scene, [[0, 0, 0.2], [0.2, -1.0, 0.1]], [UP, [0, 0.6, 0.8]], seed=2, spp=1 << 14
    )
    for with_points, without in zip(both, one, strict=True):
        same(with_points, other=without, within=0.03)


def test_scene_and_sky_turned_together_leave_coefficients_unchanged(same, plain_coefficients):
    def turned_scene(turn):
        things = furnished()
        things["pane"] = plate(0.5, lossless("glazing"), half=0.4, at=(-0.2, -0.6), tilt=50)
        for thing in things.values():
            thing["to_world"] = turn @ thing.get("to_world", mi.ScalarTransform4f())
        # The sphere's centre is a parameter of its own, applied before its transform.
        directions = np.array(turn.matrix)[:3, :3] @ SUNS.T
        return load(sky={"type": "tregenza_sky", "to_world": turn}, suns=suns(directions.T),
                    **things)  # fmt: skip

    both = [
        plain_coefficients(turned_scene(turn), ORIGIN, np.array(turn.matrix)[:3, :3] @ UP,
                           spp=1 << 15, seed=i).sum(axis=0)
        for i, turn in enumerate([mi.ScalarTransform4f(), tipped()])
    ]  # fmt: skip
    same(both[0], other=both[1], within=0.003)


def view(**parts):
    look = mi.ScalarTransform4f().look_at(origin=[3, -2, 1.5], target=[0, 0, 0.3], up=UP)
    film = {"type": "hdrfilm", "width": 8, "height": 6, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "fov": 50.0, "to_world": look, "film": film}
    pane = plate(0.5, lossless("glazing"), half=0.5, at=(1.0, -0.6), tilt=70)
    return load(camera=camera, pane=pane, **furnished(), **parts)


def test_picture_sums_to_the_built_in_picture_under_constant(variant, same):
    constant = view(sky={"type": "constant", "radiance": grey(1.0)})
    there = renders(constant, mi.load_dict({"type": "path", "max_depth": -1}), spp=1024)
    scene, integrator = view(sky={"type": "tregenza_sky"}), mi.load_dict({"type": "coefficient"})
    here = [np.array(integrator.render(scene, seed=i, spp=1024)) for i in range(16)]
    assert here[0].shape == (6, 8, 146)
    same(np.sum(here, axis=-1), other=there, within=0.003)


def test_a_picture_shows_the_sun_behind_a_pane(same):
    # A camera that looks through a level pane into one of two suns: τ of its altitude, and nothing.
    sun = np.array([0, 0.6, 0.8])
    pane = plate(0.0, lossless("glazing"), half=0.5, at=(0, 0), tilt=0)
    look = mi.ScalarTransform4f().look_at(origin=(-sun).tolist(), target=ORIGIN, up=[1, 0, 0])
    film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
    camera = {"type": "perspective", "fov": 0.1, "to_world": look, "film": film}
    scene = load(suns=suns([sun, [0, -0.6, 0.8]]), camera=camera, pane=pane)
    integrator = mi.load_dict({"type": "coefficient"})
    seen = [np.array(integrator.render(scene, seed=i, spp=4096)).ravel() for i in range(16)]
    same(np.array(seen)[:, 0], exact=0.7 * (1 - 0.2**5), within=0.005)
    assert np.all(np.array(seen)[:, 1] == 0)


def test_suns_that_overlap_are_all_found_in_a_mirror(same, plain_coefficients):
    # By a vertical mirror at y = 1 the sensor sees two suns at one place, and a third beside them.
    wall = np.array([[[-9, 1, -9], [9, 1, -9], [9, 1, 9], [-9, 1, 9.0]]])
    mirror = quad_mesh("mirror", wall, mi.load_dict({"type": "twosided", "bsdf": {
        "type": "conductor", "material": "none"}}))  # fmt: skip
    directions = [[0, -0.6, 0.8], [0, -0.6, 0.8], [0.28, -0.96, 0]]
    scene = load(suns=suns([*directions, [0, 0, 1]], diameter=20.0), mirror=mirror)
    c = plain_coefficients(scene, ORIGIN, [0, 1, 0], spp=1 << 16)[0]
    exact = np.pi * np.sin(np.radians(10)) ** 2 * np.array([0.6, 0.6, 0.96])
    same(c[..., :3], exact=exact, within=0.005)


def test_sun_on_a_matt_plane_with_the_built_in_path_tracer(variant, same):
    # The disks overlap nothing here: E = L Ω cos θ, reflected radiance ρ E / π.
    radiance = np.array([1e4, 3e4, 5e4])
    scene = white_sky_camera(suns=suns(SUNS[:3], radiance=tensor(radiance)),
                             floor=plate(0, matt(0.5), half=5))  # fmt: skip
    image = renders(scene, mi.load_dict({"type": "path"}), spp=4096)
    E = (radiance * disk_solid_angle(0.5) * SUNS[:3, 2]).sum()
    same(image, exact=0.5 * E / np.pi, within=0.005)


def test_envmap_and_sky_less_scenes_have_their_bins(same, plain_coefficients):
    bitmap = mi.Bitmap(np.full((16, 32, 3), 2.0, np.float32))
    scene = load(sky={"type": "envmap", "bitmap": bitmap}, suns=suns())
    c = plain_coefficients(scene, ORIGIN, UP)[0]
    assert c.shape[1:] == (1, 5)  # the environment is one bin with its own radiance
    same(c[..., 0], exact=2 * np.pi, within=0.005)
    with pytest.raises(ValueError, match="coefficient: the scene has neither"):
        plain_coefficients(load(floor=plate(0, matt(0.5))), ORIGIN, UP)


# Panes


def local(cos_theta, count=1, phi=0.4):
    c = mi.Float(np.broadcast_to(np.asarray(cos_theta, np.float32), count))
    s = dr.safe_sqrt(1 - c * c)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(c))
    si.wi = mi.Vector3f(s * np.cos(phi), s * np.sin(phi), c)
    return si


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


DIFFUSER = {"type": "diffuser", "transmittance": 0.3, "reflectance_front": 0.5}
DIFFUSER_WI = [(0, 0, 1), (0.6, 0, 0.8), (0.8, 0.59, 0.1), (0, 0, -1), (-0.3, 0.9, -0.3)]


@pytest.mark.parametrize("wi", DIFFUSER_WI)
def test_diffuser_samples_follow_their_density(variant, wi):
    bsdf = DIFFUSER | {"reflectance_back": 0.1}
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


def test_gradient_of_a_render_by_the_radiances_is_c(same, plain_coefficients):
    # dE/dL_b = C_b: Mitsuba's path replay finds the coefficients a second way.
    scene = meter(sky={"type": "tregenza_sky"})
    integrator = mi.load_dict({"type": "prb", "max_depth": 12})
    params = mi.traverse(scene)
    found = []
    for seed in range(16):
        dr.enable_grad(params["sky.radiance"])
        params.update()
        image = mi.render(scene, params, integrator=integrator, spp=1 << 14, seed=seed)
        dr.backward(dr.sum(image.array))
        found.append(dr.grad(params["sky.radiance"]).numpy())
        dr.disable_grad(params["sky.radiance"])
    assert np.isfinite(found).all()
    same(found, other=plain_coefficients(scene, ORIGIN, UP, spp=1 << 14).sum(axis=(0, 2)),
         within=0.005)  # fmt: skip


# Variants, and parameters that make no sense


def test_plugins_come_back_after_every_change_of_variant():
    present = {"llvm": bool(backend.llvm_version()), "cuda": backend.cuda_available()}
    jit = [v for v in mi.variants() if present.get(v[:4]) and not v.endswith("polarized")]
    for name in [*jit, "scalar_rgb", jit[0]]:
        mi.set_variant(name)
        if name.startswith("scalar"):
            continue  # a plugin in Python needs a vectorised variant
        scene = load(sky={"type": "tregenza_sky"}, suns=suns(), pane=plate(1, lossless("glazing")),
                     shade=plate(2, DIFFUSER))  # fmt: skip
        integrator = mi.load_dict({"type": "coefficient"})
        c = integrator.sensors(scene, [ORIGIN], [UP], 256).numpy()
        assert c.shape == (2, 1, 150)
        assert c.sum() > 0.5
    backend.select(jit[0])


BAD = [
    ("tregenza_sky", "radiance", {"radiance": [1, 2, 3, 4]}),
    ("tregenza_sky", "radiance", {"radiance": [np.nan] * 146}),
    ("tregenza_sky", "radiance", {"radiance": [-1.0] * 146}),
    ("tregenza_sky", "subdivision", {"subdivision": 7}),
    ("tregenza_sky", "subdivision", {"subdivision": 0}),
    ("tregenza_sky", "subdivison", {"subdivison": 2}),
    ("sun_disks", "directions", {}),
    ("sun_disks", "directions", {"directions": [[0, 1]]}),
    ("sun_disks", "directions", {"directions": np.zeros((0, 3))}),
    ("sun_disks", "directions", {"directions": [[0, 0, 0]]}),
    ("sun_disks", "radiance", {"directions": [[0, 0, 1]], "radiance": [1, 2, 3, 4]}),
    ("sun_disks", "radiance", {"directions": [[0, 0, 1]], "radiance": [np.inf]}),
    ("sun_disks", "diameter", {"directions": [[0, 0, 1]], "diameter": -1.0}),
    ("glazing", "transmittance", {}),
    ("glazing", "transmittance", {"transmittance": 1.5}),
    ("glazing", "transmittance", {"transmittance": float("nan")}),
    ("glazing", "transmittance", {"transmittance": "clear"}),
    ("glazing", "exponent", {"transmittance": 0.5, "exponent": -1.0}),
    ("glazing", "reflectance_front", {"transmittance": 0.5, "reflectance_front": [[0.1] * 4] * 2}),
    ("glazing", "reflectance_back", {"transmittance": 0.5, "reflectance_back": -0.5}),
    ("diffuser", "transmittance", {}),
    ("diffuser", "transmittance", {"transmittance": -0.1}),
    ("diffuser", "reflectance_back", {"transmittance": 0.1, "reflectance_back": 1.1}),
    ("coefficient", "max_depth", {"max_depth": "deep"}),
    ("coefficient", "suns_per_vertex", {"suns_per_vertex": 0}),
]


@pytest.mark.parametrize(("plugin", "field", "parameters"), BAD)
def test_bad_parameters_raise_and_are_named(plugin, field, parameters):
    arrays = {
        k: v if isinstance(v, (int, float, str)) else tensor(v) for k, v in parameters.items()
    }
    with pytest.raises(Exception, match=rf"(?s){plugin}.*{field}"):
        mi.load_dict({"type": plugin, **arrays})
