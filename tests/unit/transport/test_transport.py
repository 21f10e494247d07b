"""C = D + G·D and its parts against exact answers, and against the unbiased plugin `coefficient`.

Two-sided tests of equal means need a bias far below the standard error. The bias of G·D comes from
cells, so cells of 10 cm are paired with sample counts that leave 0.1 to 0.5 % of standard error (in
runs with forty times the samples the two agreed to 0.04 %); the bias itself is measured by
`test_bias_of_cells_falls_with_their_size`.
"""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.stats import t as student

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.materials import DiffuserMaterial, GlazingMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.scene.materials import Lambertian, bsdf
from drcmitsuba.scene.scene import quad_mesh
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.cells import Grid
from drcmitsuba.transport.coefficients import compute, straight_suns
from drcmitsuba.transport.gather import gather
from drcmitsuba.transport.panes import PanePatches, neumann_series, pane_transfer
from drcmitsuba.transport.shadow_rays import sky_deposit, sun_deposit

PATCHES = Patches()
SKY = np.where(np.arange(146) > 0, PATCHES.projected_solid_angles, 0)
"""What a free horizontal sensor gets from every bin [sr]."""
DIRECTIONS = np.array(
    [[0, -0.8, 0.6], [0.48, -0.64, 0.6], [-0.6, -0.48, 0.64], [0, -0.28, 0.96], [0, 0.8, 0.6]]
)
SUNS = Suns(tuple(f"sun_{i}" for i in range(5)), DIRECTIONS)
NO_SUNS = Suns((), np.zeros((0, 3)))
OMEGA = disk_solid_angle(0.5)
UP, DOWN = np.array([[0, 0, 1.0]]), np.array([[0, 0, -1.0]])
ORIGIN = np.zeros((1, 3))


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else None)


def quad(corner, u, v):
    """Quadrilateral with its front towards u × v."""
    c, u, v = (np.asarray(a, float) for a in (corner, u, v))
    return np.array([c, c + u, c + u + v, c + v])


def surface(material, *quads):
    material = Lambertian(material) if isinstance(material, float) else material
    return Surface("surface", material, np.array(quads))


def glazing(transmittance, **more):
    return GlazingMaterial(type="glazing", transmittance=transmittance, **more)


def diffuser(transmittance, reflectance=0.0):
    return DiffuserMaterial(type="diffuser", transmittance=transmittance, reflectance=reflectance)


def plane(z, material, half=500.0, front=1):
    edges = ([2 * half, 0, 0], [0, 2 * half, 0])[::front]
    return surface(material, quad([-half, -half, z], *edges))


def closed_box(size, material):
    """Box around the origin, fronts inward."""
    h = size / 2
    x, y, z = np.eye(3) * size
    faces = [quad([-h, -h, -h], a, b) for a, b in ((x, y), (y, z), (z, x))]
    return surface(
        material, *faces, *(quad([h, h, h], -b, -a) for a, b in ((x, y), (y, z), (z, x)))
    )


def flat(points, repeat=1):
    return mi.Float(np.tile(np.asarray(points, np.float32), (repeat, 1)).ravel())


def by_replicate(values, replicates):
    values = values.numpy()
    return values.reshape(replicates, -1, values.shape[-1])


def run(things, points, normals, suns=NO_SUNS, **accuracy):
    """Replicates of C (replicate, sensor, bin) by G·D."""
    scene = things if isinstance(things, scenes.Scene) else scenes.build(things)
    chosen = Accuracy(**{"replicates": 24, "cell_size": 0.1, **accuracy})
    return compute(scene, points, normals, suns, chosen)["replicates"].values


def with_sources(surfaces, turn=0.0):
    """The surfaces under sky and suns, for `coefficient`; `turn` rotates sky and suns [deg]."""
    T = mi.ScalarTransform4f().rotate([0, 0, 1], turn)
    matrix = np.array(T.matrix)[:3, :3]
    meshes = {
        f"s{i}": quad_mesh(s.name, s.quads, mi.load_dict(bsdf(s.material)))
        for i, s in enumerate(surfaces)
    }
    sky = {"type": "tregenza_sky", "to_world": T}
    directions = mi.TensorXf((DIRECTIONS @ matrix.T).astype(np.float32))
    suns = {"type": "sun_disks", "directions": directions}
    return mi.load_dict({"type": "scene", **meshes, "sky": sky, "suns": suns}, optimize=False)


