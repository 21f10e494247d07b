"""Images of suns in planar mirrors, against exact geometry and Fresnel's formulas."""

import numpy as np
import pytest
from drcmitsuba_plugins.sampling import disk_solid_angle

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.glare_year.seen_ends import eye_paths
from drcmitsuba.glare_year.suns import images
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.flat_arrays import flat
from drcmitsuba.scene.geometry import Surface, quad
from drcmitsuba.scene.scene import build
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport import coefficients
from drcmitsuba.transport.mirrors.image_suns import FAINT_CHAIN, LEAST_DRAWN, ImageSuns
from drcmitsuba.transport.sun_interpolation import with_straight
from tests.radiance import glass, transmissivity

TAU = 0.9
PANE = GlazingMaterial(type="glazing", transmittance=TAU, ior=1.52)
NORTH, UP, EAST = np.eye(3)[[1, 2, 0]]
SOUTH_GLASS = quad(-100 * EAST - 100 * UP, 200 * UP, 200 * EAST)
"""A large pane at y = 0 whose front, the room's side, faces north."""
POINT = np.array([[0.0, -0.5, 0.0]])
DIAMETER = 0.5


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def glass_of(*more, material=PANE):
    made = build([Surface("pane", material, SOUTH_GLASS[None]), *more])
    return ImageSuns.of(made)


AGAIN = 512


def by_suns(images, point, normal, suns):
    """D of a point by mirrored suns, mean over `AGAIN` receivers with random numbers of their own.

    Each sample of one receiver is unrolled in the kernel.
    """
    every = (flat(np.repeat(np.reshape(x, (1, 3)), AGAIN, axis=0)) for x in (point, normal))
    D = images.suns(*every, suns=suns, diameter=DIAMETER, samples=2, seed=0)
    return D.numpy().mean(axis=0)


SUNS = np.array([[0.3, -0.7, 0.5], [0.6, -0.2, 0.9], [0.0, 0.8, 0.6], [-0.9, -0.1, 0.2]])
SUNS /= np.linalg.norm(SUNS, axis=1, keepdims=True)


def test_mirrored_suns_have_fresnels_reflectance():
    d = 2 * np.pi * (1 - np.cos(np.radians(DIAMETER / 2)))
    t = transmissivity(TAU)
    rho = np.where(SUNS[:, 1] < 0, glass(-SUNS[:, 1], t)[1], 0)
    # The mirrored suns stand north of the point, as high as the suns.
    for normal, cosine in ((NORTH, -SUNS[:, 1]), (UP, SUNS[:, 2])):
        np.testing.assert_allclose(
            by_suns(glass_of(), POINT, normal, SUNS), d * rho * cosine, rtol=5e-3, atol=1e-9
        )


def test_the_mirrored_sky_is_that_of_its_reflectance():
    D = (
        glass_of()
        .sky(flat(POINT), flat(NORTH[None]), subdivision=1, rays=1 << 16, seed=0)
        .numpy()[0]
    )
    c = (np.arange(4000) + 0.5) / 4000
    rho = glass(c, transmissivity(TAU))[1]
    assert D.sum() == pytest.approx(2 * np.pi * (rho * c).mean(), rel=2e-3)
    assert D[0] == pytest.approx(D[1:].sum(), rel=0.02)  # ground and sky share the view


def test_what_stands_before_the_pane_or_the_source_hides_it():
    screen = Surface(
        "screen", Lambertian(0.5), quad(-9 * EAST - 0.2 * NORTH, 9 * UP, 18 * EAST)[None]
    )
    wall = Surface("wall", Lambertian(0.5), quad(-9 * EAST - 5 * NORTH, 9 * UP, 18 * EAST)[None])
    for shape in (screen, wall):
        D = by_suns(glass_of(shape), POINT, NORTH, SUNS[:1])
        assert (D == 0).all()


def test_points_behind_the_pane_and_panes_without_an_index_mirror_nothing():
    inside = POINT * [1, -1, 1]
    assert (by_suns(glass_of(), inside, -NORTH, SUNS) == 0).all()
    plain = GlazingMaterial(type="glazing", transmittance=0.6, reflectance=0.2)
    assert glass_of(material=plain) is None  # its room's side mirrors where another pane lights it


