"""States of the façade from light by element against simulations of each state."""

import numpy as np
import pytest

from drcmitsuba.case.accuracy import Accuracy
from drcmitsuba.runtime import backend
from drcmitsuba.scene import scene as scenes
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.pane_groups import PaneGroups
from drcmitsuba.scene.sensors import sensor_points
from drcmitsuba.transport import coefficients, elements
from tests.model_rooms import l_room
from tests.unit.transport.exact_scenes import CLOTH, SUNS
from tests.unit.transport.test_light_by_element import case, in_state

pytestmark = pytest.mark.slow
FINE = {"replicates": 32, "paths": 1024, "cell_size": 0.2, "sensor_sky_rays": 4096,
        "cell_sky_rays": 128, "pane_points": 128}  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def both(one, states):
    """Replicates of C of each state: by element, and by a simulation with other numbers."""
    accuracy = Accuracy(**FINE)
    light = elements.compute(one, PaneGroups.of(one), SUNS, accuracy, ALL_EFFECTS)
    again, sensors = Accuracy(**{**FINE, "seed": 5}), sensor_points(one)
    for state in states:
        direct = coefficients.compute(scenes.load(one, state), *sensors, SUNS, again)
        yield in_state(light, state)["replicates"].values, direct["replicates"].values


def test_a_room_with_two_façades(same):
    states = ("open", "cloth/open/open", "opal/cloth/open", "open/cloth/open", "shaded")
    for ours, direct in both(case(), states):
        same(ours[..., :146], other=direct[..., :146], within=0.003)
        same(ours[..., 146:], other=direct[..., 146:], within=0.02)


def test_a_model_with_a_roof_light_and_a_partition(same):
    """Groups by direction: the sun closes the south, the triangle to the east, and the slopes."""
    one = l_room(
        materials={"cloth": CLOTH},
        shading={"material": "cloth"},
        sensors={"corner": [0.6, 0.6, 0.8], "count": [2, 2], "spacing": 1.6},
    )
    groups = PaneGroups.of(one).states
    assert len(groups) > 2
    one_shut = groups.label([i == 0 for i in range(len(groups))])
    for ours, direct in both(one, ("open", one_shut, "shaded")):
        same(ours[..., :146], other=direct[..., :146], within=0.005)
        # Few of the five suns reach four sensors behind cloth.
        same(ours[..., 146:], other=direct[..., 146:], within=0.1)


def test_straight_light_is_that_of_all_groups():
    """The straight light of the groups adds up to that of the whole façade."""
    one = case()
    groups = PaneGroups.of(one)
    assert groups.states.names[:2] == ("south", "east")
    south, east = (scenes.load(one, s) for s in ("(blocked)/open/open", "open/(blocked)/(blocked)"))
    points, normals = sensor_points(one)
    accuracy = Accuracy(replicates=2, paths=1)
    from_east = coefficients.compute(south, points, normals, SUNS, accuracy)["straight"].values
    from_south = coefficients.compute(east, points, normals, SUNS, accuracy)["straight"].values
    whole = coefficients.compute(scenes.load(one), points, normals, SUNS, accuracy)
    np.testing.assert_allclose(from_east + from_south, whole["straight"].values, atol=1e-9)
