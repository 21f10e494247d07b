"""Mirrors, clear solids and glass in reveals as parts of a model, against plain path tracing.

A model's mirrors and solids are components: photons follow the light that they deviate. Suns are
20° wide, so that plain path tracing finds them in mirrors.
"""

import numpy as np
import pytest

from drcmitsuba.model.materials import (
    DielectricMaterial,
    GlazingMaterial,
    Lambertian,
    MirrorMaterial,
)
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import box
from tests.model_rooms import case_of, layer, prism
from tests.validation.test_models import ACCURACY, agree

pytestmark = pytest.mark.slow

WINDOW = np.array([[0.5, 0, 1], [3.5, 0, 1], [3.5, 0, 2.6], [0.5, 0, 2.6]])
PLAIN = GlazingMaterial(type="glazing", transmittance=0.7)
SILVER = MirrorMaterial(type="mirror", reflectance=0.9)
LACQUER = MirrorMaterial(type="mirror", reflectance=0.6, roughness=0.2, specular=0.4)
PARQUET = MirrorMaterial(type="mirror", reflectance=0.5, specular=0.1, polished=True)
CLEAR = DielectricMaterial(type="dielectric", ior=1.5)
SHELF = [(0.5, -0.6, 1.0), (3.5, -0.6, 1.0), (3.5, -0.02, 1.0), (0.5, -0.02, 1.0)]
ON_A_WALL = [(0.02, 1, 0.5), (0.02, 4, 0.5), (0.02, 4, 2.5), (0.02, 1, 2.5)]
TABLE = [(2, 1, 0.5), (3.5, 1, 0.5), (3.5, 2, 0.5), (2, 2, 0.5)]
BLOCK = box(np.array([1.0, 0.5, 1.2]), np.array([0.5, 0.5, 0.5]))
PARTS = {
    "shelf": layer("shelf", SILVER, SHELF),
    "mirror": layer("mirror", SILVER, ON_A_WALL),
    "table": layer("table", LACQUER, TABLE),
    "block": layer("block", CLEAR, *BLOCK),
    "parquet": layer("parquet", PARQUET, TABLE),
}


def room(*more, glass=PLAIN):
    floor, ceiling, walls = prism([(0, 0), (4, 0), (4, 5), (0, 5)], 3.0)
    return case_of(
        layer("floor", Lambertian(0.3), floor),
        layer("ceiling", Lambertian(0.8), ceiling),
        layer("south", Lambertian(0.5), walls[0], holes=[WINDOW]),
        layer("walls", Lambertian(0.5), *walls[1:]),
        layer("glass", glass, WINDOW),
        *more,
        sensors={"floors": ["floor"], "spacing": 2.0, "margin": 0.5},
        accuracy=ACCURACY,
        north=25.0,
    )


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


@pytest.mark.parametrize(
    "names",
    [["shelf"], ["mirror"], ["table"], ["block"], ["parquet"], ["shelf", "mirror", "block"]],
)
def test_mirrors_and_solids_stand_in_a_model(names, same, plain_coefficients):
    case = room(*(PARTS[name] for name in names))
    agree(case, same, plain_coefficients, pane_to_pane=False, within=0.03)


def test_a_room_whose_walls_have_two_leaves(same, plain_coefficients):
    """Cells of 0.25 m hold both leaves; light comes to the inner one only."""
    _, _, leaves = prism([(-0.1, -0.1), (4.1, -0.1), (4.1, 5.1), (-0.1, 5.1)], 3.0)
    outer = layer("outer", Lambertian(0.2), *leaves[1:])
    case = room(PARTS["shelf"], outer)
    agree(case, same, plain_coefficients, pane_to_pane=False, within=0.03)


@pytest.mark.parametrize("followed", [False, True])
def test_glass_mirrors_to_the_reveals_around_it(followed, same, plain_coefficients):
    """By shadow rays, or by photons where these are traced; without it 4 % of the sky lack."""
    frame = WINDOW - [0, 0.6, 0]
    sides = [[WINDOW[i], WINDOW[i - 3], frame[i - 3], frame[i]] for i in range(4)]
    glass = GlazingMaterial(type="glazing", transmittance=0.5, ior=3.0)
    case = room(layer("reveals", Lambertian(0.8), *sides), glass=glass)
    agree(case, same, plain_coefficients, pane_to_pane=followed, within=0.03)
