"""The exact optics against energy, tables, and light split up surface by surface.

Method: `split` follows light through a convex prism, both parts of it at every surface, until less
than 1e-12 is left. It knows no formula for slabs and prisms, and has to find their shares.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.validation import exact_optics as optics


def split(
    corners: np.ndarray, ior: float, start: np.ndarray, direction: np.ndarray, absorption: float = 0
) -> tuple[dict[tuple[float, float], float], float]:
    """Flux by outgoing direction from a prism of convex section (anticlockwise), and what it keeps.

    The ray starts outside the section, in its plane.
    """
    a, b = corners, np.roll(corners, -1, axis=0)
    normals = np.stack([(b - a)[:, 1], -(b - a)[:, 0]], axis=-1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    three = np.pad(normals, ((0, 0), (0, 1)))
    out: dict[tuple[float, float], float] = {}
    absorbed = 0.0

    def leave(d: np.ndarray, flux: float) -> None:
        key = tuple(float(v) for v in np.round(d[:2], 9) + 0.0)
        out[key] = out.get(key, 0.0) + flux

    def ahead(p: np.ndarray, d: np.ndarray, inside: bool) -> tuple[float, int]:
        facing = normals @ d[:2]
        right = facing > 1e-12 if inside else facing < -1e-12
        way = np.where(right, ((a - p) * normals).sum(axis=1) / np.where(right, facing, 1), np.nan)
        face = int(np.nanargmin(way) if inside else np.nanargmax(way))
        return float(way[face]), face

    d = np.append(direction, 0.0)
    way, face = ahead(np.asarray(start, float), d, inside=False)
    p = start + way * d[:2]
    r = float(optics.fresnel(-(three[face] @ d), ior))
    leave(optics.reflected(d, three[face]), r)
    waiting = [(p, optics.refracted(d, three[face], ior), 1 - r)]
    while waiting:
        p, d, flux = waiting.pop()
        way, face = ahead(p, d, inside=True)
        left = flux * np.exp(-absorption * way)
        absorbed += flux - left
        r = float(optics.fresnel(three[face] @ d, 1 / ior))
        if r < 1:
            leave(optics.refracted(d, three[face], 1 / ior), left * (1 - r))
        if left * r > 1e-12:
            waiting.append((p + way * d[:2], optics.reflected(d, three[face]), left * r))
    return out, absorbed


def heading(degrees: float) -> np.ndarray:
    return np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])


def test_fresnel():
    assert optics.fresnel(1.0, 1.5) == pytest.approx(0.04, rel=1e-14)
    assert optics.fresnel(1.0, 1 / 1.5) == pytest.approx(0.04, rel=1e-14)
    assert optics.fresnel(1e-9, 1.5) == pytest.approx(1, rel=1e-7)
    brewster = 1 / np.hypot(1, 1.5)
    across = ((1 - 1.5**2) / (1 + 1.5**2)) ** 2
    assert optics.fresnel(brewster, 1.5) == pytest.approx(across / 2, rel=1e-14)
    # The same from within, and all of it beyond the critical angle.
    c = np.linspace(0.01, 1, 50)
    inside = np.sqrt(1 - (1 - c**2) / 1.5**2)
    np.testing.assert_allclose(optics.fresnel(inside, 1 / 1.5), optics.fresnel(c, 1.5), rtol=1e-12)
    assert optics.fresnel(np.cos(np.radians(41.9)), 1 / 1.5) == 1
    assert optics.fresnel(np.cos(np.radians(41.7)), 1 / 1.5) < 1


@pytest.mark.parametrize("absorption", [0.0, 30.0])
@pytest.mark.parametrize("degrees", [0.0, 25.0, 60.0, 80.0])
def test_slab(degrees, absorption):
    """A slab a thousand times as wide as thick, in pieces."""
    thickness = 0.01
    box = np.array([[0, -5.0], [thickness, -5], [thickness, 5], [0, 5]])
    out, absorbed = split(box, 1.52, np.array([-0.1, 0.0]), heading(degrees), absorption)
    cosine = float(np.cos(np.radians(degrees)))
    expected = optics.slab(cosine, 1.52, thickness, absorption)
    sides = [sum(flux for (x, _), flux in out.items() if (x > 0) == through) for through in (1, 0)]
    assert sides == pytest.approx([expected.transmitted, expected.reflected], abs=1e-10)
    assert absorbed == pytest.approx(expected.absorbed, abs=1e-10)
    ahead = tuple(float(v) for v in np.round(heading(degrees), 9) + 0.0)
    assert out[ahead] == pytest.approx(expected.transmitted, abs=1e-10)
    if absorption == 0:
        r = float(optics.fresnel(cosine, 1.52))
        assert expected.transmitted == pytest.approx((1 - r) / (1 + r), rel=1e-12)


def test_what_polarisation_would_add():
    """The figures that the module's text names."""
    for degrees, more in ((60, 0.014), (75, 0.037)):
        c = np.cos(np.radians(degrees))
        t = np.sqrt(1 - (1 - c**2) / 1.5**2)
        each = [((c - 1.5 * t) / (c + 1.5 * t)) ** 2, ((1.5 * c - t) / (1.5 * c + t)) ** 2]
        real = np.mean([(1 - r) / (1 + r) for r in each])
        assert real / optics.slab(c, 1.5).transmitted - 1 == pytest.approx(more, rel=0.05)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 70.0])
