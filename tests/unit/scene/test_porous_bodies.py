"""Porous bodies outside: their gaps let straight light through, the rest of them is matt."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.model_case import listing
from drcmitsuba.case.reading import load_case
from drcmitsuba.export.primitives import twin
from drcmitsuba.model.materials import Lambertian, PorousMaterial
from drcmitsuba.model.radiance import read
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.components import place
from drcmitsuba.scene.materials import albedo, is_diffuse
from drcmitsuba.scene.sun_visibility import SunVisibility
from drcmitsuba.transport.rays.shadow_rays import straight
from tests.model_rooms import GLASS, case_of, layer, prism

POROSITY = 0.6
LEAVES = PorousMaterial(type="porous", porosity=POROSITY, reflectance=(0.1, 0.3, 0.05))
SHEET = np.array([(-9, -2, -9), (9, -2, -9), (9, -2, 9), (-9, -2, 9)], float)


@pytest.fixture(autouse=True)
def variant():
    backend.select()


def case(*more):
    """Room with a window to the south, and what stands before it."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    window = np.array([[1, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2]], float)
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("walls", Lambertian(0.5), walls[0], *walls[1:], ceiling, holes=[window]),
        layer("glass", GLASS, window),
        *more,
        sensors={"floors": ["floor"]},
    )


def before(case):
    """Share of the light from the south that reaches a point within, and one between the sheets."""
    world = scene.load(case)
    p = mi.Point3f([2, 2], [1, -2.5], [1.5, 1.5])
    start = mi.Vector3f(*(np.repeat(c, 2) for c in -world_origin(case)))
    d = mi.Vector3f(0, -1, 0)
    return straight(world, p + start, d, dr.full(mi.Bool, True, 2)).numpy()


def world_origin(case):
    from drcmitsuba.scene.geometry import origin

    return origin(case).astype(np.float32)


def test_straight_light_passes_each_surface_with_its_porosity():
    free = before(case())
    two = before(case(layer("leaves", LEAVES, SHEET, SHEET - [0, 1, 0])))
    np.testing.assert_allclose(two, free * [POROSITY**2, POROSITY], rtol=1e-5)
    opaque = before(case(layer("wall", Lambertian(0.5), SHEET, role="context")))
    np.testing.assert_array_equal(opaque, [0, 1])


def test_a_sun_behind_leaves_still_lights_the_room():
    sun = np.array([[0, -0.9, np.sqrt(1 - 0.81)]])
    masks = []
    for material in (LEAVES, Lambertian(0.0)):
        one = case(layer("screen", material, SHEET, role="context"))
        masks.append(SunVisibility.of(one, place(one)).visible(sun, 0.5).mask.item())
    assert masks == [True, False]


def test_leaves_are_context_and_receive_light():
    one = layer("leaves", LEAVES, SHEET)
    assert one.role == "context"
    assert is_diffuse(LEAVES)
    assert albedo(LEAVES) == pytest.approx(0.6 + 0.4 * 0.3)
    assert scene.is_coloured(case(one))
    line = listing(case(one).building)[-1]
    assert "porosity 0.60, diffuse, reflectance [0.1, 0.3, 0.05]" in line


def test_leaves_leave_the_exits_of_rooms_alone():
    with_leaves, without = (scene.load(case(*x)) for x in ([layer("l", LEAVES, SHEET)], []))
    assert len(with_leaves.enclosure.exits) == len(without.enclosure.exits)


def test_a_case_makes_a_layer_porous(tmp_path):
    (tmp_path / "tree.rad").write_text(
        "void plastic leaf 0 0 5 .3 .3 .3 0 0\nvoid plastic floor 0 0 5 .3 .3 .3 0 0\n"
        "floor polygon f 0 0 12 0 0 0 4 0 0 4 4 0 0 4 0\n"
        "leaf polygon t 0 0 12 0 -2 0 4 -2 0 4 -2 3 0 -2 3\n"
    )
    text = '[model]\nfiles = ["tree.rad"]\nleaks = "allow"\n[sensors]\nfloors = ["floor"]\n'
    text += '[materials.leaf]\ntype = "porous"\nporosity = 0.4\nreflectance = 0.25\n'
    (tmp_path / "case.toml").write_text(text)
    layers = {x.name: x for x in load_case(tmp_path / "case.toml").building.layers}
    leaf = layers["leaf"]
    assert leaf.material == PorousMaterial(type="porous", porosity=0.4, reflectance=0.25)
    assert leaf.role == "context"


@pytest.mark.parametrize("reflectance", [0.0, 0.5, 1.0])
def test_radiance_takes_leaves_as_trans_and_gives_them_back(tmp_path, reflectance):
    material = PorousMaterial(type="porous", porosity=0.6, reflectance=reflectance)
    written = twin("leaf", material, SHEET[None])
    assert not written.difference
    polygon = "leaf polygon t 0 0 12 0 -2 0 4 -2 0 4 -2 3 0 -2 3"
    (tmp_path / "leaf.rad").write_text(f"{written.text}\n{polygon}\n")
    (again,) = read([tmp_path / "leaf.rad"]).layers
    assert again.role == "context"
    assert again.material.porosity == pytest.approx(0.6)
    assert again.material.reflectance == pytest.approx(reflectance)


def test_coloured_leaves_are_told_to_colour_radiances_gaps():
    assert "coloured" in twin("leaf", LEAVES, SHEET[None]).difference
