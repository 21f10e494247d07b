"""Cells that the first round finds: where sensors see few of them, and where paths meet none."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.model.materials import Lambertian
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.scene.geometry import Surface
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.interreflection import solved_cells
from drcmitsuba.transport.interreflection.interior import RoomPaths
from tests.unit.transport.exact_scenes import plane

UP = np.array([[0.0, 0.0, 1.0]])
UNDER_A_TABLE = np.array([[4.8, 6.4, 0.7]])
IN_THE_ROOM = np.array([[4.8, 4.0, 1.2]])


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def hall(solved, **room):
    """A wide room with one small table."""
    case = Case.model_validate(
        {
            "room": {"size": [9.0, 12.0, 3.5], **room},
            "materials": {"glass": {"type": "glazing", "transmittance": 0.65}},
            "facade": {"south": {"strips": [{"bottom": 0.9, "top": 3.2, "material": "glass"}]}},
            "furniture": [{"corner": [4.0, 6.0, 0.74], "size": [1.6, 0.8, 0.0]}],
            "sensors": {"corner": [1.0, 1.0, 0.7], "count": [1, 1], "spacing": 1.0},
        }
    )
    return scene.load(case, effects=EnabledEffects(solved_cells=solved, beyond=False))


def test_a_sensor_under_a_table_knows_the_cells_of_the_room():
    accuracy, world = Accuracy(replicates=2), hall(True)
    under, open_air = (
        RoomPaths.of(world, p, UP, accuracy).gathered.cells.count
        for p in (UNDER_A_TABLE, IN_THE_ROOM)
    )
    assert under > 0.97 * open_air


def test_a_sensor_under_a_table_gets_the_light_of_paths(same):
    both = [
        compute(hall(solved), UNDER_A_TABLE, UP, Suns.none(), Accuracy(replicates=32, paths=paths))
        for solved, paths in ((True, 128), (False, 1024))
    ]
    ours, theirs = (C["replicates"].values.sum(axis=2) for C in both)
    same(ours, other=theirs, within=0.03)


def test_cells_that_the_second_round_finds_send_rays_too(monkeypatch):
    """With a single path from each cell, the first round leaves much to find."""
    monkeypatch.setattr(solved_cells, "FEW", 1)
    monkeypatch.setattr(solved_cells, "PER_CELL", 0)
    accuracy, world = Accuracy(replicates=2), hall(True)
    transfer = RoomPaths.of(world, UNDER_A_TABLE, UP, accuracy).transfer
    cells = len(transfer.blocks.of.numpy())
    sending = len(np.unique(transfer.bounces[0].source.numpy()))
    assert cells > 1500
    assert sending > 0.96 * cells


@pytest.mark.parametrize(
    "world",
    [
        lambda solved: hall(solved, floor=0.0, walls=0.0),
        lambda solved: scene.replace(
            scene.build([plane(2.0, Lambertian(0.4), half=20.0, front=-1)]),
            effects=EnabledEffects(solved_cells=solved),
        ),
    ],
    ids=["black but for the ceiling", "a single plane"],
)
def test_paths_may_meet_nothing_after_the_cells_that_sensors_see(world, same):
    accuracy = Accuracy(replicates=16, cell_size=2.0, cell_sky_rays=256)
    ours, theirs = (
        compute(world(solved), IN_THE_ROOM, UP, Suns.none(), accuracy)["replicates"].values.sum(2)
        for solved in (True, False)
    )
    assert ours.min() > 0
    same(ours, other=theirs, within=0.05)


def test_possible_cells_are_those_of_diffuse_surfaces():
    square = np.array([[[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0]]], float)
    triangle = square[:, [0, 1, 2, 2]]
    world = scene.build(
        [Surface("floor", Lambertian(0.2), square), Surface("gable", Lambertian(0.5), triangle)]
    )
    assert solved_cells._possible_cells(world, 0.5) == pytest.approx((6 + 3) / 0.25)
    assert solved_cells._possible_cells(scene.build([]), 0.5) == 0
