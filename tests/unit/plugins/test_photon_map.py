"""The photon map against exact answers, `coefficient` and Mitsuba's path tracer."""

import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches

from drcmitsuba.runtime import backend
from tests.unit.plugins.small_scenes import PRISM, UP, grey, load, matt, tensor

DOWN = [0.0, 0.0, -1.0]
SUNS = np.array([[0, 0, 1], [0.6, 0, 0.8], [0, -0.6, 0.8]])


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def mirror(reflectance):
    conductor = {"type": "conductor", "material": "none"}
    return {"type": "twosided", "bsdf": conductor | {"specular_reflectance": grey(reflectance)}}


def suns(directions=SUNS, diameter=6.0, **parameters):
    given = {"directions": tensor(directions), "diameter": diameter}
    return {"type": "sun_disks", **given, **parameters}


def plate(bsdf, centre=(0, 0, 0), half=(1, 1), axis=(1, 0, 0), angle=0.0):
    """Rectangle of half widths round a centre, front upward before it is turned [deg]."""
    T = mi.ScalarTransform4f
    place = T().translate(list(centre)).rotate(list(axis), angle).scale([*half, 1])
    return {"type": "rectangle", "to_world": place, "bsdf": bsdf}


def ball(bsdf, centre, radius):
    return {"type": "sphere", "center": list(centre), "radius": radius, "bsdf": bsdf}


def photon_map(**parameters):
    return mi.load_dict({"type": "photon_map", **parameters})


def coefficients(scene, points, normals, photons=1 << 16, replicates=16, **parameters):
    """Replicates, shape (2: before and after a diffuse surface; n, sensor, bin)."""
    integrator = photon_map(**parameters)
    rows = np.reshape(points, (-1, 3)), np.reshape(normals, (-1, 3))
    parts = [integrator.sensors(scene, *rows, photons, seed).numpy() for seed in range(replicates)]
    return np.stack(parts, axis=1)


def camera(origin, target, width=24, height=24, fov=40.0, up=(0, 1, 0)):
    film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    place = mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up))
    return {"type": "perspective", "fov": fov, "to_world": place, "film": film}


def pictures(scene, integrator, spp=16, replicates=8):
    return np.stack(
        [np.array(mi.render(scene, integrator=integrator, spp=spp, seed=i), np.float64)
         for i in range(replicates)]
    )  # fmt: skip