# D: shadow rays


@pytest.mark.parametrize("subdivision", [1, 2])
def test_free_receiver_gets_projected_solid_angles(subdivision, same):
    scene = scenes.build([])
    n = 32
    d = sky_deposit(scene, flat(ORIGIN, n), flat(UP, n), subdivision=subdivision, rays=1 << 14,
                    seed=1)  # fmt: skip
    exact = Patches(subdivision).projected_solid_angles * (np.arange(d.shape[1]) > 0)
    same(by_replicate(d, n), exact=exact, within=0.002)
    down = sky_deposit(scene, flat(ORIGIN), flat(DOWN), subdivision=subdivision, rays=64, seed=1)
    assert down.numpy()[0, 0] == pytest.approx(np.pi, rel=1e-5)
    assert np.all(down.numpy()[0, 1:] == 0)


def test_free_receiver_gets_omega_cos_of_every_sun(same):
    normals = np.array([[0, 0, 1], [0, -1, 0], [0.6, 0, -0.8]])
    n = 32
    d = sun_deposit(scenes.build([]), flat(np.zeros((3, 3)), n), flat(normals, n),
                    suns=DIRECTIONS, diameter=0.5, samples=16, seed=2)  # fmt: skip
    # Facing squarely or not at all, none is cut by a horizon: E = L π sin² h cos θ.
    exact = np.pi * np.sin(np.radians(0.25)) ** 2 * np.maximum(normals @ DIRECTIONS.T, 0)
    same(by_replicate(d, n), exact=exact, within=0.001)


def test_suns_behind_an_edge_show_the_segment_that_is_left():
    """A screen whose edge cuts the disks of suns at the zenith, seen from points beside it.

    Of a disk of radius R that an edge passes at distance x from its centre, the part
    (arccos(x/R) − x/R √(1 − x²/R²)) / π shows beyond it.
    """
    height, diameter = 10.0, 2.0
    radius = height * np.tan(np.radians(diameter / 2))
    screen = surface(0.0, quad([-8, -8, height], [8, 0, 0], [0, 16, 0]))  # ends at x = 0
    x = np.concatenate([np.linspace(-1.2, 1.2, 49), np.linspace(-1.2, 1.2, 49)]) * radius
    points = np.stack([x, np.linspace(-1, 1, len(x)), 0 * x], axis=1)
    zenith = Suns(("sun",), np.array([[0, 0, 1.0]]), diameter)
    mean, error = straight_suns(
        scenes.build([screen]), points, np.tile(UP, (len(x), 1)), zenith, Accuracy()
    )
    cut = np.clip(-x / radius, -1, 1)
    part = (np.arccos(cut) - cut * np.sqrt(1 - cut**2)) / np.pi
    seen = mean[:, 0] / (disk_solid_angle(diameter) * np.cos(np.radians(diameter / 4)))
    on_edge = error[:, 0] > 1e-3 * disk_solid_angle(diameter)  # cosines alone make less
    # From 1.5 % on an edge is noticed; the 64 directions may still miss a part of up to 8 %.
    assert on_edge[(part > 0.08) & (part < 0.92)].all(), "an edge went unnoticed"
    assert (error[(part == 0) | (part == 1)] == 0).all()
    np.testing.assert_allclose(seen[~on_edge], part[~on_edge], atol=0.08)
    z = (seen - part)[on_edge] / (error[on_edge, 0] / disk_solid_angle(diameter))
    # Student's t with 7 degrees of freedom, one in 10,000 for all points together (Šidák).
    level = 1 - (1 - 1e-4) ** (1 / len(z))
    assert abs(z).max() < student.isf(level / 2, 7)
    assert 0.5 < (z**2).mean() < 2.5


def test_sun_on_the_horizon_gives_half_a_disk(same):
    n, points, h = 32, 1 << 16, np.radians(5.0)
    d = sun_deposit(scenes.build([]), flat(ORIGIN, n * points), flat(UP, n * points),
                    suns=np.array([[1.0, 0, 0]]), diameter=10.0, samples=1, seed=3)  # fmt: skip
    each = d.numpy().reshape(n, points).mean(axis=1, dtype=float)
    same(each, exact=h - np.sin(h) * np.cos(h), within=0.002)


