"""Effects that the fills of a case call for, beyond those of the case as drawn."""

import pytest

from drcmitsuba.case.effects import Effects
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.fills import effects_of, openings_of
from tests.tiled_room import MATERIALS, room

CLEAR = {"type": "glazing", "transmittance": 0.65}
STRIPS = [{"bottom": 0.9, "top": 2.7, "material": "clear"}]


@pytest.mark.parametrize(
    ("fill", "choice", "mirrors"),
    [("glass", "auto", True), ("glass", "off", False), ("fabric", "auto", False)],
)
def test_fills_that_mirror_show_light_of_other_openings(fill, choice, mirrors):
    case = room(STRIPS, materials={**MATERIALS, "clear": CLEAR}, shading=None)
    effects = effects_of(openings_of(case, [fill]), ALL_EFFECTS, Effects(pane_to_pane=choice))
    assert effects.pane_to_pane == mirrors
