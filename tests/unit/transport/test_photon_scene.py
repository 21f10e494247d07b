"""Clear panes of components in closed form: photons bring what they bring by a search for panes."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import GlazingMaterial, Lambertian, MirrorMaterial
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Port, Surface
from drcmitsuba.transport.mirrors import planar_mirrors
from drcmitsuba.transport.photons.surfaces import PhotonScene
from drcmitsuba.transport.photons.tracer import PhotonTracer


@pytest.fixture(autouse=True)
def _mirrors_are_left_to_photons(monkeypatch):
    """Take plain mirrors for bodies of many faces, which have no exact images."""
    monkeypatch.setattr(planar_mirrors, "MOST_OF_BODY", 0)


SUN = np.array([[0.0, 1.0, 0.0], [0.2, 0.96, 0.2]])
SUN /= np.linalg.norm(SUN, axis=1, keepdims=True)


def flat(z, half):
    """Square in the plane z, its front up."""
    corners = [[-half, -half], [half, -half], [half, half], [-half, half]]
    return np.array([[[x, y, z] for x, y in corners]])


MIRROR = np.array([[[-0.5, -0.5, 1.5], [0.5, -0.5, 1.5], [0.5, 0.5, 2.5], [-0.5, 0.5, 2.5]]])
"""Mirror at 45° that sends light from +y down."""
CORNERS = [[-0.6, 0.6, 1.4], [0.6, 0.6, 1.4], [0.6, 0.6, 2.6], [-0.6, 0.6, 2.6]]
PORT = Port("mirror", np.array(CORNERS))


def glass(reflectance=0.0):
    return GlazingMaterial(type="glazing", transmittance=0.8, reflectance=reflectance)


def built(panes, material=None, component="mirror"):
    """A mirror over panes (pane, 4, 3) and a floor."""
    silver = MirrorMaterial(type="mirror", reflectance=0.9)
    surfaces = [
        Surface("mirror", silver, MIRROR, "mirror"),
        Surface("floor", Lambertian(0.5), flat(-1.0, 9.0)),
        Surface("glass", material or glass(), panes, component),
    ]
    return scenes.build(surfaces, ports=(PORT,))


PANES = np.concatenate([flat(0.5, 2.0), flat(0.0, 2.0)])
POINTS = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.25], [0.0, 0.0, -0.5]])
"""Sensors above, between and under both panes."""


def landed(scene, **changes):
    accuracy = Accuracy(photons=1 << 14, cell_size=0.5, sensor_square=0.2, **changes)
    up = np.tile([0.0, 0.0, 1.0], (len(POINTS), 1))
    return PhotonTracer.of(scene, POINTS, up, SUN, 0.5, 1, accuracy).traced(3)


@pytest.fixture
def searched(monkeypatch):
    """Have photons search for every pane."""

    def use():
        def of(scene):
            return PhotonScene(scene.full, scene.met_faces, None)

        monkeypatch.setattr(PhotonScene, "of", of)

    return use


def test_photons_bring_the_same_as_by_a_search(searched):
    scene = built(PANES)
    assert PhotonScene.of(scene).panes is not None
    closed = landed(scene)
    searched()
    one_by_one = landed(scene)
    for part in (lambda one: one.cells, lambda one: one.sensors(), lambda one: one.mirrored()):
        for a, b in zip(part(closed), part(one_by_one), strict=True):
            # Rounding moves a photon in some 10,000 across the edge of a cell or a square.
            assert abs(a.numpy() - b.numpy()).sum() < 1e-3 * b.numpy().sum()
            np.testing.assert_allclose(a.numpy().sum(axis=0), b.numpy().sum(axis=0), rtol=1e-3)
    for name, book in closed.ledgers.items():
        other = one_by_one.ledgers[name]
        assert book.segments < other.segments
        for fate in ("emitted", "landed", "absorbed", "escaped", "others"):
            assert getattr(book, fate) == pytest.approx(getattr(other, fate), rel=1e-5), fate


@pytest.mark.slow
def test_a_square_gets_the_light_that_has_come_to_its_height():
    through = landed(built(PANES)).sensors().sun.numpy()
    free = landed(built(flat(-5.0, 0.1))).sensors().sun.numpy()
    assert (free[:, 0] > 0).all()
    np.testing.assert_allclose(through[:, 0] / free[:, 0], [1, 0.8, 0.64], rtol=2e-3)


def test_flux_that_escapes_has_passed_the_panes():
    """The panes stand on the way out: half of a photon's flux, say, may not vanish."""
    aside = np.array([[[-3, -3, 1.0], [3, -3, 1.0], [3, -3, 4.0], [-3, -3, 4.0]]], float)
    ledgers = landed(built(aside)).ledgers
    assert ledgers
    for book in ledgers.values():
        out = book.landed + book.absorbed + book.escaped + book.others + book.lost
        assert out == pytest.approx(book.emitted + book.roulette, rel=1e-5)
        assert book.escaped > 0


@pytest.mark.parametrize(
    ("panes", "material", "component"),
    [
        (PANES, glass(0.1), "mirror"),
        (PANES, None, ""),
        (np.concatenate([flat(z, 2.0) for z in np.arange(0.0, 1.0, 0.1)]), None, "mirror"),
    ],
    ids=["mirrors too", "of the room", "too many"],
)
def test_other_panes_are_searched(panes, material, component):
    scene = built(panes, material, component)
    of_photons = PhotonScene.of(scene)
    assert of_photons.panes is None
    assert of_photons.surfaces is scene.full
