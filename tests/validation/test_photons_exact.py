"""Photons against exact optics: a mirrored duct, the image of the sun, slabs, total reflection.

Rationale: what components send into a room is found by nothing but photons, so their estimate has
to be right by itself, before any room is around it.

Method: independent replicates against the answers of `unfolded_duct` and `exact_optics`, which
share no code with the package and have tests of their own.
Light that no surface deviates is not the photons' own: the ledger has it under `others`.

Expected: agreement within five standard errors and what rays are off by, see OFFSET; both together
are a small part of the 0.5 % asked for.
"""

from __future__ import annotations

from functools import reduce

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import DielectricMaterial, Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.geometry import Port, Surface
from drcmitsuba.transport.mirrors import planar_mirrors
from drcmitsuba.transport.photons.light import FluxLedger, Landed
from drcmitsuba.transport.photons.tracer import PhotonTracer
from tests.fast import slowly
from tests.validation import exact_optics as optics
from tests.validation import lamella_room as room
from tests.validation import unfolded_duct as duct
from tests.validation.lamella_room import rectangle

REPLICATES = 6
BLACK = Lambertian(0.0)
NOWHERE = np.array([[0.0, 0.0, -90.0]]), np.array([[0.0, 0.0, 1.0]])


@pytest.fixture(autouse=True)
def _mirrors_are_left_to_photons(monkeypatch):
    """Take plain mirrors for bodies of many faces, which have no exact images."""
    monkeypatch.setattr(planar_mirrors, "MOST_OF_BODY", 0)


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def landed(
    surfaces: list[Surface], ports: tuple[Port, ...], suns: np.ndarray, diameter: float, *,
    sensors: tuple[np.ndarray, np.ndarray] = NOWHERE, subdivision: int | None = None,
    photons: int = 1 << 15, **accuracy: float,
) -> list[Landed]:  # fmt: skip
    """Replicates of what photons bring."""
    settings = Accuracy(photons=photons, cell_size=1.0, photon_surfaces=10_000, **accuracy)
    directions = np.reshape(suns, (-1, 3))
    traced = PhotonTracer.of(
        scene.build(surfaces, ports=ports), *sensors, directions, diameter, subdivision, settings
    )
    assert traced is not None
    return [traced.traced(seed) for seed in range(REPLICATES)]


def shares(replicates: list[Landed], *fates: str) -> np.ndarray:
    """Shares of the emitted flux, shape (replicate, fate)."""
    for replicate in replicates:
        conserved(replicate)
    books = [whole(f) for f in replicates]
    return np.array([[getattr(book, n) / book.emitted for n in fates] for book in books])


def whole(replicate: Landed) -> FluxLedger:
    """The sum of a replicate's ledgers."""
    return reduce(FluxLedger.plus, replicate.ledgers.values(), FluxLedger())


def conserved(replicate: Landed) -> None:
    """Flux in = flux deposited + absorbed + escaped."""
    book = whole(replicate)
    out = book.landed + book.absorbed + book.escaped + book.others + book.lost
    assert book.emitted + book.roulette == pytest.approx(out, rel=1e-5)
    assert abs(book.roulette) < 5e-3 * book.emitted
    assert book.lost < 1e-4 * book.emitted


OFFSET = 2e-4
"""Share by which rays change for starting off the surface that they leave.

Mitsuba sets them off by 0.2 mm and more, some 5e-4 of the duct's width, so they meet the next
mirror too early by as much; of n mirrors of reflectance ρ the flux takes no notice but of some
n (1 − ρ) of that.
"""


def agree(replicates: np.ndarray, exact: np.ndarray | float, offset: float = OFFSET) -> None:
    """Assert that the means of replicates (axis 0) are the exact values, to 0.5 % at the very most.

    Parameters
    ----------
    replicates : np.ndarray
        Shares of what is there, around 1 or less.
    exact : np.ndarray or float
    offset : float
        What rays are off by.
    """
    values = np.asarray(replicates, float).reshape(len(replicates), -1)
    error = 5 * values.std(axis=0, ddof=1) / np.sqrt(len(values)) + offset
    off = values.mean(axis=0) - exact
    print(f"off by {off}, may be {error}")
    assert error.max() < 0.005
    assert (abs(off) < error).all(), f"{values.mean(axis=0)}, expected {exact}"


WIDTH = 0.5


