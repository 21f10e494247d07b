"""Areas of cells where walls have two leaves nearer to each other than a cell is large."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene.geometry import Surface, box
from drcmitsuba.scene.scene import build
from drcmitsuba.transport.cells.cells import CellGrid
from drcmitsuba.transport.photons.reached import ReachedSurfaces
from drcmitsuba.transport.photons.receivers import CellAreas

SIZE = np.array([3.0, 4.0, 2.5])
POINTS = np.array([[1.0, 1, 0.8], [2.0, 3, 0.8]])
UP = np.tile([0.0, 0, 1], (2, 1))


def leaves(gap):
    outer = box(-gap * np.ones(3), SIZE + 2 * gap)
    every = np.array([*box(np.zeros(3), SIZE), *outer])
    scene = build([Surface("walls", Lambertian(0.6), every)])
    return replace(scene, near=np.array([-gap * np.ones(3), SIZE + gap]))


def test_paths_among_black_surfaces_meet_nothing():
    backend.select()
    scene = build([Surface("walls", Lambertian(0.0), np.array(box(np.zeros(3), SIZE)))])
    scene = replace(scene, near=np.array([np.zeros(3), SIZE]))
    grid = CellGrid.of(scene, 0.3)
    reached = ReachedSurfaces.of(scene, POINTS, UP, grid, seed=0)
    assert not dr.any(reached.marks > 0)
    assert not dr.any(reached.vertices > 0)


@pytest.mark.parametrize("gap", [0.04, 0.1])
def test_only_the_side_counts_that_paths_of_the_sensors_meet(gap):
    backend.select()
    scene = leaves(gap)
    grid = CellGrid.of(scene, 0.3)
    reached = ReachedSurfaces.of(scene, POINTS, UP, grid, seed=0)
    inner = 2 * (12 + 7.5 + 10)
    outer = sum(np.prod(np.delete(SIZE + 2 * gap, i)) * 2 for i in range(3))
    whole = dr.sum(CellAreas.of(scene, grid, 1).area)[0]
    assert whole == pytest.approx(2 * (inner + outer), rel=1e-3)
    # Cells that no path meets keep the sides that face out, and those of the cavity.
    met = dr.compress(reached.vertices > 0)
    areas = CellAreas.of(scene, grid, 1, reached)
    row, known = areas.at(met)
    assert dr.all(known)
    assert dr.sum(dr.gather(type(areas.area), areas.area, row))[0] == pytest.approx(inner, rel=0.01)