def test_samples_of_neighbours_are_independent():
    # Sums over many receivers and suns are right only if their random numbers are unrelated.
    count = 1 << 16
    numbers = np.array([even_numbers(mi.UInt32(0), dr.arange(mi.UInt32, count), 3, pair)
                        for pair in (0, 1)]).reshape(4, count)  # fmt: skip
    sun = sun_deposit(scenes.build([]), flat(ORIGIN, count), flat(UP, count),
                      suns=np.array([[1.0, 0, 0]]), diameter=10.0, samples=1, seed=3)  # fmt: skip
    for values in (*numbers, sun.numpy()[:, 0]):
        correlation = np.corrcoef(values[1:], values[:-1])[0, 1]
        assert abs(correlation) < 4.5 / np.sqrt(count)


def test_clear_pane_dims_sky_and_suns_by_its_angle(same):
    scene = scenes.build([plane(0.1, glazing(0.8))])
    n = 32
    low, high, west, east = PATCHES.bounds[1:].T

    def antiderivative(x):  # of τ(x)/τ₀ x = (1 − (1 − x)^4.5) x
        return x**2 / 2 + (1 - x) ** 5.5 / 5.5 - (1 - x) ** 6.5 / 6.5

    row = antiderivative(np.sin(high)) - antiderivative(np.sin(low))
    sky = sky_deposit(scene, flat(ORIGIN, n), flat(UP, n), subdivision=1, rays=1 << 13, seed=4)
    same(by_replicate(sky, n)[..., 1:], exact=0.8 * row * (east - west), within=0.002)
    sun = sun_deposit(scene, flat(ORIGIN, n), flat(UP, n), suns=DIRECTIONS, diameter=0.5,
                      samples=16, seed=4)  # fmt: skip
    cosine = DIRECTIONS[:, 2]
    exact = 0.8 * (1 - (1 - cosine) ** 4.5) * cosine * OMEGA
    same(by_replicate(sun, n), exact=exact, within=0.001)


def test_obstruction_outside_hides_half_the_sky(same):
    # A wall of 1 km, 10 cm to the north: it covers all but 0.01° of the northern half.
    wall = surface(0.0, quad([-500, 0.1, -500], [1000, 0, 0], [0, 0, 1000]))
    scene = scenes.build([wall])
    n = 32
    d = by_replicate(
        sky_deposit(scene, flat(ORIGIN, n), flat(UP, n), subdivision=1, rays=1 << 13, seed=5), n
    )
    upper = np.array([[-500, 0.1, 0], [500, 0.1, 0], [500, 0.1, 500], [-500, 0.1, 500]])
    half = np.pi * (1 - polygon_factor(np.zeros(3), upper))
    assert half == pytest.approx(np.pi / 2, rel=1e-3)
    same(d.sum(axis=-1), exact=half, within=0.002)
    low, _, west, east = PATCHES.bounds.T
    north = np.cos(np.stack([west, east])).min(axis=0) > 1e-3
    south = np.cos(np.stack([west, east])).max(axis=0) < -1e-3
    north[[0, -1]] = south[[0, -1]] = False  # ground and zenith cap
    assert np.all(d[..., north & (low > 0.1)] == 0)
    same(d[..., south], exact=SKY[south], within=0.003)
    sun = sun_deposit(scene, flat(ORIGIN), flat(UP), suns=DIRECTIONS, diameter=0.5, samples=1,
                      seed=5)  # fmt: skip
    assert np.array_equal(sun.numpy()[0] > 0, DIRECTIONS[:, 1] < 0)


# G: gather