def pipe(aspect: float, reflectance: float) -> tuple[list[Surface], tuple[Port, ...]]:
    """A square duct from y = 0 northward, with a black box behind it."""
    mirror = MirrorMaterial(type="mirror", reflectance=reflectance)
    w, length = WIDTH, aspect * WIDTH
    walls = [
        rectangle((0, 0, 0), (w, 0, 0), (0, length, 0)),
        rectangle((0, 0, w), (0, length, 0), (w, 0, 0)),
        rectangle((0, 0, 0), (0, length, 0), (0, 0, w)),
        rectangle((w, 0, 0), (0, 0, w), (0, length, 0)),
    ]
    low, size = (-0.5, length, -0.5), 1.5
    box = [
        rectangle(low, (size, 0, 0), (0, 1, 0)),
        rectangle((-0.5, length, 1), (0, 1, 0), (size, 0, 0)),
        rectangle(low, (0, 1, 0), (0, 0, size)),
        rectangle((1, length, -0.5), (0, 0, size), (0, 1, 0)),
        rectangle((-0.5, length + 1, -0.5), (size, 0, 0), (0, 0, size)),
    ]
    surfaces = [
        Surface("duct", mirror, np.array(walls), "duct"),
        Surface("box", BLACK, np.array(box)),
    ]
    return surfaces, (Port("duct", rectangle((0, 0, 0), (0, 0, w), (w, 0, 0))),)


def inward(direction: tuple[float, float, float]) -> np.ndarray:
    """From the frame of the exact duct, whose axis is z, to this one's."""
    x, y, z = np.array(direction) / np.linalg.norm(direction)
    return np.array([x, z, y])


DUCTS = [(0.9, 1.0), (0.95, 2.5), (0.99, 8.0)]
BEAMS = [(0.4, -0.75, 1.0), (-1.3, 0.2, 1.0)]


@pytest.mark.parametrize(("reflectance", "aspect"), DUCTS)
def test_duct_and_the_sun(reflectance, aspect):
    """Transmitted flux of suns, and of it what came straight."""
    for beam in BEAMS:
        replicates = landed(*pipe(aspect, reflectance), -inward(beam), 0.5)
        d = duct.on_disk(np.array(beam), 0.5, 20_000)
        missed = np.maximum(1 - aspect * abs(d[:, :2] / d[:, 2:]), 0).prod(axis=1)
        straight = float(np.average(missed, weights=d[:, 2]))
        through = duct.disk(np.array(beam), 0.5, aspect, reflectance)
        parts = shares(replicates, "landed", "others", "absorbed")
        exact = np.array([through - straight, straight, 1 - through])
        agree(parts, exact)


@pytest.mark.parametrize(
    ("reflectance", "aspect"),
    [DUCTS[0], *(pytest.param(*duct, marks=pytest.mark.slow) for duct in DUCTS[1:])],
)
def test_duct_and_an_even_sky(reflectance, aspect):
    no_suns = np.zeros((0, 3))
    replicates = landed(*pipe(aspect, reflectance), no_suns, 0.5, subdivision=1, photons=2048)
    emitted = np.array([whole(f).emitted for f in replicates])
    agree(emitted / np.pi / WIDTH**2, 1.0)
    through = duct.diffuse(aspect, reflectance)
    both = shares(replicates, "landed", "others").sum(axis=1)
    agree(both, through)


def test_where_light_leaves_the_duct():
    """Irradiance on 4 × 4 fields of the exit, without what came straight."""
    aspect, reflectance, beam, n = 2.5, 0.9, (0.31, -0.17, 1.0), 4
    surfaces, ports = pipe(aspect, reflectance)
    x = (np.arange(n) + 0.5) * WIDTH / n
    flat = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    points = np.column_stack([flat[:, 0], np.full(n * n, aspect * WIDTH - 1e-3), flat[:, 1]])
    facing = np.tile([0.0, -1.0, 0.0], (n * n, 1))
    replicates = landed(
        surfaces,
        ports,
        -inward(beam),
        0.01,
        sensors=(points, facing),
        sensor_square=1.0,
        photons=1 << 17,
    )
    there = aspect - 1e-3 / WIDTH
    cells = sum(duct.exit_cells(beam, there, reflectance, n).values())
    unmirrored = duct.exit_cells(beam, there, 0.0, n)  # black walls leave the straight light
    exact = (cells - sum(unmirrored.values())).ravel()
    entering = optics.seen(inward(beam), np.array([0.0, 1, 0]), 0.01)
    for part in ("sensors", "mirrored"):
        shift = 2.5e-4 / (WIDTH / n)  # the edges of the parts of the beam, against a field
        brightest = entering * exact.max()
        agree(
            [getattr(f, part)().sun.numpy()[:, 0] / brightest for f in replicates],
            exact / exact.max(),
            shift,
        )


