"""Rooms that no daylight enters are told before anything is simulated; they were zeros."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian, MirrorMaterial
from drcmitsuba.model.model import SensorGrid
from drcmitsuba.plan import notes
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.daylit import darkness_notes, refuse_darkness
from tests.model_rooms import GLASS, case_of, house, l_room, layer, prism

WINDOW = np.array([[0.5, 0, 0.9], [3.5, 0, 0.9], [3.5, 0, 2.5], [0.5, 0, 2.5]])
SECOND = WINDOW * [0.2, 0, 1] + [0.2, 5, 0]


@pytest.fixture(autouse=True, scope="module")
def _backend():
    backend.select()


def room(*panes, south=(), north=(), **tables):
    """Room of 4 m by 5 m by 3 m with holes in its southern and its northern wall."""
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    layers = [
        layer("floor", Lambertian(0.2), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("south", Lambertian(0.5), walls[0], holes=south),
        layer("north", Lambertian(0.5), walls[2], holes=north),
        layer("walls", Lambertian(0.5), walls[1], walls[3]),
    ]
    layers += [layer("glass", GLASS, *panes)] if panes else []
    return case_of(*layers, **{"sensors": {"floors": ["floor"]}, **tables})


@pytest.mark.parametrize("off", [0.0, 0.005, -0.005])
def test_a_pane_on_a_wall_without_a_hole_is_refused(off):
    with pytest.raises(InputError, match=r"glass 0: drawn on a surface without a hole.*cut the ho"):
        refuse_darkness(room(WINDOW + [0, off, 0]))


def test_polished_walls_are_looked_at_as_others_are():
    case = room(WINDOW)
    polished = layer("shelf", Lambertian(0.5, polish=0.03), WINDOW + [0, 1, 0])
    assert polished.deviates
    case._building = replace(case.building, layers=(*case.building.layers, polished))
    with pytest.raises(InputError, match="drawn on a surface without a hole"):
        refuse_darkness(case)


def test_one_of_two_panes_without_a_hole_is_noted():
    case = room(WINDOW, SECOND, south=[WINDOW])
    refuse_darkness(case)
    [note] = darkness_notes(case)
    assert note == "model: panes drawn on a surface without a hole let no light through: glass 1."
    assert note in notes(case)


def test_panes_larger_than_their_holes_and_shutters_behind_them_are_fine():
    hole = np.array([[0.7, 0, 1.0], [3.3, 0, 1.0], [3.3, 0, 2.4], [0.7, 0, 2.4]])
    case = room(WINDOW, south=[hole])
    refuse_darkness(case)
    assert darkness_notes(case) == []


def test_a_room_without_an_opening_is_refused_alone_and_noted_beside_others():
    with pytest.raises(InputError, match="no pane and no opening lets daylight into the rooms"):
        refuse_darkness(room())
    case = room(WINDOW, south=[WINDOW], sensors={"grids": ["*"]})
    floor, ceiling, walls = prism([(10, 0), (14, 0), (14, 5), (10, 5)], 3.0)
    cellar = layer("cellar", Lambertian(0.5), floor, ceiling, *walls)
    up = np.array([[0.0, 0.0, 1.0]])
    grids = (
        SensorGrid("office", np.array([[2, 2, 0.8]]), up),
        SensorGrid("archive", np.array([[12, 2, 0.8]]), up),
    )
    case._building = replace(case.building, layers=(*case.building.layers, cellar), grids=grids)
    refuse_darkness(case)
    [note] = darkness_notes(case)
    assert note == "sensors: no pane or opening lets daylight into the rooms of the grids: archive."


def test_rooms_with_openings_and_with_mirrors_are_not_dark():
    for case in (house(), l_room(), room(WINDOW, south=[WINDOW])):
        refuse_darkness(case)
        assert darkness_notes(case) == []
    duct = room()
    mirror = layer("duct", MirrorMaterial(type="mirror", reflectance=0.9), WINDOW + [0, 1, 0])
    duct._building = replace(duct.building, layers=(*duct.building.layers, mirror))
    refuse_darkness(duct)
    refuse_darkness(room(model={"leaks": "allow"}))