def blocks(images, size):
    """Means over blocks of `size` pixels, shape (replicate, …)."""
    n, height, width, channels = images.shape
    return images.reshape(n, height // size, size, width // size, size, channels).mean((2, 4))


# Crossings of sensors


@pytest.mark.parametrize("kernel", ["epanechnikov", "constant"])
def test_free_sensor_gets_pi_and_the_projected_solid_angle_of_every_patch(variant, kernel, same):
    patches = Patches(1)
    scene = load(sky={"type": "tregenza_sky"})
    c = coefficients(scene, [0, 0, 0], UP, photons=1 << 18, radius=0.2, kernel=kernel)
    assert np.all(c[1] == 0)
    exact = np.where(np.arange(len(patches)) > 0, patches.projected_solid_angles, 0)
    same(c[0], exact=exact, within=0.003)
    assert exact.sum() == pytest.approx(np.pi)


@pytest.mark.parametrize("diameter", [0.5, 10.0])
def test_disk_gives_pi_sin2_h_cos(diameter, same):
    c = coefficients(load(suns=suns(diameter=diameter)), [3, 2, 1], UP, radius=0.1)
    same(c[0], exact=np.pi * np.sin(np.radians(diameter) / 2) ** 2 * SUNS[:, 2], within=0.003)


def form_factor(half, height):
    """Share of a square's light that a point below its middle gets, facing it."""
    x = half / np.hypot(half, height)
    return 4 / np.pi * x * np.arctan(x)


@pytest.mark.parametrize("gather", [0, 256])
def test_a_lit_floor_seen_from_above_gives_its_form_factor(variant, gather, same):
    # Floor of ρ under an open sky: L = ρ; the ground is seen past its edge.
    scene = load(sky={"type": "tregenza_sky"}, floor=plate(matt(0.6), half=(2, 2)))
    parameters = {"radius": 0.2, "gather": gather}
    c = coefficients(scene, [0, 0, 0.4], DOWN, 1 << 18, **parameters)
    factor = form_factor(2, 0.4)
    assert np.all(c[0, ..., 1:] == 0)
    exact = np.pi * np.array([1 - factor, 0.6 * factor])
    same(np.moveaxis(c.sum(axis=(2, 3)), 0, 1), exact=exact, within=0.02)


def test_equal_seeds_give_equal_coefficients_and_other_seeds_others():
    scene = load(sky={"type": "tregenza_sky"}, floor=plate(matt(0.6)))
    integrator = photon_map(radius=0.2, passes=2)
    a, b, c = (
        integrator.sensors(scene, [[0, 0, 0.5]], [UP], 1 << 14, seed).numpy() for seed in (3, 3, 4)
    )
    np.testing.assert_allclose(a, b, rtol=1e-6)
    assert not np.allclose(a, c)


# Where light goes: mirrors, ledger


def reflected_sun(tiles, tilt, half, floor, diameter):
    """Flux per tile of the floor, from a sun in +x by a 45° mirror round the origin, by quadrature.

    Directions are rings over the projected disk, points a midpoint grid over the mirror.
    """
    n = 48
    i, j = (a.ravel() + 0.5 for a in np.meshgrid(np.arange(n), np.arange(n)))
    rho, phi = np.sin(np.radians(diameter) / 2) * np.sqrt(i / n), 2 * np.pi * j / n
    y, z = rho * np.cos(phi), rho * np.sin(phi)
    x = np.sqrt(1 - y**2 - z**2)
    to_sun, normal = np.stack([x, y, z], -1), np.array([np.sin(tilt), 0, -np.cos(tilt)])
    cosine = to_sun @ normal
    solid_angle = np.pi * np.sin(np.radians(diameter) / 2) ** 2 / n**2 / x
    weight = cosine * solid_angle * (2 * half / n) ** 2
    d = (2 * cosine[:, None] * normal - to_sun)[:, None]
    u, v = 2 * i / n - 1, 2 * j / n - 1
    p = half * (u[:, None] * [np.cos(tilt), 0, np.sin(tilt)] + v[:, None] * [0, 1, 0])
    at = p + ((floor - p[:, 2]) / d[..., 2])[..., None] * d
    weights = np.repeat(weight, len(p))
    return np.histogram2d(at[..., 0].ravel(), at[..., 1].ravel(), [tiles, tiles], weights=weights)[
        0
    ]


def test_a_mirror_at_45_degrees_throws_the_sun_where_it_belongs(same):
    half, floor, diameter = 0.5, -1.5, 6.0
    T = mi.ScalarTransform4f
    place = T().rotate([0, 1, 0], 135).scale([half, half, 1])
    scene = load(
        suns=suns([[1, 0, 0]], diameter),
        mirror={"type": "rectangle", "to_world": place, "bsdf": mirror(0.9)},
        floor=plate(matt(0.5), centre=(0, 0, floor), half=(3, 3)),
    )
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    c = np.sqrt(0.5)
    port = corners @ np.array([[c, 0, c], [0, 1, 0], [0, 0, 0]])  # in the plane of the mirror
    integrator = photon_map(ports=tensor(port[None]))
    tiles = np.linspace(-0.8, 0.8, 9)
    landed = []
    for seed in range(16):
        store, ledger = integrator.shoot(scene, 1 << 14, seed)
        n = store.count
        p, flux = np.array(store.position)[:2, :n], np.array(store.flux)[0, :n].astype(float)
        landed.append(np.histogram2d(*p, bins=[tiles, tiles], weights=flux)[0])
        assert ledger.stored == pytest.approx(flux.sum(), rel=1e-5)
    whole = 0.9 * np.pi * np.sin(np.radians(3)) ** 2 * np.sqrt(0.5) * (2 * half) ** 2
    exact = 0.9 * reflected_sun(tiles, np.pi / 4, half, floor, diameter)
    assert exact.sum() == pytest.approx(whole, rel=1e-6)
    same(np.array(landed), exact=exact, within=0.002)


def furnished(reflectance=0.5, **bsdfs):
    """A floor, a screen, a mirror that throws light onto both, a glass ball and a matt one."""
    return {
        "floor": plate(matt(reflectance), half=(2, 2)),
        "screen": plate(matt(reflectance), (-1.2, 0, 0.8), (0.6, 0.6), (0, 1, 0), 80),
        "mirror": plate(mirror(0.9), (1.2, 0, 0.8), (0.5, 0.5), (0, 1, 0), 110),
        "glass": ball({"type": "dielectric", "int_ior": 1.5}, (0, 0.8, 0.6), 0.3),
        "matt": ball(matt(reflectance), (0, -0.8, 0.5), 0.3),
    } | bsdfs


def test_ledger_balances_and_the_matt_surfaces_absorb_their_share(variant, same):
    things = furnished(mirror=plate(mirror(1.0), (1.2, 0, 0.8), (0.5, 0.5), (0, 1, 0), 110))
    scene = load(sky={"type": "tregenza_sky"}, suns=suns(radiance=tensor([5, 9, 2])), **things)
    absorbed = []
    for seed in range(8):
        _, x = photon_map().shoot(scene, 1 << 16, seed)
        assert x.emitted == pytest.approx(x.absorbed + x.escaped + x.lost, rel=1e-6)
        assert x.lost == 0
        absorbed.append([x.absorbed / x.stored])
    same(np.array(absorbed), exact=0.5, within=0.002)


def test_white_things_absorb_nothing():
    things = furnished(1.0)
    del things["mirror"]
    _, x = photon_map(rr_depth=1000).shoot(load(sky={"type": "constant"}, **things), 1 << 16)
    assert abs(x.absorbed) < 1e-5 * x.emitted
    # On a GPU one photon of 4096 met an edge, and was absorbed.
    assert x.escaped + x.absorbed == pytest.approx(x.emitted, rel=1e-6)
    assert x.absorbed < 2 * x.emitted / (1 << 12)


def test_port_lets_in_what_is_aimed_at_it_and_no_more(same):
    # A horizontal port of 2 m² under the sky lets in 2 π; another below a roof nothing; the first
    # behind a pane what the pane lets through.
    def let_in(height, **parts):
        port = [[[0, 0, height], [0, 1, height], [2, 1, height], [2, 0, height]]]
        scene = load(sky={"type": "tregenza_sky"}, floor=plate(matt(0.5), half=(5, 5)), **parts)
        integrator = photon_map(ports=tensor(port))
        return np.array([[integrator.shoot(scene, 1 << 14, i)[1].emitted] for i in range(16)])

    same(let_in(1.0), exact=2 * np.pi, within=0.005)
    assert np.all(let_in(1.0, roof=plate(matt(0.5), (0, 0, 2), (500, 500))) < 0.01 * np.pi)
    pane = {"type": "glazing", "transmittance": tensor([0.5, 0.5]), "reflectance_front": 0.3}
    same(let_in(1.0, pane=plate(pane, (0, 0, 2), (500, 500))), exact=np.pi, within=0.005)
    # In the plane of the port, a pane is behind it: nothing is lost before.
    same(let_in(1.0, pane=plate(pane, (0, 0, 1), (500, 500))), exact=2 * np.pi, within=0.005)


def test_light_that_bounces_for_too_long_is_lost_and_said():
    tube = {
        "left": plate(mirror(1.0), (-0.05, 0, 0), (3, 3), (0, 1, 0), 90),
        "right": plate(mirror(1.0), (0.05, 0, 0), (3, 3), (0, 1, 0), 90),
    }
    scene = load(suns=suns([[0.6, 0, 0.8]]), **tube)
    port = tensor([[[-0.05, -1, 3], [-0.05, 1, 3], [0.05, 1, 3], [0.05, -1, 3]]])
    short, long = photon_map(ports=port, max_depth=10), photon_map(ports=port, max_depth=-1)
    _, x = short.shoot(scene, 1 << 12)
    assert x.lost > 0.98 * x.emitted  # the rest starts beside the edges
    with pytest.warns(
        RuntimeWarning, match=r"photon_map: [\d.]+% of the flux lost; raise max_depth"
    ):
        short.sensors(scene, [[0, 0, 4]], [UP], 1 << 10)
    assert x.emitted == pytest.approx(x.absorbed + x.escaped + x.lost, rel=1e-6)
    _, x = long.shoot(scene, 1 << 12)
    assert x.lost == 0
    # On a GPU one photon of 4096 met an edge, and was absorbed.
    assert x.escaped + x.absorbed == pytest.approx(x.emitted, rel=1e-6)
    assert x.absorbed < 2 * x.emitted / (1 << 12)


# Against the unbiased path tracer


def within_disks(points, radius, copies, rng):
    """Points spread evenly over horizontal disks: where photons are recorded with the constant
    kernel; shape (copies, point, 3)."""
    r = radius * np.sqrt(rng.random((copies, len(points))))
    a = 2 * np.pi * rng.random(r.shape)
    return np.asarray(points) + np.stack([r * np.cos(a), r * np.sin(a), 0 * a], -1)


def averaged_coefficients(scene, points, normals, radius, replicates=16, copies=256, spp=64):
    """The same by `coefficient`, averaged over the disks."""
    integrator = mi.load_dict({"type": "coefficient"})
    rng, parts = np.random.default_rng(1), []
    for seed in range(replicates):
        p = within_disks(points, radius, copies, rng).reshape(-1, 3)
        c = integrator.sensors(scene, p, np.tile(normals, (copies, 1)), spp, seed).numpy()
        parts.append(c.reshape(2, copies, len(points), -1).mean(axis=1))
    return np.stack(parts, axis=1)


def room():
    """A cube of 2 m with an opening to the south, and a mirror that throws suns up to the back."""

    def wall(centre, half, axis, angle):
        return plate(matt(0.5), centre, half, axis, angle)

    return {
        "floor": wall((0, 0, 0), (1, 1), (1, 0, 0), 0),
        "ceiling": wall((0, 0, 2), (1, 1), (1, 0, 0), 0),
        "west": wall((-1, 0, 1), (1, 1), (0, 1, 0), 90),
        "east": wall((1, 0, 1), (1, 1), (0, 1, 0), 90),
        "north": wall((0, 1, 1), (1, 1), (1, 0, 0), 90),
        "south": wall((0, -1, 0.5), (1, 0.5), (1, 0, 0), 90),
        "shelf": plate(mirror(0.9), (0, -0.6, 1.0), (0.9, 0.35)),
    }


WINDOW = [[[-1, -1, 1], [-1, -1, 2], [1, -1, 2], [1, -1, 1]]]
LOW_SUNS = np.array([[0, -0.8, 0.6], [0.6, -0.48, 0.64], [-0.48, -0.64, 0.6]])


@pytest.mark.slow
def test_coefficients_in_a_room_with_a_mirror_are_those_of_path_tracing(same):
    points = [[0, -0.2, 0.8], [-0.5, 0.5, 0.8], [0.2, 0.4, 1.5]]
    normals = [UP, UP, DOWN]
    scene = load(sky={"type": "tregenza_sky"}, suns=suns(LOW_SUNS), **room())
    ours = coefficients(
        scene, points, normals, photons=1 << 17, radius=0.15, kernel="constant",
        ports=tensor(WINDOW),
    )  # fmt: skip
    there = averaged_coefficients(scene, points, normals, 0.15, copies=128)
    for mine, theirs in zip(ours, there, strict=True):
        same(mine, other=theirs, within=0.03)
    free = coefficients(scene, points, normals, 1 << 18, 8, radius=0.15, kernel="constant")
    same(free.sum(axis=(0, -1)), other=ours.sum(axis=(0, -1)), within=0.04)


@pytest.mark.parametrize("turned", [pytest.param(False, marks=pytest.mark.slow), True])
def test_a_film_that_is_not_reciprocal_lets_through_what_path_tracing_says(turned, same):
    """Photons ask the film the other way round than paths from a sensor."""
    film = {"type": "tensor_tree", "filename": str(PRISM)}
    pane = plate(film, (0, 0, 1), (1, 1), (1, 0, 0), 180 if turned else 0)
    scene = load(suns=suns(), film=pane)
    port = tensor([[[-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, 1]]])
    parameters = {"radius": 0.2, "kernel": "constant", "ports": port}
    ours = coefficients(scene, [0, 0, 0], UP, 1 << 17, **parameters)[0]
    same(ours, other=averaged_coefficients(scene, [[0, 0, 0]], [UP], 0.2)[0], within=0.02)


@pytest.mark.slow
def test_final_gather_finds_what_crosses_the_sensors(same):
    """Light that met a diffuse surface, in two ways; no edge is near enough to matter."""
    things = {
        "floor": plate(matt(0.7), half=(2.5, 2.5)),
        "ball": ball(matt(0.7), (0.6, 0, 0.8), 0.4),
        "mirror": plate(mirror(0.9), (-0.8, 0, 0.8), (0.4, 0.4), (0, 1, 0), 60),
    }
    scene = load(sky={"type": "constant"}, suns=suns(), **things)
    port = tensor([[[-1.5, -1.5, 2], [-1.5, 1.5, 2], [1.5, 1.5, 2], [1.5, -1.5, 2]]])
    parameters = {"radius": 0.15, "kernel": "constant", "ports": port}
    crossed = coefficients(scene, [0, 0, 0.5], DOWN, 1 << 19, **parameters)[1]
    # Rays start all over the disk that the crossings are averaged over.
    points = within_disks([[0, 0, 0.5]], 0.15, 32, np.random.default_rng(2))[:, 0]
    gathered = coefficients(
        scene, points, np.tile(DOWN, (32, 1)), 1 << 16, gather=32, **parameters
    )[1].mean(axis=1)  # fmt: skip
    same(gathered, other=crossed, within=0.02)


# Pictures


def test_floor_under_a_coloured_sky_has_its_radiance(same):
    backend.select("llvm_ad_rgb" if backend.llvm_version() else "cuda_ad_rgb")
    white, sky = {"type": "rgb", "value": [0.2, 0.5, 0.8]}, np.tile([3.0, 2.0, 1.0], (146, 1))
    floor = plate({"type": "diffuse", "reflectance": white}, half=(1, 1))
    scene = load(
        sky={"type": "tregenza_sky", "radiance": tensor(sky)}, floor=floor,
        camera=camera([0, 0, 3], [0, 0, 0], width=6, height=6, fov=10.0),
    )  # fmt: skip
    for gather in (0, 2):
        seen = pictures(scene, photon_map(photons=1 << 19, radius=0.2, gather=gather), spp=4)
        same(seen.mean(axis=(1, 2)), exact=[0.6, 1.0, 0.8], within=0.005)


def mirrored_scene():
    """A sunlit floor, a mirror that throws a spot on it, a matt and a glass ball, seen from above.

    The floor's edges are out of sight: density estimates are too dark there.
    """
    return load(
        sky={"type": "tregenza_sky", "radiance": tensor(np.full(146, 0.2))},
        suns=suns([[0.6, 0, 0.8]], radiance=tensor([100.0])),
        floor=plate(matt(0.5), half=(4, 4)),
        mirror=plate(mirror(0.9), (-0.7, 0, 0.7), (0.4, 0.4), (0, 1, 0), 60),
        matt=ball(matt(0.5), (0.2, -0.6, 0.5), 0.3),
        glass=ball({"type": "dielectric", "int_ior": 1.5}, (0.2, 0.6, 0.5), 0.3),
        camera=camera([0, 0, 4], [0, 0, 0]),
    )


@pytest.mark.slow
@pytest.mark.parametrize("gather", [0, 2])
def test_picture_of_a_sunlit_mirror_is_that_of_coefficient(gather, same):
    scene = mirrored_scene()
    L = np.append(np.full(146, 0.2), 100.0)
    there = pictures(scene, mi.load_dict({"type": "coefficient"}), spp=256) @ L[:, None]
    here = pictures(
        scene, photon_map(photons=1 << 19, radius=0.02, gather=gather), spp=64, replicates=8
    )
    same(blocks(here, 4), other=blocks(there, 4), within=0.01)


@pytest.mark.slow
def test_coated_and_rough_things_are_seen_as_the_path_tracer_sees_them(same):
    """A coat's mirror image is followed, its diffuse light estimated, each path counted once."""
    scene = load(
        sky={"type": "constant", "radiance": grey(1.0)},
        floor=plate(matt(0.5), half=(2.5, 2.5)),
        coated=ball({"type": "plastic", "diffuse_reflectance": grey(0.6)}, (-0.5, 0, 0.6), 0.4),
        rough=ball({"type": "roughconductor", "alpha": 0.3}, (0.5, 0, 0.6), 0.4),
        camera=camera([0, 0, 4], [0, 0, 0]),
    )
    there = pictures(scene, mi.load_dict({"type": "path", "max_depth": -1}), spp=32)
    for gather in (0, 2):
        here = pictures(scene, photon_map(photons=1 << 19, radius=0.05, gather=gather), spp=16)
        same(blocks(here, 6), other=blocks(there, 6), within=0.005)


def test_no_light_leaks_through_a_thin_wall():
    scene = load(
        suns=suns([[0, 0, 1]]), wall=plate(matt(0.5)), camera=camera([0, 0, -3], [0, 0, 0])
    )
    assert pictures(scene, photon_map(photons=1 << 14, radius=0.3), replicates=1).max() == 0


def test_caustic_photons_alone_are_those_that_met_no_diffuse_surface():
    """Among matt things that is direct light: what one event brings, photon by photon."""
    scene = load(
        suns=suns([[0.6, 0, 0.8]], radiance=tensor([100.0])),
        floor=plate(matt(0.5), half=(4, 4)),
        ball=ball(matt(0.5), (0.2, -0.6, 0.5), 0.3),
        camera=camera([0, 0, 4], [0, 0, 0]),
    )

    def light(**parameters):
        integrator = photon_map(photons=1 << 16, radius=0.05, **parameters)
        return pictures(scene, integrator, replicates=1)

    direct, all_light = light(kind="caustic"), light()
    with pytest.warns(RuntimeWarning, match="of the flux lost"):
        one_event = light(max_depth=1)
    np.testing.assert_allclose(direct, one_event, rtol=1e-4, atol=1e-6)
    assert direct.sum() < 0.995 * all_light.sum()


# The radius


def penumbra(x, diameter):
    """Irradiance per radiance on a floor, 1 m below a screen that ends at x = 0, from the zenith.

    The rest of the disk, seen past the edge: ∫ dωx dωy over ωx / ωz > −x.
    """
    r = np.sin(np.radians(diameter) / 2)
    g = ((np.arange(600) + 0.5) / 300 - 1) * r
    u, v = np.meshgrid(g, g[300:])
    inside = u**2 + v**2 < r**2
    slope = np.sort((u / np.sqrt(1 - u**2 - v**2))[inside])
    share = 1 - np.searchsorted(slope, -np.asarray(x)) / len(slope)
    return np.pi * r**2 * share


def smoothed(x, radius, diameter):
    """The same, averaged by the Epanechnikov kernel, whose margin is (8/3π r) (1 − u²/r²)^(3/2)."""
    u = (np.arange(400) + 0.5) / 200 - 1
    margin = (1 - u**2) ** 1.5
    values = penumbra(np.asarray(x)[:, None] + radius * u, diameter)
    return (values * margin).sum(axis=1) / margin.sum()


@pytest.mark.slow
def test_radius_shrinks_by_the_rule_and_the_error_with_it(same):
    """Light at the foot of a penumbra, where it curves: the kernel's bias is known."""
    x = np.array([-0.06, 0.06])
    scene = load(
        suns=suns([[0, 0, 1]], 10.0), screen=plate(matt(0.0), (-5, 0, 1), (5, 5)),
        floor=plate(matt(0.0), half=(6, 6)),
    )  # fmt: skip
    points = np.stack([x, 0 * x, 0 * x + 1e-3], -1)
    port = tensor([[[-0.3, -0.3, 1.1], [-0.3, 0.3, 1.1], [0.3, 0.3, 1.1], [0.3, -0.3, 1.1]]])
    truth, errors = penumbra(x, 10.0), {}
    for passes in (1, 16):
        parameters = {"radius": 0.1, "passes": passes, "alpha": 0.3, "ports": port}
        radii = photon_map(**parameters).radii(scene)
        i = np.arange(1, passes)
        exact = 0.01 * np.cumprod([1, *((i + 0.3) / (i + 1))])
        np.testing.assert_allclose(np.square(radii), exact, rtol=1e-6)
        c = coefficients(scene, points, [UP, UP], 1 << 18, **parameters)[0, ..., 0]
        same(c, exact=np.mean([smoothed(x, r, 10.0) for r in radii], axis=0), within=0.006)
        errors[passes] = abs(c.mean(axis=0) - truth)
    # The bias goes with the mean of r² over the passes, N^(α−1) in the limit.
    assert np.mean(exact) < 0.34 * exact[0]
    assert np.all(errors[16] < 0.5 * errors[1])