@pytest.mark.parametrize("turn", [40.0, 70.0])
def test_mirror_images_the_sun(turn):
    """Flux on the wall, irradiance in the core of the image, and none beyond its penumbra."""
    up = np.array([0, np.cos(np.radians(turn)), np.sin(np.radians(turn))])
    corner = np.array([-0.2, 0, 2]) - 0.3 * up
    mirror = optics.Mirror(rectangle(corner, (0.4, 0, 0), 0.6 * up), 0.85)
    sun = -np.array([0.15, -0.5, 0.8]) / np.linalg.norm([0.15, -0.5, 0.8])
    point, normal = np.array([0.0, -3, 0]), np.array([0.0, 1, 0])
    spot = mirror.spot(sun, point, normal)
    low, high = spot.min(axis=0) - 0.5, spot.max(axis=0) + 0.5
    wall = rectangle((high[0], -3, low[2]), (low[0] - high[0], 0, 0), (0, 0, high[2] - low[2]))
    material = MirrorMaterial(type="mirror", reflectance=0.85)
    surfaces = [
        Surface("mirror", material, mirror.quad[None], "mirror"), Surface("wall", BLACK, wall[None])
    ]  # fmt: skip
    edge = 1.02 * (mirror.quad - mirror.quad.mean(axis=0))
    before = mirror.quad.mean(axis=0) + edge + 1e-3 * mirror.normal
    ports = (Port("mirror", before[::-1]),)

    size = 0.1
    grid = np.stack(np.meshgrid(np.arange(-6, 7), np.arange(-6, 7)), axis=-1).reshape(-1, 2) * size
    centre = spot.mean(axis=0)
    points = np.column_stack(
        [centre[0] + grid[:, 0], np.full(len(grid), -3 + 1e-3), centre[2] + grid[:, 1]]
    )
    half = 0.51 * size
    seen = [
        mirror.share_seen(points + [dx, 0, dz], sun, 0.5)
        for dx in (-half, half) for dz in (-half, half)
    ]  # fmt: skip
    core, dark = np.min(seen, axis=0) == 1, np.max(seen, axis=0) == 0
    middle = abs(grid).max(axis=1) < size
    assert core[middle].all()
    normals = np.tile(normal, (len(points), 1))
    replicates = landed(surfaces, ports, -sun, 0.5, sensors=(points, normals), sensor_square=size)
    agree([whole(f).landed / mirror.flux(sun, 0.5) for f in replicates], 1.0)
    lit = np.array([f.mirrored().sun.numpy()[:, 0] for f in replicates])
    agree(lit[:, core].mean(axis=1) / mirror.irradiance(sun, normal, 0.5), 1.0)
    # A field counts as dark where none of its corners sees the sun and it is not around the image.
    far = abs(grid).max(axis=1) > 5 * size
    assert (dark & far).any()
    assert lit[:, dark & far].max() == 0


def block(section: np.ndarray, material: DielectricMaterial, length: float = 1.0) -> Surface:
    """A prism along x with a section (corner, 2) in y and z, anticlockwise seen from the east."""
    west, east = (np.column_stack([np.full(len(section), x), section]) for x in (0.0, length))
    sides = [
        np.array([west[i], east[i], east[j], west[j]])[::-1]
        for i, j in zip(range(len(section)), np.roll(range(len(section)), -1), strict=True)
    ]
    ends = [end if len(end) == 4 else np.vstack([end, end[-1:]]) for end in (west[::-1], east)]
    if len(section) == 3:
        ends[0] = np.vstack([west[::-1], west[:1]])
    return Surface("solid", material, np.array([*sides, *ends]), "solid")


def outward(surface: Surface) -> bool:
    """Whether all normals of a convex body point away from its middle."""
    middle = surface.quads.reshape(-1, 3).mean(axis=0)
    n = np.cross(
        surface.quads[:, 1] - surface.quads[:, 0], surface.quads[:, 2] - surface.quads[:, 0]
    )
    return bool(((surface.quads.mean(axis=1) - middle) * n).sum(axis=1).min() > 0)