@pytest.mark.parametrize("reflectance", [0.5, 0.95])
def test_gathered_weights_in_a_closed_room_are_a_geometric_series(reflectance, same):
    # Σ ρ^k = ρ / (1 − ρ). At 0.95 a path meets 19 surfaces: more than the buffer begins with.
    scene = scenes.build([closed_box(2.0, reflectance)])
    points = np.array([[0, 0, 0], [0.9, -0.9, 0.5]])
    normals = np.array([[0, 0, 1], [-0.6, 0.8, 0]])
    n, paths = 32, 4096
    vertices = gather(scene, points, normals, replicates=n, paths=paths, grid=Grid.of(scene, 0.5),
                      seed=6)  # fmt: skip
    total = np.bincount(vertices.row.numpy(), vertices.weight.numpy(), minlength=2 * n)
    same(total.reshape(n, 2), exact=reflectance / (1 - reflectance), within=0.005)
    if reflectance > 0.9:
        assert len(vertices) > 4 * n * 2 * paths
    # Every vertex lies on the box, and its normal faces inward.
    p, normal = vertices.p.numpy().reshape(-1, 3), vertices.n.numpy().reshape(-1, 3)
    np.testing.assert_allclose(abs(p).max(axis=1), 1, atol=1e-3)
    assert np.all((p * normal).sum(axis=1) < -0.99)


# K: panes


def polygon_factor(points, corner):
    """Form factor from a horizontal receiver at `points` up to a polygon, by Lambert's formula."""
    r = corner - points
    r = r / np.linalg.norm(r, axis=-1, keepdims=True)
    following = np.roll(r, -1, axis=-2)
    cross = np.cross(r, following)
    length = np.linalg.norm(cross, axis=-1)
    angle = np.arctan2(length, (r * following).sum(axis=-1))
    return abs((angle * cross[..., 2] / length).sum(axis=-1)) / (2 * np.pi)


