"""Transmittance of panes as a parameter, where light comes by surfaces outside."""

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.annual.chosen_facade import light_of_channels
from drcmitsuba.case.case import Case
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.scene.tiled_facades import TiledFacades
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.elements.smooth_year import SmoothYear

WALL = {
    "name": "opposite",
    "corner": [-9.0, -2.1, 0.0],
    "size": [22.0, 0.1, 9.0],
    "reflectance": 0.5,
}


@pytest.mark.parametrize("solved", [False, True])
def test_what_a_wall_opposite_sends_is_in_proportion_to_it(solved):
    """Glass reflects nothing: all light in the room is in proportion to its transmittance.

    Solved cells also know what goes out, and comes back by the wall: less than 1 %.
    """
    backend.select()
    case = Case.model_validate(
        {
            "room": {"size": [4.0, 6.0, 3.0]},
            "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]}},
            "materials": {"glass": {"type": "glazing", "transmittance": 0.3, "reflectance": 0.0}},
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 5], "spacing": 1.0},
            "furniture": [WALL],
            "period": {"months": [6], "hours": [10, 14]},
            "accuracy": {"replicates": 2, "sensor_sky_rays": 256},
        }
    )
    light = daylight(case)
    effects = replace(plan(case, light).of_any_facade, solved_cells=solved)
    tiled = TiledFacades.of_grid(case, "south", np.array([0.9, 2.7]), 1, ("wall", "glass"))
    (by_element,) = light_of_channels(
        tiled.case, tiled.panes, light.suns, case.accuracy, effects, lambda share: None
    )
    factors, shares = np.array([1.0, 2.5]), np.array([0.0, 1], np.float32)
    bins = np.arange(len(by_element.labels))
    before, after = (each.total(shares, bins) for each in (by_element, by_element.scaled(factors)))
    assert before.any(axis=(0, 1)).all()
    more, scale = 0.01 if solved else 1e-5, 2.5 * before.max(axis=(0, 1))
    assert (abs(after - 2.5 * before) <= more * scale).all()
    year = SmoothYear.of(by_element, light, np.ones(2, bool), ())
    own = mi.Float([0.0, 1, 1])
    E = [year.illuminance(own, mi.Float([1, f, 1])).open.numpy() for f in (1.0, 2.5)]
    np.testing.assert_allclose(E[1], 2.5 * E[0], rtol=max(more, 1e-4))
