"""Suns behind the façade that a building opposite sends into the room, with the shade closed."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.case.case import Case
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute


@pytest.mark.parametrize("state", ["open", "shaded"])
def test_a_building_opposite_sends_the_sun_in(state):
    case = Case.model_validate(
        {
            "room": {"size": [3, 4, 3], "floor": 0.3, "ceiling": 0.8, "walls": 0.6},
            "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.7, "material": "glass"}]}},
            "materials": {
                "glass": {"type": "glazing", "transmittance": 0.65},
                "cloth": {"type": "diffuser", "transmittance": 0.15, "reflectance": 0.5},
            },
            "shading": {"material": "cloth"},
            "furniture": [
                {"name": "house", "corner": [-3, -8, 0], "size": [9, 1, 9], "reflectance": 0.5}
            ],
            "sensors": {"corner": [0.5, 0.5, 0.8], "count": [2, 2], "spacing": 1.0},
        }
    )  # fmt: skip
    suns = Suns(("sun_north", "sun_south"), np.array([[0, 0.8, 0.6], [0, -0.8, 0.6]]))
    C = compute(scenes.load(case, state), *sensor_points(case), suns, Accuracy(), subdivision=1)
    for name, values in C.data_vars.items():
        assert np.isfinite(values.values).all(), name
    assert (C["interreflected"].sel(bin="sun_north") > 0).all()
    assert (C["straight"].sel(bin="sun_north") == 0).all()