@pytest.mark.parametrize(
    "pane",
    [
        quad([-0.4, 0.1, 1.0], [0, 2, 0], [3, 0, 0]),  # parallel to the receiver, front down
        quad([-0.4, 0.5, 0.3], [2, 0, 0], [0, 0, 1]),  # upright, front to the south
        quad([0.3, 0.2, 0.05], [0.5, 0, 0.1], [0, 0.5, 0.1]),  # close and tilted
    ],
    ids=["parallel", "upright", "close"],
)
def test_transfer_from_patches_is_t_times_the_form_factor(pane, same):
    scene = scenes.build([surface(diffuser(0.4, 0.3), pane)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 0.5)
    n = 32
    k = by_replicate(
        pane_transfer(scene, patches, flat(ORIGIN, n), flat(UP, n), rays=1 << 12, seed=7), n
    )[:, 0]
    a, u, v = patches.corner, patches.u, patches.v
    corners = np.stack([a, a + u, a + u + v, a + v], axis=1)
    factor = polygon_factor(np.zeros(3), corners)
    same(k[:, 1::2], exact=0.4 * factor, within=0.003)  # through the pane, from its back
    same(k[:, 0::2], exact=0.3 * factor, within=0.003)  # off the pane, from its front


def test_pane_that_fills_the_view_transfers_t():
    scene = scenes.build([plane(0.1, diffuser(0.7, 0.2), front=-1)])
    patches = PanePatches.of([s.quads for s in scene.scattering], 300.0)
    k = pane_transfer(scene, patches, flat(ORIGIN), flat(UP), rays=1 << 12, seed=8).numpy()[0]
    assert k[1::2].sum() == pytest.approx(0.7, rel=0.01)
    assert k[0::2].sum() == pytest.approx(0.2, rel=0.01)
    away = pane_transfer(scene, patches, flat(ORIGIN), flat(DOWN), rays=1 << 10, seed=8)
    assert np.all(away.numpy() == 0)


def test_clear_pane_before_a_scattering_one_dims_it_by_its_angle(same):
    # K = T × the diffuse transmittance of the glass, 2 ∫ τ(x) x dx over x = cos θ.
    scene = scenes.build([plane(0.2, diffuser(0.7), front=-1), plane(0.1, glazing(0.8))])
    patches = PanePatches.of([s.quads for s in scene.scattering], 300.0)
    n = 32
    k = pane_transfer(scene, patches, flat(ORIGIN, n), flat(UP, n), rays=1 << 11, seed=8)
    same(by_replicate(k, n).sum(axis=-1), exact=0.7 * 0.8 * (1 - 2 / (5.5 * 6.5)), within=0.002)


def faces(scene, size, replicates, rays, seed):
    """Irradiance of the faces of all panes under the bare sky, one estimate per replicate."""
    patches = PanePatches.of([s.quads for s in scene.scattering], size)
    irradiances = []
    for r in range(replicates):
        p, n = patches.face_points(np.random.default_rng(seed + r))
        received = sky_deposit(scene, p, n, subdivision=1, rays=rays, seed=seed + r)
        between = pane_transfer(scene, patches, p, n, rays=rays, seed=seed + 1000 + r)
        irradiances.append(neumann_series(between, received))
    return patches, irradiances


def test_light_between_two_panes_is_a_geometric_series(same):
    # La = Ta + Ra Lb under the sky, Lb = Ra's light returned: between infinite panes
    # sky: La = Ta / (1 − Ra Rb); ground: La = Ra Tb / (1 − Ra Rb).
    Ta, Ra, Tb, Rb = 0.3, 0.6, 0.2, 0.7
    above, below = (
        plane(0.1, diffuser(Ta, Ra), half=50, front=-1),
        plane(-0.1, diffuser(Tb, Rb), half=50),
    )
    scene = scenes.build([above, below])
    patches, irradiances = faces(scene, 34.0, 32, 1 << 12, seed=9)
    assert len(patches) == 18
    c = [
        (pane_transfer(scene, patches, flat(ORIGIN), flat(UP), rays=1 << 12, seed=500 + r) @ e)
        .numpy()
        for r, e in enumerate(irradiances)
    ]  # fmt: skip
    exact = SKY * Ta / (1 - Ra * Rb)
    exact[0] = np.pi * Ra * Tb / (1 - Ra * Rb)
    same(np.array(c)[:, 0], exact=exact, within=0.003)


def test_inside_a_box_of_panes_it_is_pi_t_over_1_minus_r(same):
    # With π on every outer face, L = T + R L is the same all over the inside.
    scene = scenes.build([closed_box(2.0, diffuser(0.3, 0.6))])
    patches, irradiances = faces(scene, 0.5, 16, 256, seed=20)
    points, normals = np.array([[0, 0, 0], [0.8, 0.5, -0.9]]), np.array([[0, 0, 1], [-0.6, 0, 0.8]])
    c = [
        (pane_transfer(scene, patches, flat(points), flat(normals), rays=1 << 12, seed=r) @ e)
        .numpy().sum(axis=1)
        for r, e in enumerate(irradiances)
    ]  # fmt: skip
    same(c, exact=np.pi * 0.3 / (1 - 0.6), within=0.005)


# C = D + G·D: exact answers


def test_free_sensors_get_pi_and_omega_cos(same):
    ground_far_below = [plane(-300, 0.2, half=0.5)]  # something that paths can meet, of no weight
    c = run(ground_far_below, ORIGIN, UP, SUNS, sensor_sky_rays=1 << 14)
    exact = np.append(SKY, np.pi * np.sin(np.radians(0.25)) ** 2 * DIRECTIONS[:, 2])
    same(c, exact=exact, within=0.002)


def test_white_closed_box_is_exactly_dark():
    c = run([closed_box(2.0, 1.0)], ORIGIN, UP, SUNS, replicates=2, paths=256)
    assert np.all(c == 0)


def test_matt_plane_below_returns_its_reflectance(same):
    # A sensor that looks down on an endless plane under the free sky: C = ρ × (free C).
    c = run([plane(-0.5, 0.4)], ORIGIN, DOWN, SUNS, cell_size=20.0, paths=2048, cell_sky_rays=256)
    exact = 0.4 * np.append(SKY, OMEGA * DIRECTIONS[:, 2])
    same(c, exact=exact, within=0.005)


def test_standard_errors_are_honest():
    # The same exact answer: of 145 bins × 8 seeds, z² has the mean of Student's t.
    exact, z, n = 0.4 * SKY[1:], [], 16
    scene = scenes.build([plane(-0.5, 0.4)])
    for seed in range(8):
        accuracy = Accuracy(seed=seed, replicates=n, cell_size=20.0, paths=512, cell_sky_rays=256)
        c = compute(scene, ORIGIN, DOWN, NO_SUNS, accuracy)
        z.append((c["interreflected"] - np.append(0, exact)) / c["interreflected_se"])
    z = np.array(z)[..., 1:]
    expected = (n - 1) / (n - 3)
    print(f"mean z² {np.mean(z**2):.3f}, expected {expected:.3f}")
    assert np.mean(z**2) == pytest.approx(expected, rel=0.2)


def test_white_room_with_a_window_is_a_furnace(same):
    # Reflectance 1 inside, lossless pane, 1 all around: π everywhere, whatever the bins.
    clear = {"type": "glazing", "transmittance": 0.8, "exponent": 5.0, "reflectance": 0.2}
    white = dict.fromkeys(("walls", "floor", "ceiling", "frame_reflectance"), 1.0)
    case = room([(0.5, 2.9, "clear")], {"clear": clear}, **white)
    points, normals = sensor_points(case)
    c = run(scenes.load(case), points, normals, paths=2048, sensor_sky_rays=2048, cell_size=0.2)
    same(c.sum(axis=-1), exact=np.pi, within=0.005)


# C = D + G·D and the plain path tracer: a small room


def room(
    strips,
    materials=None,
    rotation=0.0,
    furniture=(),
    shading=None,
    frame=0.1,
    frame_reflectance=0.5,
    **reflectances,
):
    """Room of 3 × 4 × 3 m with its façade to the south and six sensors."""
    facade = {
        "segments": 2,
        "frame": frame,
        "frame_reflectance": frame_reflectance,
        "strips": [{"bottom": b, "top": t, "material": m} for b, t, m in strips],
    }
    size = {"size": [3, 4, 3], "rotation": rotation}
    return Case.model_validate(
        {
            "room": size | {"floor": 0.3, "ceiling": 0.8, "walls": 0.6} | reflectances,
            "facade": {"south": facade},
            "materials": materials or {},
            "furniture": furniture,
            "shading": shading,
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 3], "spacing": 1.0},
        }
    )