def test_shift(degrees):
    d, normal = np.append(heading(degrees), 0), np.array([1.0, 0, 0])
    inside = optics.refracted(d, normal, 1.5)
    leaves = inside * 0.02 / inside[0]
    off = np.linalg.norm(leaves - (leaves @ d) * d)
    assert optics.shift(np.cos(np.radians(degrees)), 1.5, 0.02) == pytest.approx(off, abs=1e-15)


RIGHT_ANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Legs on the axes, the hypotenuse between their ends."""


@pytest.mark.parametrize("absorption", [0.0, 0.4])
@pytest.mark.parametrize("height", [0.1, 0.37, 0.8])
def test_side_prism(height, absorption):
    """In by the leg x = 0, out by the leg y = 0."""
    start = np.array([-1.0, height])
    out, absorbed = split(RIGHT_ANGLE, 1.5, start, heading(0), absorption)
    expected = optics.side_prism(1.5, 1.0, absorption)
    assert set(out) == {(0.0, -1.0), (-1.0, 0.0)}
    assert out[0.0, -1.0] == pytest.approx(expected.transmitted, abs=1e-11)
    assert out[-1.0, 0.0] == pytest.approx(expected.reflected, abs=1e-11)
    assert absorbed == pytest.approx(expected.absorbed, abs=1e-11)
    with pytest.raises(ValueError, match="needs more than √2"):
        optics.side_prism(1.4)


@pytest.mark.parametrize("absorption", [0.0, 0.4])
def test_roof_prism(absorption):
    """In by the hypotenuse, and back the same way."""
    start = np.array([0.3, 0.7]) + heading(45) * 2
    out, absorbed = split(RIGHT_ANGLE, 1.5, start, -heading(45), absorption)
    expected = optics.roof_prism(1.5, 2**0.5, absorption)
    assert sum(out.values()) == pytest.approx(expected.reflected, abs=1e-11)
    assert len(out) == 1
    assert next(iter(out)) == pytest.approx(tuple(heading(45)), abs=1e-8)
    assert absorbed == pytest.approx(expected.absorbed, abs=1e-11)
    if absorption == 0:
        assert expected.reflected == pytest.approx(1, rel=1e-14)


def test_prism_turns_light_as_snell_says():
    """An equilateral prism at its least deviation, sin((A + δ)/2) = n sin(A/2)."""
    apex = np.radians(60)
    deviation = 2 * np.arcsin(1.5 * np.sin(apex / 2)) - apex
    incidence = (apex + deviation) / 2
    first = np.array([-np.cos(apex / 2), np.sin(apex / 2), 0])
    last = first * [-1, 1, 1]
    into = np.array([np.cos(-apex / 2 + incidence), np.sin(-apex / 2 + incidence), 0])
    out = optics.refracted(optics.refracted(into, first, 1.5), last, 1 / 1.5)
    assert np.arccos(into @ out) == pytest.approx(deviation, rel=1e-12)
    with pytest.raises(ValueError, match="total reflection"):
        optics.refracted(np.array([0.6, 0.8, 0]), np.array([1.0, 0, 0]), 1 / 1.5)


def tilted_mirror(turn: float) -> optics.Mirror:
    """0.4 × 0.6 m about the point (0, 0, 2), facing south and up."""
    along = np.array([1.0, 0, 0])
    up = np.array([0, np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    corner = np.array([0.0, 0, 2]) - 0.2 * along - 0.3 * up
    return optics.Mirror(
        np.array(
            [corner, corner + 0.4 * along, corner + 0.4 * along + 0.6 * up, corner + 0.6 * up]
        ),
        0.85,
    )


@pytest.mark.parametrize("turn", [40.0, 75.0])
def test_mirror_images_the_sun(turn):
    """Rays from the disk to the mirror and on to the wall: place, area, irradiance and flux."""
    mirror, rng = tilted_mirror(turn), np.random.default_rng(0)
    sun = -np.array([0.15, -0.5, 0.8]) / np.linalg.norm([0.15, -0.5, 0.8])
    point, normal = np.array([0.0, -3, 0]), np.array([0.0, 1, 0])
    count = 400_000
    u, v = rng.random((2, count, 1))
    q = mirror.quad
    start = q[0] + u * (q[1] - q[0]) + v * (q[3] - q[0])
    disk = _even_disk(sun, 0.5, rng.random((2, count)))
    out = optics.reflected(disk, mirror.normal)
    way = ((point - start) @ normal / (out @ normal))[:, None]
    assert (way > 0).all()
    place = start + way * out
    half = np.radians(0.25)
    weight = abs(disk @ mirror.normal) * mirror.reflectance * 0.24
    weight *= 4 * np.pi * np.sin(half / 2) ** 2 / count
    assert weight.sum() == pytest.approx(mirror.flux(sun, 0.5), rel=1e-5)

    spot = mirror.spot(sun, point, normal)
    expected = mirror.irradiance(sun, normal, 0.5)
    ahead = abs(optics.reflected(sun, mirror.normal) @ normal)
    assert optics.area(spot) == pytest.approx(0.24 * abs(sun @ mirror.normal) / ahead, rel=1e-12)
    assert optics.area(spot) * expected == pytest.approx(mirror.flux(sun, 0.5), rel=1e-12)
    np.testing.assert_allclose(place.mean(axis=0), spot.mean(axis=0), atol=5e-3)

    cell = 0.05
    low = spot.min(axis=0)[[0, 2]] - 0.15
    size = np.ceil((np.ptp(spot, axis=0)[[0, 2]] + 0.3) / cell).astype(int)
    at = ((place[:, [0, 2]] - low) / cell).astype(int)
    assert ((at >= 0) & (at < size)).all()
    sums, hits = np.zeros(size), np.zeros(size)
    np.add.at(sums, tuple(at.T), weight / cell**2)
    np.add.at(hits, tuple(at.T), 1)
    x, z = np.meshgrid(*(np.arange(n) for n in size), indexing="ij")
    corners = []
    for dx, dz in ((0, 0), (0, 1), (1, 0), (1, 1)):
        on_wall = np.stack(
            [low[0] + (x + dx) * cell, np.full(x.shape, -3.0), low[1] + (z + dz) * cell], axis=-1
        )
        corners.append(mirror.share_seen(on_wall.reshape(-1, 3), sun, 0.5).reshape(x.shape))
    core, dark = np.min(corners, axis=0) == 1, np.max(corners, axis=0) == 0
    assert core.sum() > 10
    assert sums[dark].sum() == 0
    z_score = (sums[core] / expected - 1) * np.sqrt(hits[core])
    assert abs(z_score).max() < 5
    assert abs(z_score.sum()) < 5 * np.sqrt(core.sum())


def _even_disk(centre: np.ndarray, diameter: float, square: np.ndarray) -> np.ndarray:
    """Directions evenly over the solid angle of a sun from points of the unit square."""
    east = np.cross([0, 0, 1], centre)
    east /= np.linalg.norm(east)
    height = 2 * np.sin(np.radians(diameter / 4)) ** 2 * square[0]
    sine, angle = np.sqrt(height * (2 - height)), 2 * np.pi * square[1]
    flat = np.cos(angle)[:, None] * east + np.sin(angle)[:, None] * np.cross(centre, east)
    return (1 - height)[:, None] * centre + sine[:, None] * flat