MIRROR = MirrorMaterial(type="mirror", reflectance=0.8)
DIM = MirrorMaterial(type="mirror", reflectance=0.5)
OMEGA = 2 * np.pi * (1 - np.cos(np.radians(DIAMETER / 2)))


def mirror(name, material, *quads):
    """A mirror as a component: photons know it by its name."""
    return Surface(name, material, np.array(quads), name)


def images_of(*surfaces):
    return ImageSuns.of(build(list(surfaces)))


def reflected(direction, *normals):
    for n in normals:
        direction = direction - 2 * (direction @ n) * n
    return direction


def test_a_mirror_sends_its_reflectance_times_the_sun():
    wall = mirror("wall", MIRROR, SOUTH_GLASS)
    for side in (1, -1):  # both sides of a mirror reflect
        point, normal = POINT * [1, side, 1], side * NORTH
        suns = SUNS * [1, side, 1]
        D = by_suns(images_of(wall), point, normal, suns)
        cosine = np.maximum(-SUNS[:, 1], 0)
        np.testing.assert_allclose(D, 0.8 * OMEGA * cosine, rtol=5e-3, atol=1e-9)


def test_a_polished_floor_mirrors_the_share_of_the_sun_of_its_angle():
    """m + (1 − m) F: a twentieth at the zenith, a third and more of a low sun."""
    floor = MirrorMaterial(type="mirror", reflectance=0.5, specular=0.1, polished=True)
    suns = np.array([[np.sqrt(1 - c * c), 0, c] for c in (0.95, 0.5, 0.2)])
    ground = mirror("floor", floor, quad([-99, -99, 0], [198, 0, 0], [0, 198, 0]))
    D = by_suns(images_of(ground), np.array([[0, 0, 1.0]]), -UP, suns)
    more = np.exp(-5.85 * suns[:, 2]) - np.exp(-5.85)
    expected = OMEGA * suns[:, 2] * (0.05 + 0.95 * more)
    np.testing.assert_allclose(D, expected, rtol=5e-3)


def test_the_outline_of_a_mirror_cuts_the_image_of_the_sun():
    """An edge through the middle of the disk's image leaves half of it."""
    sun = np.array([[0.0, -0.8, 0.6]])
    rises = 0.6 / 0.8 * 0.5  # where the middle of the image is seen on the mirror
    for low, high, share in ((rises, 50, 0.5), (-50, rises, 0.5), (1.0, 50, 0), (0.0, 1.0, 1)):
        part = quad(-50 * EAST + low * UP, (high - low) * UP, 100 * EAST)
        D = by_suns(images_of(mirror("m", MIRROR, part)), POINT, NORTH, sun)
        want = 0.8 * OMEGA * 0.8 * share
        assert D[0] == pytest.approx(want, rel=0.04, abs=1e-12)


def test_a_single_sensor_knows_half_of_an_image_to_a_few_percent():
    """Few sensors and eyes draw many directions on each image; 576 draw one in a replicate."""
    sun = np.array([[0.0, -0.8, 0.6]])
    rises = 0.6 / 0.8 * 0.5
    part = quad(-50 * EAST + rises * UP, 50 * UP, 100 * EAST)
    scene = build([mirror("m", MIRROR, part)])
    accuracy = Accuracy().of_points(1)
    suns = Suns(("sun",), sun, DIAMETER)
    C = coefficients.compute(scene, POINT, NORTH[None], suns, accuracy).sel(bin="sun")
    share = C["replicates"].values[:, 0] / (0.8 * OMEGA * 0.8)
    assert share.mean() == pytest.approx(0.5, abs=0.01)
    assert 0 < share.std(ddof=1) / np.sqrt(len(share)) < 0.015


