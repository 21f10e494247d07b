"""Effects that the fills of a case call for, beyond those of the case as drawn."""

import pytest

from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.fills import effects_of, openings_of
from tests.tiled_room import MATERIALS, room

CLEAR = {"type": "glazing", "transmittance": 0.65}
STRIPS = [{"bottom": 0.9, "top": 2.7, "material": "clear"}]
ADAPTIVE = {"sun": {"model": "adaptive"}}


@pytest.mark.parametrize(
    ("fill", "sides", "tables", "mirrors"),
    [
        ("glass", ["south", "east"], {}, True),
        ("glass", ["south", "east"], {"effects": {"pane_to_pane": "off"}}, False),
        ("glass", ["south", "east"], ADAPTIVE, False),
        ("glass", ["south"], {}, False),
        ("fabric", ["south", "east"], {}, False),
    ],
)
def test_fills_that_mirror_show_light_of_other_openings(fill, sides, tables, mirrors):
    facade = {side: {"segments": 2, "frame": 0.0, "strips": STRIPS} for side in sides}
    materials = {**MATERIALS, "clear": CLEAR}
    case = room(STRIPS, facade=facade, materials=materials, shading=None, **tables)
    assert effects_of(openings_of(case, [fill]), ALL_EFFECTS, case).pane_to_pane == mirrors