GLASS = {"type": "glazing", "transmittance": 0.65, "reflectance": 0.12}
OPAL = {"type": "diffuser", "transmittance": 0.4, "reflectance": 0.3}
CLOTH = {"type": "diffuser", "transmittance": 0.15, "reflectance": 0.5}
WINDOW = [(0.9, 2.7, "glass")]
OPPOSITE = {"name": "house", "corner": [-1, -4, 0], "size": [4, 1, 4], "reflectance": 0.5}
BENCH = {"name": "bench", "corner": [0.3, 2.2, 0.1], "size": [2.4, 0.6, 0.5], "reflectance": 0.7}

ROOMS = {
    "open hole": lambda: (room([(0.9, 2.7, "open")]), "open"),
    "glazing with inner reflectance": lambda: (room(WINDOW, {"glass": GLASS}), "open"),
    "shaded": lambda: (
        room(WINDOW, {"glass": GLASS, "cloth": CLOTH}, shading={"material": "cloth"}), "shaded"),
    "opal above clear": lambda: (
        room([(0.9, 1.8, "glass"), (1.8, 2.7, "opal")], {"glass": GLASS, "opal": OPAL}), "open"),
    "house opposite and bench": lambda: (
        room(WINDOW, {"glass": GLASS}, furniture=[OPPOSITE, BENCH]), "open"),
}  # fmt: skip

FINE = {"replicates": 16, "paths": 1024, "sensor_sky_rays": 8192, "pane_points": 128}
ROUGH = {"replicates": 16, "paths": 256, "cell_size": 0.3, "sensor_sky_rays": 2048}


@pytest.mark.parametrize("name", ROOMS)
def test_gd_agrees_with_the_plain_path_tracer(name, same, plain_coefficients):
    case, state = ROOMS[name]()
    points, normals = sensor_points(case)
    here = run(scenes.load(case, state), points, normals, SUNS, **FINE)
    there = plain_coefficients(
        with_sources(surfaces_of(case, state)),
        points,
        normals,
        spp=1 << 12,
        seed=list(ROOMS).index(name),
    ).sum(axis=0)
    same(here[..., :146], other=there[..., :146], within=0.01)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