def test_an_adaptive_sun_has_its_images_beside_straight_light():
    """Suns of a mesh stand for what is scattered alone: those of the time stamps are mirrored."""
    sun = np.array([[0.0, -0.8, 0.6], [0.0, 0.8, 0.6], [0.6, 0.8, 0.0]])
    scene = build([mirror("m", MIRROR, SOUTH_GLASS)])
    accuracy, none = Accuracy(replicates=4), Suns((), sun[:0], DIAMETER)
    C = coefficients.compute(scene, POINT, NORTH[None], none, accuracy)
    suns = Suns(("before", "mirrored", "aside"), sun, DIAMETER)
    straight = with_straight(C, scene, POINT, NORTH[None], suns, accuracy)["sun_straight"]
    exact = coefficients.compute(scene, POINT, NORTH[None], suns, accuracy)["straight"]
    np.testing.assert_allclose(straight, exact.sel(bin=[*suns.labels]), rtol=1e-3)
    assert straight[0, 0] == pytest.approx(0.8 * OMEGA * 0.8, rel=5e-3)


def test_two_mirrors_in_turn_multiply_their_reflectances():
    """In a corner of mirrors a sun has three images, whatever the order of the mirrors."""
    corner = quad(3 * EAST - 100 * NORTH - 100 * UP, 200 * UP, 200 * NORTH)
    images = images_of(mirror("a", MIRROR, SOUTH_GLASS), mirror("b", DIM, corner))
    sun = np.array([-0.3, 0.5, 0.6]) / np.sqrt(0.7)
    both = reflected(sun, NORTH, EAST)
    for normal in (UP, EAST, -NORTH, -EAST):
        want = sum(
            rho * max(0.0, normal @ d)
            for rho, d in (
                (0.8, reflected(sun, NORTH)), (0.5, reflected(sun, EAST)), (0.4, both),
            )
        )  # fmt: skip
        D = by_suns(images, np.array([[2.0, 1.0, 0.0]]), normal, sun[None])
        assert D[0] == pytest.approx(OMEGA * want, rel=5e-3)


def test_panes_before_and_after_a_mirror_take_their_part():
    pane = GlazingMaterial(type="glazing", transmittance=0.6)
    between = quad(-90 * EAST - 0.2 * NORTH - 90 * UP, 180 * UP, 180 * EAST)
    wall = mirror("wall", MIRROR, SOUTH_GLASS)
    sun = np.array([[0.0, -1.0, 0.0]])
    D = by_suns(images_of(wall, Surface("pane", pane, between[None])), POINT, NORTH, sun)
    assert D[0] == pytest.approx(0.6 * 0.8 * 0.6 * OMEGA, rel=5e-3)


def test_a_facade_of_many_panes_is_one_rectangle():
    """Ten thousand coplanar panes with gaps between them: one plane, and gaps mirror nothing."""
    x, z = (a.ravel() for a in np.meshgrid(np.arange(100.0), np.arange(100.0)))
    start = np.stack([x - 50, 0 * x, z - 50], axis=1)
    quads = np.array([quad(s, 0.9 * UP, 0.9 * EAST) for s in start])
    images = images_of(Surface("panes", PANE, quads))
    assert [len(seen) for seen in images.mirrors.rectangles] == [2]
    assert images.mirrors.left_out == 0
    sun = np.array([[0.0, -0.8, 0.6]])
    rho = glass(np.array([0.8]), transmissivity(TAU))[1][0]
    on_pane, on_gap = (np.array([[u, -0.5, 0.0]]) for u in (0.45, 0.95))
    assert by_suns(images, on_pane, NORTH, sun)[0] == pytest.approx(rho * OMEGA * 0.8, rel=5e-3)
    assert by_suns(images, on_gap, NORTH, sun)[0] == 0


def test_panes_of_many_tilts_are_bounded_and_told():
    angles = np.radians(np.linspace(0, 60, 300))
    quads = [
        quad(5 * k * EAST, UP, np.cos(a) * EAST + np.sin(a) * NORTH) for k, a in enumerate(angles)
    ]
    mirrors = images_of(Surface("panes", PANE, np.array(quads))).mirrors
    assert len(mirrors.axes) == 12
    assert mirrors.left_out == 288


def test_mirrors_that_face_each_other_at_no_distance_hide_each_other():
    two = SOUTH_GLASS - 1e-7 * NORTH
    images = images_of(mirror("a", MIRROR, SOUTH_GLASS), mirror("b", DIM, two))
    D = by_suns(images, POINT, NORTH, SUNS[:1])
    assert np.isfinite(D).all()
    lit = D[0] / (OMEGA * -SUNS[0, 1])
    assert min(abs(lit - 0.8), abs(lit - 0.5)) < 5e-3


