"""The unbiased integrator `coefficient` against exact answers and Mitsuba's own integrators."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.runtime import backend
from drcmitsuba.scene.meshes import quad_mesh
from tests.unit.plugins.small_scenes import (
    ORIGIN,
    PRISM,
    SUNS,
    UP,
    furnished,
    grey,
    load,
    lossless,
    matt,
    meter,
    plate,
    renders,
    suns,
    tensor,
    tipped,
    turned,
    varied_sky,
    view,
    white_sky_camera,
)


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


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
        plugin.sensors.__globals__["PanePoints"], "density", lambda *arguments: mi.Float(0)
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


def test_suns_that_overlap_all_count_in_a_mirror(same, plain_coefficients):
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


def test_gradient_of_a_render_by_the_radiances_is_c(same, plain_coefficients):
    # dE/dL_b = C_b: Mitsuba's path replay finds the coefficients a second way.
    scene = meter(sky={"type": "tregenza_sky"})
    integrator = mi.load_dict({"type": "prb", "max_depth": 12})
    params = mi.traverse(scene)
    gradients = []
    for seed in range(16):
        dr.enable_grad(params["sky.radiance"])
        params.update()
        image = mi.render(scene, params, integrator=integrator, spp=1 << 14, seed=seed)
        dr.backward(dr.sum(image.array))
        gradients.append(dr.grad(params["sky.radiance"]).numpy())
        dr.disable_grad(params["sky.radiance"])
    assert np.isfinite(gradients).all()
    same(gradients, other=plain_coefficients(scene, ORIGIN, UP, spp=1 << 14).sum(axis=(0, 2)),
         within=0.005)  # fmt: skip


# As Mitsuba's integrators: film, crop window, rays, gradients


def film_scene(**film):
    """The furnished view under the sky, in 146 bins; a film of 12 by 8 pixels by default."""
    scene = view(sky={"type": "tregenza_sky"})
    camera = {
        "type": "perspective",
        "fov": 50.0,
        "to_world": mi.ScalarTransform4f().look_at(origin=[3, -2, 1.5], target=[0, 0, 0.3], up=UP),
        "film": {"type": "hdrfilm", "width": 12, "height": 8, "rfilter": {"type": "box"}} | film,
    }
    return scene, mi.load_dict(camera)


def pictures(integrator, scene, sensor, replicates=8, spp=128):
    """Sums over the bins, shape (replicate, height, width)."""
    return np.stack(
        [np.array(integrator.render(scene, sensor, seed=i, spp=spp)) for i in range(replicates)]
    )[..., :146].sum(axis=-1)


def test_a_crop_window_shows_its_part_of_the_picture(same):
    integrator = mi.load_dict({"type": "coefficient"})
    whole = pictures(integrator, *film_scene())
    window = {"crop_offset_x": 3, "crop_offset_y": 2, "crop_width": 5, "crop_height": 4}
    part = pictures(integrator, *film_scene(**window))
    assert part.shape == (8, 4, 5)
    same(part, other=whole[:, 2:6, 3:8], within=0.01)


@pytest.mark.parametrize("rfilter", ["gaussian", "mitchell"])
def test_the_films_filter_is_that_of_mitsuba(rfilter, same):
    """Away from the film's edge, where Mitsuba draws no samples beyond it."""
    scene, sensor = film_scene(rfilter={"type": rfilter})
    here = pictures(mi.load_dict({"type": "coefficient"}), scene, sensor)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    there = np.stack(
        [np.array(mi.render(scene, sensor=sensor, integrator=path, spp=256, seed=i))[..., 0]
         for i in range(8)]
    )  # fmt: skip
    assert here.shape == there.shape
    same(here[:, 2:-2, 2:-2], other=there[:, 2:-2, 2:-2], within=0.01)


def test_sample_is_the_radiance_along_rays_under_unit_bins(same):
    scene, sensor = film_scene()
    integrator = mi.load_dict({"type": "coefficient"})
    radiances = []
    for seed in range(8):
        sampler, _ = integrator.prepare(sensor, seed + 100, 128)
        ray, weight, _, pixel = integrator.sample_rays(scene, sensor, sampler)
        L, valid, aovs, _ = integrator.sample(dr.ADMode.Primal, scene, sampler, ray)
        assert aovs == []
        assert 0 < valid.numpy().mean() < 1
        assert np.all(L[0].numpy()[~valid.numpy()] == 1)  # the sky itself
        radiances.append(np.bincount(pixel.numpy(), L[0].numpy() * weight[0].numpy() / 128))
    same(radiances, other=pictures(integrator, scene, sensor).reshape(8, -1), within=0.01)


def test_gradients_that_would_be_wrong_are_refused():
    scene, sensor = film_scene()
    integrator = mi.load_dict({"type": "coefficient"})
    with pytest.raises(RuntimeError, match=r"coefficient: mode .*no gradients but C itself"):
        integrator.sample(dr.ADMode.Forward, scene, None, None)
    params = mi.traverse(scene)
    key = next(k for k, _ in params if k.endswith("reflectance.value"))
    value = params[key]
    dr.enable_grad(value)
    params[key] = value
    params.update()
    with pytest.raises(RuntimeError, match=r"coefficient: .*value tracks gradients"):
        integrator.sensors(scene, [ORIGIN], [UP], 4)
    image = mi.render(scene, params, sensor=sensor, integrator=integrator, spp=1)
    with pytest.raises(RuntimeError, match="coefficient: there are no gradients"):
        dr.backward(dr.sum(image.array))
