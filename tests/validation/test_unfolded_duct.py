"""The exact duct against limits, a ray tracer, and quadrature: a reference must be right itself.

Expected: without loss everything comes through; rays followed wall by wall bring the same share,
places and directions; the sum of view factors equals the integral over the hemisphere to 1e-8.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.validation import unfolded_duct as duct

LONG = [pytest.param(*of, 8.0, marks=pytest.mark.slow) for of in ((0.9,), (0.99,))]
GRID = [(0.9, 1.0), (0.95, 2.5), *LONG]


def traced(
    start: np.ndarray, direction: np.ndarray, aspect: float, reflectance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays followed from wall to wall: place and direction at the exit, and their weight."""
    place, d = np.array(start, float), np.array(direction, float)
    z, weight = np.zeros(len(place)), np.ones(len(place))
    active = np.arange(len(place))
    while active.size:
        p, v = place[active], d[active]
        with np.errstate(divide="ignore", invalid="ignore"):
            to_wall = np.where(v[:, :2] > 0, (1 - p) / v[:, :2], -p / v[:, :2])
        to_wall[v[:, :2] == 0] = np.inf
        axis = to_wall.argmin(axis=1)
        to_wall = to_wall.min(axis=1)
        to_exit = (aspect - z[active]) / v[:, 2]
        step = np.minimum(to_wall, to_exit)
        place[active] += step[:, None] * v[:, :2]
        z[active] += step * v[:, 2]
        hit = to_wall < to_exit
        active, axis = active[hit], axis[hit]
        place[active, axis] = d[active, axis] > 0
        d[active, axis] *= -1
        weight[active] *= reflectance
    return place, d, weight


def even(count: int, dimensions: int) -> np.ndarray:
    """Points of an additive recurrence, even over the unit cube."""
    phi = np.roots([1, *[0] * (dimensions - 1), -1, -1])
    phi = float(phi[np.isreal(phi) & (phi.real > 1)].real[0])
    return (0.5 + np.outer(np.arange(count), phi ** -np.arange(1.0, dimensions + 1))) % 1


def lambertian(square: np.ndarray) -> np.ndarray:
    radius, angle = np.sqrt(square[:, 0]), 2 * np.pi * square[:, 1]
    return np.stack(
        [radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - square[:, 0])], axis=-1
    )


@pytest.mark.parametrize("aspect", [1.0, 3.7, 8.0])
def test_no_loss(aspect):
    d = lambertian(even(100, 2))
    np.testing.assert_allclose(duct.collimated(d, aspect, 1.0), 1, rtol=1e-15)
    assert duct.diffuse(aspect, 1.0) == 1
    assert duct.diffuse(aspect, 0.9) < duct.diffuse(aspect, 0.95) < 1


@pytest.mark.parametrize("reflectance", [0.0, 0.5, 0.9, 0.99])
def test_no_length(reflectance):
    d = lambertian(even(100, 2))
    np.testing.assert_array_equal(duct.collimated(d, 0.0, reflectance), 1)
    assert duct.diffuse(0.0, reflectance) == 1
    assert 1 - duct.diffuse(1e-3, reflectance) < 2e-3


def test_black_duct_is_a_view_factor():
    """The published factor of two squares one width apart."""
    assert duct.diffuse(1.0, 0.0) == pytest.approx(0.19982490, abs=1e-8)


@pytest.mark.parametrize(("reflectance", "aspect"), GRID)
@pytest.mark.parametrize("direction", [(0, 0, 1), (0.7, 0, 1), (-0.31, 0.83, 1), (2.2, -1.3, 1)])
def test_collimated(direction, reflectance, aspect):
    """A grid of rays: the share within the error of a midpoint rule, every exit cell as well."""
    n, cells = 480, 6
    u = (np.arange(n) + 0.5) / n
    start = np.stack([a.ravel() for a in np.meshgrid(u, u, indexing="ij")], axis=-1)
    d = np.tile(np.array(direction, float), (len(start), 1))
    place, out, weight = traced(start, d, aspect, reflectance)
    exact = duct.collimated(np.array(direction, float), aspect, reflectance)
    # The two numbers of mirrors along an axis change places somewhere between two rays.
    assert weight.mean() == pytest.approx(exact, rel=2 * (1 - reflectance) / n)
    counts = np.zeros_like(weight)
    for signs, expected in duct.exit_cells(direction, aspect, reflectance, cells).items():
        mine = np.all(np.where(out[:, :2] < 0, -1, 1) == signs, axis=1)
        at = np.minimum((place[mine] * cells).astype(int), cells - 1)
        sums = np.zeros((cells, cells))
        np.add.at(sums, tuple(at.T), weight[mine])
        # A row of rays more or less on either axis.
        np.testing.assert_allclose(sums / n**2 * cells**2, expected, atol=3 * cells / n)
        counts += mine
    assert (counts == 1).all()
    total = sum(c.mean() for c in duct.exit_cells(direction, aspect, reflectance, cells).values())
    assert total == pytest.approx(exact, rel=1e-13)


