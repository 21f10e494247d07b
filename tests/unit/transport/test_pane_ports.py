"""Panes start photons only where these may count: what scatters meets a mirror, a film, a solid."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.model.materials import (
    BsdfMaterial,
    DiffuserMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.geometry import Port, Surface, reversed_quads
from drcmitsuba.transport.photons import ports
from drcmitsuba.transport.photons.pane_ports import pane_ports, pane_sides
from drcmitsuba.transport.photons.tracer import PhotonTracer
from tests import ROOT

FILM = BsdfMaterial(type="bsdf", file=ROOT / "scenes" / "films" / "prism.xml")
GLASS = GlazingMaterial(type="glazing", transmittance=0.7)
SHINY = GlazingMaterial(type="glazing", transmittance=0.7, reflectance=0.1)
MIRROR, BLACK = MirrorMaterial(type="mirror", reflectance=0.9), Lambertian(0.0)


def shade(reflectance=0.0):
    return DiffuserMaterial(type="diffuser", transmittance=0.3, reflectance=reflectance)


def upright(y, x=0.0, width=1.0, towards=1):
    """Square in the plane y, its front to larger y, or to smaller ones with −1."""
    low, z, along = np.array([x, y, 0.0]), np.array([0, 0, 1.0]), np.array([width, 0, 0])
    quads = np.array([[low, low + z, low + z + along, low + along]])
    return quads if towards > 0 else reversed_quads(quads)


def built(*surfaces):
    """Scene of surfaces (material, quads), or (material, quads, component)."""
    made = [Surface(f"s{i}", m, quads, *of) for i, (m, quads, *of) in enumerate(surfaces)]
    component = Port("mirror", upright(-3.0)[0])
    return scenes.build(made, ports=(component,))


CLOSED = (shade(), upright(0.0))
LATER = (shade(), upright(2.0, x=1.5, towards=-1))


@pytest.mark.parametrize(
    ("besides", "count"),
    [
        ([], 0),
        ([(BLACK, upright(1.0)), (GLASS, upright(1.5)), (GLASS, upright(0.0, 5.0))], 0),
        ([(MIRROR, upright(0.0, 2.0), "mirror")], 0),
        ([(MIRROR, upright(1.0), "mirror")], 1),
        ([(MIRROR, upright(-1.0), "mirror")], 1),
        ([(shade(), upright(1.0), "mirror")], 1),
        ([(FILM, upright(1.0))], 1),
        ([(SHINY, upright(1.0))], 1),
        ([LATER], 0),
    ],
    ids=["none", "straight", "in plane", "before", "behind", "part", "film", "glass", "shade"],
)
def test_shades_have_ports_where_something_stands_before_them(besides, count):
    scene = built(CLOSED, *besides)
    own = [upright(0.0)[0], upright(0.0, towards=-1)[0]]
    assert sum((quad == mine).all() for _, quad, _ in pane_sides(scene) for mine in own) == 2
    starts = sum((port.quad == mine).all() for port in pane_ports(scene) for mine in own)
    # What stands before one side is seen by light that goes to this side, for want of reflection.
    assert starts == count


def test_a_shade_that_reflects_to_the_room_sends_light_there_from_both_sides():
    """Its back reflects nothing: what lies behind it gets the light of the room alone."""
    for y, count in ((1.0, 2), (-1.0, 1)):
        scene = built((shade(0.2), upright(0.0)), (MIRROR, upright(y), "mirror"))
        assert len(pane_ports(scene)) == count


def test_shades_in_turn():
    """Nothing but a second shade stands before the first, and a mirror before the second alone."""
    mirror = (MIRROR, upright(3.0), "mirror")
    turned = (shade(), np.array([[[2, 1, 0], [2, 1, 1], [2, 2, 1], [2, 2, 0]]], float))
    scene = built(CLOSED, turned)
    assert pane_ports(scene) == []
    aside = (MIRROR, upright(1.0, x=4.0) - [0, 3.0, 0], "mirror")  # behind the first's plane
    scene = built(CLOSED, turned, aside)
    assert len(pane_ports(scene)) == 4  # each to its mirror, or to the other
    assert len(pane_ports(built(CLOSED, turned, mirror))) >= 2


def test_films_and_glass_that_mirrors():
    assert pane_ports(built((SHINY, upright(0.0)))) == []  # suns have images in it
    assert len(pane_ports(built((SHINY, upright(0.0)), (FILM, upright(1.0))))) == 3
    # Beside one another they send no light to each other.
    assert pane_ports(built((FILM, upright(0.0)), (FILM, upright(0.0, 2.0)))) == []
    assert len(pane_ports(built((FILM, upright(0.0)), (FILM, upright(1.0, 2.0))))) == 4


@pytest.mark.parametrize("before", [False, True])
def test_photons_of_ports_left_out_count_nowhere(monkeypatch, before):
    def every(scene, *, imaged=False):
        return [Port("", quad) for _, quad, _ in pane_sides(scene, imaged=imaged)]

    floor = (
        Lambertian(0.5),
        np.array([[[-9, -9, -1], [9, -9, -1], [9, 9, -1], [-9, 9, -1]]], float),
    )
    mirror = (MIRROR, upright(0.8 if before else 0.0, x=0.0 if before else 1.5), "mirror")
    scene = built(CLOSED, mirror, floor)
    counted = [port.component for port in pane_ports(scene)]
    monkeypatch.setattr(ports, "pane_ports", every)
    points = np.array([[0.0, 5.0, 0.0]])
    tracer = PhotonTracer.of(
        scene, points, np.array([[0, 0, 1.0]]), np.array([[0, -0.8, 0.6]]), 0.5, 1,
        Accuracy(photons=1 << 10),
    )  # fmt: skip
    ledger = tracer.traced(1).ledgers[" sky"]
    assert ledger.emitted > 0
    assert (ledger.landed > 0) == before == bool(counted)