def test_turned_room_is_the_plain_room_under_the_turned_sky(same, plain_coefficients):
    # The room turns clockwise, so that in its own frame the sky turns the other way.
    turned, plain = (
        room(WINDOW, {"glass": GLASS}, rotation=angle, furniture=[BENCH]) for angle in (37.0, 0.0)
    )
    here = run(scenes.load(turned), *sensor_points(turned), SUNS, **FINE)
    there = plain_coefficients(
        with_sources(surfaces_of(plain), turn=37.0), *sensor_points(plain), spp=1 << 12
    ).sum(axis=0)
    same(here[..., :146], other=there[..., :146], within=0.01)
    same(here[..., 146:], other=there[..., 146:], within=0.02)


def test_back_of_a_pane_is_black_outside(same, plain_coefficients):
    # Panes reflect towards the room only, in both estimators: an opal strip and a house opposite.
    case = room([(0.9, 2.7, "opal")], {"opal": OPAL}, furniture=[OPPOSITE])
    points, normals = np.array([[1.5, -0.3, 1.8]]), np.array([[0, 1.0, 0]])
    here = run(scenes.load(case), points, normals, SUNS, **FINE)
    there = plain_coefficients(with_sources(surfaces_of(case)), points, normals, spp=1 << 13)
    same(here, other=there.sum(axis=0), within=0.01)


def test_direct_and_interreflected_are_told_apart_alike(same, plain_coefficients):
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    c = compute(scenes.load(case), points, normals, SUNS, Accuracy(cell_size=0.1, **FINE))
    direct = plain_coefficients(
        with_sources(surfaces_of(case)), points, normals, spp=1 << 12, max_depth=2
    )[0]
    # `coefficient` calls direct what met no diffuse surface; so do transport's means.
    mean, error = direct.mean(axis=0), direct.std(axis=0, ddof=1) / np.sqrt(len(direct))
    sure = (error < 0.1 * mean) & (c["direct_se"].values < 0.1 * c["direct"].values)
    sure[:, 146:] = False  # a sun through glass is the same number in all replicates
    assert sure.sum() > 100
    z = (c["direct"].values - mean)[sure] / np.hypot(c["direct_se"].values, error)[sure]
    # Student's t of 15 and 31 degrees of freedom: 1.07 to 1.15.
    print(f"mean z² of {z.size} entries {np.mean(z**2):.3f}")
    assert np.mean(z**2) == pytest.approx(1.1, abs=0.35)
    assert np.all(c["straight"].values <= c["direct"].values)
    assert c["straight"].sum() < 0.9 * c["direct"].sum()


# What must not matter


def test_openings_spare_rays_and_lose_no_light():
    case = room(WINDOW, {"glass": GLASS}, frame=0.0)  # panes reach the rim of the openings
    points, normals = sensor_points(case)
    known, unknown = scenes.load(case), scenes.build(surfaces_of(case))
    assert known.enclosure is not None
    assert unknown.enclosure is None
    p, n = flat(points, 24), flat(normals, 24)
    sky = [sky_deposit(s, p, n, subdivision=1, rays=1024, seed=1).numpy() for s in (known, unknown)]
    assert np.array_equal(*sky)
    assert sky[0].sum() > 0
    # A year's worth of suns, in clusters of neighbours that are ruled out together.
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(1024, 3))
    directions = abs(directions) * [1, -1, 1] / np.linalg.norm(directions, axis=1, keepdims=True)
    p, n = flat(points), flat(normals)
    sun = [
        sun_deposit(s, p, n, suns=directions, diameter=0.5, samples=4, seed=1).numpy()
        for s in (known, unknown)
    ]
    assert np.array_equal(*sun)
    assert sun[0].sum() > 0


def test_threads_do_not_matter():
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    threads = dr.thread_count()
    runs = []
    try:
        for count in (1, 2):
            dr.set_thread_count(count)
            runs.append(run(scene, points, normals, SUNS, replicates=2, cell_size=0.2))
    finally:
        dr.set_thread_count(threads)
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-5, atol=1e-5 * runs[0].mean())


def test_seed_decides_and_another_seed_differs():
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    a, b, c = (
        run(scene, points, normals, SUNS, replicates=2, cell_size=0.2, seed=s) for s in (1, 1, 2)
    )
    np.testing.assert_allclose(a, b, rtol=1e-5, atol=1e-5 * a.mean())
    assert np.abs(a - c).max() > 1e-3 * a.max()