def by_quadrature(aspect: float, reflectance: float) -> float:
    """(1/π) ∫∫ X(A a) X(A b) (1 + a² + b²)⁻² da db: by hand along a, Gauss along b.

    Between two kinks X is a line, against which (c² + a²)⁻² has a primitive. The rest beyond the
    last kink is below ρᴺ.
    """
    count = int(np.ceil(np.log(1e-10) / np.log(reflectance)))
    kinks, values = np.arange(count + 1) / aspect, reflectance ** np.arange(count + 1.0)
    slope = np.diff(values) / np.diff(kinks)
    offset = values[:-1] - slope * kinks[:-1]
    x, w = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for low, high, s, o in zip(kinks[:-1], kinks[1:], slope, offset, strict=True):
        b = low + (high - low) * (x + 1) / 2
        c = np.sqrt(1 + b**2)[:, None]
        even_part = kinks / (2 * c**2 * (c**2 + kinks**2)) + np.arctan(kinks / c) / (2 * c**3)
        odd_part = -1 / (2 * (c**2 + kinks**2))
        inner = np.diff(even_part) @ offset + np.diff(odd_part) @ slope
        total += (high - low) / 2 * np.dot(w, inner * (o + s * b))
    return 4 * total / np.pi


@pytest.mark.parametrize(("reflectance", "aspect"), GRID)
def test_diffuse_by_quadrature(reflectance, aspect):
    assert duct.diffuse(aspect, reflectance) == pytest.approx(
        by_quadrature(aspect, reflectance), abs=1e-8
    )


@pytest.mark.parametrize(("reflectance", "aspect"), GRID)
def test_diffuse_by_rays(reflectance, aspect):
    shares = []
    for seed in range(8):
        square = (even(20_000, 4) + np.random.default_rng(seed).random(4)) % 1
        *_, weight = traced(square[:, :2], lambertian(square[:, 2:]), aspect, reflectance)
        shares.append(weight.mean())
    error = np.std(shares, ddof=1) / 8**0.5
    assert error < 3e-4
    assert abs(np.mean(shares) - duct.diffuse(aspect, reflectance)) < 6 * error


def test_disk():
    """Where X is a line all over the sun, the disk has nearly the value of its centre; else not."""
    straight = np.array([0.55, 0.55, 1.0])
    centre = duct.collimated(straight, 1.0, 0.9)
    assert duct.disk(straight, 0.5, 1.0, 0.9) == pytest.approx(centre, rel=1e-5)
    kink = np.array([1.0, 0.3, 1.0])
    # A kink is convex: the mean over the disk lies above.
    over = duct.disk(kink, 0.5, 8.0, 0.9)
    assert over > duct.collimated(kink, 8.0, 0.9) * (1 + 1e-5)
    assert over == pytest.approx(duct.disk(kink, 0.5, 8.0, 0.9, 200_003), rel=1e-6)


def test_on_disk_is_even():
    d = duct.on_disk([0.2, -0.4, 0.7], 0.5, 10_000)
    centre = np.array([0.2, -0.4, 0.7]) / np.linalg.norm([0.2, -0.4, 0.7])
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, rtol=1e-14)
    half = np.radians(0.25)
    # ∫cos dΩ / Ω over a cone: cos²(h/2).
    assert (d @ centre).mean() == pytest.approx(np.cos(half / 2) ** 2, abs=1e-9)
    angle = np.arcsin(np.linalg.norm(np.cross(d, centre), axis=1))
    assert angle.max() < half
    assert angle.max() > 0.999 * half
