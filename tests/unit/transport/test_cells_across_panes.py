"""Cells that lie on both sides of a pane: what is seen through it counts by its weight."""

from dataclasses import replace

import numpy as np
import pytest

from drcmitsuba.case.reading import load_case
from drcmitsuba.plan import plan
from drcmitsuba.scene import scene
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.coefficients import compute

NO_SUNS = Suns((), np.zeros((0, 3)))
CASE = """
[room]
size = [4.0, 4.0, 3.0]
[facade.south]
strips = [{ bottom = 0.1, top = 2.99, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.07
[[furniture]]
name = "canopy"
corner = [0.0, -4.0, 3.0]
size = [4.0, 4.0, 0.0]
reflectance = 0.7
[sensors]
corner = [0.5, 0.5, 0.8]
count = [4, 4]
spacing = 0.9
[accuracy]
replicates = 64
paths = 64
"""


@pytest.mark.parametrize("solved", [False, True], ids=["paths", "solved"])
def test_a_ceiling_that_goes_on_outside_does_not_brighten_the_room(tmp_path, solved):
    """Its cells had the canopy's light too often: the ceiling's by the glass weighs 0.07 of it.

    With cells of a metre paths got 40 % too much of the reflected light.
    """
    (tmp_path / "case.toml").write_text(CASE)
    case = load_case(tmp_path / "case.toml")
    effects = replace(plan(case, daylight(case)).scope, solved_cells=solved)
    points, normals = sensor_points(case)

    def reflected(cell_size):
        few = case.accuracy.model_copy(update={"cell_size": cell_size})
        C = compute(scene.load(case, effects=effects), points, normals, NO_SUNS, few)
        each = (C["replicates"] - C["direct"]).sum(["sensor", "bin"]).values
        return each.mean(), each.std(ddof=1) / np.sqrt(len(each))

    coarse, fine = reflected(1.0), reflected(0.2)
    error = np.hypot(coarse[1], fine[1])
    assert error < 0.06 * fine[0]
    assert abs(coarse[0] - fine[0]) < 3 * error
