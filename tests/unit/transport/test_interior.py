"""Paths that states of a façade share: they are traced once, and no number knows of it."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.case.groups import OPEN, SHADED
from drcmitsuba.scene import scene
from drcmitsuba.scene.enabled_effects import EnabledEffects
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute
from drcmitsuba.transport.gather import blocks as gather_blocks
from drcmitsuba.transport.interreflection.interior import RoomPaths, SharedInterior
from drcmitsuba.transport.shared_paths import SharedPaths

EFFECTS = EnabledEffects(beyond=False, solved_cells=True)
ACCURACY = Accuracy(replicates=2, paths=32, cell_sky_rays=16, sensor_sky_rays=64, pane_points=16)
POINTS = np.array([[1.0, 1.0, 0.8], [2.0, 3.5, 0.8], [3.0, 1.5, 1.2]])
UP = np.tile([0.0, 0.0, 1.0], (3, 1))
SUNS = Suns(["a", "b"], np.array([[0.0, -0.8, 0.6], [0.6, -0.48, 0.64]]), 0.53)


def states(glass=0.0, shade=0.0, **more):
    """Scenes of a room with its shade open, and closed; panes reflect so much into it."""
    case = Case.model_validate(
        {
            "room": {"size": [4.0, 5.0, 3.0]},
            "materials": {
                "glass": {"type": "glazing", "transmittance": 0.65, "reflectance": glass},
                "shade": {"type": "diffuser", "transmittance": 0.1, "reflectance": shade},
            },
            "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.6, "material": "glass"}]}},
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 4], "spacing": 1.0},
            "shading": {"material": "shade"},
        }
        | more
    )
    return [scene.load(case, state, effects=EFFECTS) for state in (OPEN, SHADED)]


@pytest.fixture
def traced(monkeypatch):
    """Scenes whose interiors have been traced."""
    of, scenes = RoomPaths.of, []

    def counted(world, *rest):
        scenes.append(world)
        return of(world, *rest)

    monkeypatch.setattr(RoomPaths, "of", counted)
    return scenes


def test_states_share_their_paths_and_no_number_changes(traced):
    shared = SharedPaths()
    for world in (worlds := states()):
        once = compute(world, POINTS, UP, SUNS, ACCURACY, shared=shared)
        anew = compute(world, POINTS, UP, SUNS, ACCURACY)
        for name, values in once.data_vars.items():
            np.testing.assert_array_equal(values, anew[name], err_msg=name)
    assert traced == [worlds[0], *worlds]  # once for both, and for each by itself
    shared.forget()
    shared.interior.of(worlds[1], POINTS, UP, ACCURACY)
    assert len(traced) == 4


@pytest.mark.parametrize(
    "other",
    [
        {"glass": 0.1},
        pytest.param({"shade": 0.4}, marks=pytest.mark.slow),
        pytest.param(
            {"furniture": [{"corner": [1.0, 1.0, 0.7], "size": [1.0, 0.6, 0.0]}]},
            marks=pytest.mark.slow,
        ),
        {"room": {"size": [4.0, 5.0, 3.0], "walls": 0.6}},
        {"room": {"size": [4.0, 5.0, 3.0], "rotation": 20.0}},
    ],
    ids=lambda other: next(iter(other)),
)
def test_rooms_that_look_different_from_within_share_nothing(traced, other):
    shared = SharedInterior()
    for world in (states()[0], states(**other)["shade" in other]):
        shared.of(world, POINTS, UP, ACCURACY)
    assert len(traced) == 2


def test_other_points_and_samples_share_nothing(traced):
    shared, world = SharedInterior(), states()[0]
    more = ACCURACY.model_copy(update={"seed": 1})
    for points, accuracy in ((POINTS, ACCURACY), (POINTS + 0.1, ACCURACY), (POINTS, more)):
        shared.of(world, points, UP, accuracy)
    assert len(traced) == 3


def test_light_that_comes_back_from_outside_knows_all_panes():
    effects = EnabledEffects(beyond=True, solved_cells=True)
    one, other = (scene.replace(world, effects=effects) for world in states())
    assert len(one.from_within[0]) == len(other.from_within[0])
    materials = [[part[0] for part in world.from_within[0]] for world in (one, other)]
    assert materials[0] != materials[1]


def test_paths_that_are_not_stored_are_traced_by_every_state(traced, monkeypatch):
    monkeypatch.setattr(gather_blocks, "KEPT", 0)
    shared = SharedInterior()
    for world in states():
        shared.of(world, POINTS, UP, ACCURACY)
    assert len(traced) == 2