def test_photons_leave_out_what_images_count():
    """A single mirror needs no photons; one before a rough mirror keeps those of further chains."""
    from drcmitsuba.scene.geometry import Port, reversed_quads
    from drcmitsuba.transport.photons.ports import ComponentPorts

    port = reversed_quads(SOUTH_GLASS[None])[0]
    alone = build([mirror("m", MIRROR, SOUTH_GLASS)], ports=(Port("m", port),))
    assert ComponentPorts.of(alone) == ()
    rough = MirrorMaterial(type="mirror", reflectance=0.5, roughness=0.2)
    other = quad(-9 * EAST - 5 * NORTH, 9 * UP, 18 * EAST)
    both = build(
        [mirror("m", MIRROR, SOUTH_GLASS), mirror("r", rough, other)], ports=(Port("m", port),)
    )
    assert [ports.name for ports in ComponentPorts.of(both)] == ["m"]


@pytest.mark.parametrize("aside", [-0.5, 0.0, 0.5])
def test_an_edge_behind_a_pane_cuts_the_disk_where_it_stands(aside):
    """Visible share of a disk that a level edge crosses, `aside` radii from its middle.

    The eye looks up through a pane at 60°, past the edge, into a mirror in the north.
    """
    image = np.array([0.0, np.cos(np.pi / 3), np.sin(np.pi / 3)])
    angle = np.pi / 3 + aside * np.radians(DIAMETER / 2)
    edge = 1.02 * NORTH + 1.02 * np.tan(angle) * UP
    screen = quad(edge - 5 * EAST - 5 * UP, 10 * EAST, 5 * UP)
    wall = quad(10 * NORTH - 100 * EAST - 100 * UP, 200 * EAST, 200 * UP)
    pane = quad(NORTH - 9 * EAST - 9 * UP, 18 * EAST, 18 * UP)
    clear = GlazingMaterial(type="glazing", transmittance=TAU)
    scene = build(
        [
            Surface("pane", clear, pane[None]), Surface("screen", Lambertian(0.0), screen[None]),
            mirror("mirror", MIRROR, wall),
        ]
    )  # fmt: skip
    sun = (image * [1, -1, 1])[None]
    place = np.zeros(3)
    seen = images(eye_paths(scene, DIAMETER), place, np.zeros(0, int), sun, DIAMETER, 0)
    mirrored = seen.solid_angle[seen.direction[:, 1] > 0]
    share = mirrored.sum() / disk_solid_angle(DIAMETER)
    right = (np.arccos(aside) - aside * np.sqrt(1 - aside**2)) / np.pi
    assert share == pytest.approx(right, abs=5e-3)


def test_of_a_faint_mirror_a_share_of_the_directions_to_suns_is_drawn():
    """One of eight receivers draws a direction, which counts eight times."""
    faint = glass_of(material=GlazingMaterial(type="glazing", transmittance=TAU, ior=1.1))
    assert faint.mirrors.strongest[0] < FAINT_CHAIN * LEAST_DRAWN
    receivers = 1 << 14
    every = (flat(np.repeat(np.reshape(x, (1, 3)), receivers, axis=0)) for x in (POINT, NORTH))
    points, normals = every
    few, many = (
        faint.suns(points, normals, suns=SUNS, diameter=DIAMETER, samples=n, seed=0).numpy()
        for n in (0, 8)
    )
    drawn = (few[:, 0] > 0).mean()
    assert drawn == pytest.approx(LEAST_DRAWN, abs=4 * np.sqrt(LEAST_DRAWN / receivers))
    lit = many[0] > 0
    assert lit.sum() == 3  # the third sun stands behind the pane
    for sun in np.flatnonzero(lit):
        D = few[few[:, sun] > 0, sun]
        np.testing.assert_allclose(D, many[:, sun].mean() / LEAST_DRAWN, rtol=0.05)
        error = many[:, sun].mean() * np.sqrt((1 / LEAST_DRAWN - 1) / receivers)
        assert abs(few[:, sun].mean() - many[:, sun].mean()) < 4 * error
    both = (few[:, 0] > 0) & (few[:, 1] > 0)
    assert both.mean() == pytest.approx(LEAST_DRAWN**2, rel=0.3)  # each sun for itself
