"""D by shadow rays: exact answers under free skies, behind edges, panes and openings."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches
from drcmitsuba_plugins.sampling import disk_solid_angle
from scipy.stats import t as student

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime.random_streams import even_numbers
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.scene.surfaces import surfaces_of
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.rays.shadow_rays import sky_deposit, sun_deposit
from drcmitsuba.transport.rays.straight_suns import Disks, sliver, straight_suns
from tests.unit.transport.exact_scenes import (
    DIRECTIONS,
    DOWN,
    GLASS,
    OMEGA,
    ORIGIN,
    PATCHES,
    SKY,
    UP,
    WINDOW,
    by_replicate,
    flat,
    glazing,
    plane,
    polygon_factor,
    quad,
    room,
    surface,
)


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


def test_intervals_hold_where_an_edge_passes_and_no_error_is_zero():
    """The segment that a straight edge leaves, of points all over the half-shadow."""
    n, height, diameter, accuracy = 6000, 10.0, 0.533, Accuracy()
    radius = height * np.tan(np.radians(diameter / 2))
    screen = surface(0.0, quad([-8, -8, height], [8, 0, 0], [0, 16, 0]))
    x, y = np.random.default_rng(3).uniform(-1, 1, (2, n))
    points = np.stack([radius * x, y, 0 * x], axis=1)
    disks = Disks(
        scenes.build([screen]), np.array([[0, 0, 1.0]]), diameter, accuracy,
        flat(points), flat(np.tile(UP, (n, 1))), dr.arange(mi.UInt32, n), None,
    )  # fmt: skip
    D = disks.by_replicate(range(accuracy.replicates), accuracy.sensor_sun_samples)
    whole = disk_solid_angle(diameter) * np.cos(np.radians(diameter / 4))
    seen = D.numpy().reshape(accuracy.replicates, n) / whole
    part = (np.arccos(-x) + x * np.sqrt(1 - x**2)) / np.pi
    error = seen.std(axis=0, ddof=1) / np.sqrt(len(seen))
    crossed = (part > 0.03) & (part < 0.97)
    assert (error[crossed] > 0.002).all()
    off = seen.mean(axis=0) - part
    held = abs(off) < student.isf(0.025, len(seen) - 1) * error
    for low, high in ((0.03, 0.1), (0.1, 0.9), (0.9, 0.97)):
        some = (part > low) & (part < high)
        print(f"{low} to {high}: {held[some].mean():.3f} of {some.sum()}")
        assert held[some].mean() > 0.93
        assert abs(off[some].mean()) < 0.005
    assert np.sqrt((off[crossed] ** 2).mean()) < 0.04
    assert held[(part > 0.1) & (part < 0.9)].mean() < 0.98


def test_what_is_expected_of_a_sliver_falls_with_the_number_of_directions():
    assert sliver(48) == pytest.approx(0.8 / 48, rel=0.1)
    assert sliver(480) < sliver(48) / 5


def test_a_screen_finer_than_the_sun_lets_its_open_share_through(same):
    """Bars of which dozens cross a disk: its rim is often alike where the disk is not."""
    pitch, height, share = 0.004, 10.0, 0.05
    at = np.arange(-0.5, 0.5, pitch)
    bar = (1 - share) * pitch
    bars = [surface(0.0, quad([-1, y, height], [2, 0, 0], [0, bar, 0])) for y in at]
    n = 1200
    points = np.c_[np.random.default_rng(1).uniform(-0.2, 0.2, (n, 2)), np.zeros(n)]
    disks = Disks(
        scenes.build(bars), np.array([[0, 0, 1.0]]), 0.5, Accuracy(seed=3, replicates=32),
        flat(points), flat(np.tile(UP, (n, 1))), dr.arange(mi.UInt32, n), None,
    )  # fmt: skip
    edges = disks.rims.edges
    D = disks.by_replicate(range(32), 4).numpy().reshape(32, n)
    assert 0.2 < dr.width(edges) / n < 0.8  # the rims of the others miss every gap
    whole = disk_solid_angle(0.5)
    same(D.mean(axis=1, dtype=float) / whole, exact=share, within=0.03)
    every, some = disks.by_replicate(range(32), 4), disks.by_replicate(range(8, 16), 4)
    np.testing.assert_array_equal(some.numpy(), every.numpy()[8 * n : 16 * n])


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