def test_blocks_of_sensors_do_not_matter(same, monkeypatch):
    case, _ = ROOMS["opal above clear"]()
    points, normals = sensor_points(case)
    scene = scenes.load(case)
    whole = run(scene, points, normals, SUNS, **ROUGH)
    monkeypatch.setattr(coefficients, "BLOCK", 4)
    parts = run(scene, points, normals, SUNS, seed=77, **ROUGH)
    same(parts, other=whole, within=0.02)


def test_order_and_cut_of_surfaces_do_not_matter(same):
    case, state = ROOMS["house opposite and bench"]()
    points, normals = sensor_points(case)
    things = surfaces_of(case, state)
    cut = []
    for s in reversed(things):
        for q in s.quads:
            u, v = (q[1] - q[0]) / 2, q[3] - q[0]
            cut += [Surface("part", s.material, np.array([quad(q[0] + i * u, u, v)]))
                    for i in (0, 1)]  # fmt: skip
    whole = run(scenes.build(things), points, normals, SUNS, **ROUGH)
    parts = run(scenes.build(cut), points, normals, SUNS, seed=5, **ROUGH)
    same(parts, other=whole, within=0.02)


def test_scene_without_any_diffuse_surface(same):
    # Nothing to gather: C is D alone.
    c = run([plane(0.1, glazing(0.8), half=50)], ORIGIN, UP, cell_size=1.0, sensor_sky_rays=1 << 14)
    same(c.sum(axis=-1), exact=0.8 * np.pi * (1 - 2 / (5.5 * 6.5)), within=0.002)


def test_block_of_sensors_that_meets_nothing(same, monkeypatch):
    # The second sensor looks away from the only surface there is.
    monkeypatch.setattr(coefficients, "BLOCK", 1)
    points, normals = np.zeros((2, 3)), np.vstack([DOWN, UP])
    c = run([plane(-0.5, 0.4)], points, normals, cell_size=20.0, cell_sky_rays=256)
    same(c[:, 0], exact=0.4 * SKY, within=0.01)
    same(c[:, 1], exact=SKY, within=0.01)


# The bias of cells


def test_bias_of_cells_falls_with_their_size():
    """Two sensors that look down from 10 cm on either side of the edge of a sun patch.

    A screen shades the plane z = 0 where x < 0; the sensors stand at x = ±5 cm. Exactly, the lit
    half plane fills F = ½ (1 ± sin arctan(x / h)) of their views and C = ρ Ω F. Both share the
    cells below them: one large cell shows them the same light, so the whole difference between
    them is lost; what small cells lose is what F varies across a cell on the edge.
    """
    rho, h, x = 0.5, 0.1, 0.05
    zenith = Suns(("sun",), np.array([[0, 0, 1.0]]), diameter=0.01)
    screen = surface(0.0, quad([-8, -8, 1], [8, 0, 0], [0, 16, 0]))
    scene = scenes.build([plane(0.0, rho, half=4), screen])
    points = np.array([[x, 0, h], [-x, 0, h]])
    exact = rho * disk_solid_angle(0.01) * np.sin(np.arctan(x / h))
    lost, noise = {}, {}
    for count in (3, 26, 79, 199):  # across 8 m, such that the edge halves a cell
        size = 8 / (count + 0.13)
        key = Grid.of(scene, size).key(
            mi.Point3f([-0.4 * size, 0.4 * size], 0, 0), mi.Normal3f(0, 0, 1)
        )
        assert key[0] == key[1]
        c = run(scene, points, np.tile(DOWN, (2, 1)), zenith, cell_size=size, replicates=32,
                paths=1 << 11)[..., -1]  # fmt: skip
        difference = c[:, 0] - c[:, 1]
        lost[size] = 1 - difference.mean() / exact
        noise[size] = difference.std(ddof=1) / np.sqrt(len(c)) / exact
    print({f"{s:.2f} m": f"lost {lost[s]:+.1%} ± {noise[s]:.1%}" for s in lost})
    coarse, *_, fine = lost.values()
    assert coarse > 0.9  # the case shows the bias
    assert abs(fine) < 0.05
    assert list(lost.values()) == sorted(lost.values(), reverse=True)
    assert all(n < 0.03 for n in noise.values())