@pytest.mark.parametrize("absorption", slowly([0.0, 12.0], 0.0))
def test_slab(absorption):
    """A slab 2 cm thick: Fresnel's shares, with all inter-reflections."""
    glass = DielectricMaterial(type="dielectric", ior=1.52, absorption=absorption)
    section = np.array([[0, -3.0], [0.02, -3], [0.02, 3], [0, 3]])
    solid = block(section, glass)
    assert outward(solid)
    wall = rectangle((-20, 1, -20), (40, 0, 0), (0, 0, 40))
    surfaces = [solid, Surface("wall", BLACK, wall[None])]
    ports = (Port("solid", rectangle((0.45, -1e-3, -0.05), (0, 0, 0.1), (0.1, 0, 0))),)
    for degrees in (0.0, 45.0, 75.0):
        a = np.radians(degrees)
        sun = -np.array([0.0, np.cos(a), -np.sin(a)])
        replicates = landed(surfaces, ports, sun, 0.5, photons=1 << 17)
        exact = optics.slab(np.cos(a), 1.52, 0.02, absorption)
        parts = shares(replicates, "landed", "escaped", "absorbed")[:, : 3 if absorption else 2]
        expected = [exact.transmitted, exact.reflected, exact.absorbed][: parts.shape[1]]
        agree(parts, np.array(expected))


def right_angle(leg: float, absorption: float) -> Surface:
    """Legs along y and z from the origin."""
    glass = DielectricMaterial(type="dielectric", ior=1.5, absorption=absorption)
    return block(np.array([[0.0, 0.0], [leg, 0.0], [0.0, leg]]), glass)


@pytest.mark.parametrize("absorption", [0.0, 3.0])
def test_total_reflection_to_the_side(absorption):
    """In by one leg, out by the other: only the two faces take their share."""
    leg = 0.1
    solid = right_angle(leg, absorption)
    assert outward(solid)
    floor = rectangle((-2, -2, -1), (5, 0, 0), (0, 5, 0))
    surfaces = [solid, Surface("floor", BLACK, floor[None])]
    ports = (Port("solid", rectangle((0.3, -1e-3, 0.02), (0, 0, 0.06), (0.4, 0, 0))),)
    replicates = landed(surfaces, ports, np.array([0.0, -1, 0]), 0.01)
    exact = optics.side_prism(1.5, leg, absorption)
    parts = shares(replicates, "landed", "escaped")
    agree(parts, np.array([exact.transmitted, exact.reflected]))


@pytest.mark.parametrize("absorption", [0.0, 3.0])
def test_total_reflection_back(absorption):
    """In by the hypotenuse and out of it again; behind the legs it stays dark."""
    leg = 0.1
    solid = right_angle(leg, absorption)
    below = rectangle((-2, -2, -1), (5, 0, 0), (0, 5, 0))
    behind = rectangle((-2, -1, -2), (0, 0, 5), (5, 0, 0))
    surfaces = [solid, Surface("dark", BLACK, np.array([below, behind]))]
    d = np.array([0, 1.0, 1.0]) / 2**0.5
    across = np.array([0, 1.0, -1.0]) / 2**0.5
    corner = np.array([0.3, leg / 2, leg / 2]) + 1e-3 * d - 0.05 * across
    ports = (Port("solid", rectangle(corner, 0.1 * across, (0.4, 0, 0))),)
    replicates = landed(surfaces, ports, d, 0.01)
    exact = optics.roof_prism(1.5, 2**0.5 * leg, absorption)
    assert shares(replicates, "landed").max() == 0
    agree(shares(replicates, "escaped"), exact.reflected)


def lamellae(diameter: float = 0.5, **accuracy: float) -> list[Landed]:
    surfaces = [*room.shell(), room.casing(), room.pane(), room.lamellae(bend=40, pieces=4)]
    return landed(
        surfaces, (room.port(),), room.suns(8), diameter, sensors=room.sensors(4), subdivision=1,
        photons=1024, **accuracy,
    )  # fmt: skip


def test_ledger_of_lamellae():
    """Suns, sky and ground: flux in = flux deposited + absorbed + escaped."""
    for replicate in lamellae():
        conserved(replicate)
        assert whole(replicate).landed > 0.1 * whole(replicate).emitted
