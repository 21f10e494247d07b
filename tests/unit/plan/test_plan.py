"""A plan says which quantity decides, in numbers and in words, and who overrules it."""

import numpy as np
import pytest

from drcmitsuba import evaluate, load_case
from drcmitsuba.case.case import Case
from drcmitsuba.plan import panes, plan
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.runtime.toml import checked
from drcmitsuba.sky.daylight import daylight
from tests import ROOT
from tests.model_rooms import GLASS, case_of, layer, shell

ROOM = {
    "period": {"months": [6], "hours": [8, 18], "days_per_week": 1},
    "room": {"size": [3.0, 4.0, 2.8]},
    "facade": {"south": {"strips": [{"bottom": 1.0, "top": 2.0, "material": "open"}]}},
    "sensors": {"corner": [0.3, 0.3, 0.7], "count": [2, 2], "spacing": 1.0},
    "accuracy": {"replicates": 2, "paths": 16, "sensor_sky_rays": 64, "cell_sky_rays": 4},
}


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def planned(**changes):
    case = Case.model_validate({**ROOM, **changes})
    return plan(case, daylight(case))


def test_every_effect_says_why():
    effects = planned().to_dict()
    assert set(effects) == {
        "sky", "ground", "suns", "dark_hours", "clear_panes", "scattering_panes", "films",
        "straight_through", "pane_to_pane", "components", "obstructions", "shaded_state",
        "interreflection", "solved_cells", "colour", "pictures", "gradients", "mirrors",
    }  # fmt: skip
    assert all(isinstance(effect["on"], bool) and effect["reason"] for effect in effects.values())
    assert {name for name, effect in effects.items() if effect["on"]} == {
        "sky", "ground", "suns", "clear_panes", "interreflection", "solved_cells", "pictures"
    }  # fmt: skip


def test_a_north_room_in_winter_sees_no_sun_and_the_plan_tells_by_how_much():
    north = {"north": ROOM["facade"]["south"]}
    suns = planned(facade=north, period={**ROOM["period"], "months": [12]}).effects["suns"]
    assert not suns.on
    assert suns.quantities["largest_ns"] < -0.1
    assert f"largest n·s = {suns.quantities['largest_ns']:.2f}" in suns.reason


def test_eyes_before_the_façade_see_the_sun_that_no_opening_sees():
    window = np.array([[1, 0, 1], [3, 0, 1], [3, 0, 2], [1, 0, 2]], float)
    room = (*shell(4.0, 5.0, window), layer("glass", GLASS, window))
    sensors = {"corner": [0.5, 0.5, 0.8], "count": [2, 2], "spacing": 1.0}
    winter = {"months": [12], "hours": [11, 13]}
    case = case_of(*room, north=180.0, period=winter, sensors=sensors)
    light = daylight(case)
    within, before = (np.array([[2.0, y, 1.2]]) for y in (2.0, 9.0))
    assert not plan(case, light, within).effects["suns"].on
    assert plan(case, light, before).scope.suns
    assert plan(case, light, before).scope.sun_visibility is None


def test_a_rule_that_asks_for_no_sun_closes_under_any_sky():
    site = {"latitude": 46.0, "longitude": 6.0, "timezone": 1}
    shading, cloth = {"material": "cloth"}, {"type": "diffuser", "transmittance": 0.1}
    tables = {
        "sky": {"model": "cie", "type": "overcast"}, "site": site,
        "materials": {**ROOM.get("materials", {}), "cloth": cloth},
    }  # fmt: skip
    assert not planned(**tables, shading=shading).effects["shaded_state"].on
    assert planned(**tables, shading=shading | {"area": 0.0}).effects["shaded_state"].on


def test_an_overcast_sky_has_no_sun():
    site = {"latitude": 46.0, "longitude": 6.0, "timezone": 1}
    decided = planned(sky={"model": "cie", "type": "overcast"}, site=site)
    assert decided.effects["suns"].reason == "no sun of the period has a radiance"
    assert decided.effects["sky"].on
    assert len(decided.facts.light.suns.labels) == 0


def test_a_room_without_openings_asks_for_nothing():
    decided = planned(facade={})
    on = {name for name, effect in decided.effects.items() if effect.on}
    assert on == {"interreflection", "solved_cells", "pictures"}


def test_the_ground_is_seen_by_sensors_only_where_something_stands():
    open_air = {"room": None, "facade": {}}
    assert not planned(**open_air).effects["ground"].on
    block = {"corner": [9.0, 9.0, 0.0], "size": [1.0, 1.0, 1.0]}
    assert planned(**open_air, furniture=[block]).effects["ground"].on


@pytest.mark.parametrize(
    ("albedo", "part", "surfaces"),
    [
        (0.0, 1e-3, 0),
        (0.5, 1e-3, 10),
        (0.8, 1e-3, 31),
        (0.99, 1e-3, 688),
        (1.0, 1e-3, None),
        (1 - 1e-16, 1e-3, None),
    ],
)
def test_depth_is_where_the_series_has_faded(albedo, part, surfaces):
    depth = panes.depth(albedo, part)
    assert depth == surfaces
    if depth:
        assert albedo**depth <= part < albedo ** (depth - 1)


def test_the_target_decides_how_deep():
    by_target = {
        target: planned(accuracy={**ROOM["accuracy"], "target": target}).scope.depth
        for target in ("20 %", "2 %", "0.2 %", "1 point")
    }
    reflectance = 0.8  # the ceiling's
    expected = [np.ceil(np.log(part) / np.log(reflectance)) for part in (2e-2, 2e-3, 2e-4, 1e-3)]
    assert list(by_target.values()) == expected


def test_the_case_overrules_and_the_reason_says_so():
    effects = {"suns": "off", "interreflection": "all", "clear_panes": "all"}
    decided = planned(effects=effects)
    assert decided.effects["suns"].overruled
    assert decided.effects["suns"].reason.endswith('overruled by [effects] suns = "off"')
    assert (decided.scope.suns, decided.scope.depth, decided.scope.enclosed) == (False, None, False)
    assert decided.notes() == [decided.effects["suns"].reason]
    assert planned(effects={"films": "off"}).notes() == []  # there is none


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ({"suns": "some"}, "effects.suns: got \"some\"; input should be 'auto', 'all' or 'off'"),
        ({"sun": "all"}, 'effects.sun: unknown key; did you mean "suns"?'),
        ({"dark_hours": "off"}, 'effects.dark_hours: got "off"'),
    ],
)
def test_a_choice_that_is_none(effects, message):
    with pytest.raises(InputError) as error:
        checked(Case, {**ROOM, "effects": effects}, "room.toml")
    assert message in str(error.value)


def test_light_mirrored_between_facades_is_followed_but_with_an_adaptive_sun():
    data = load_case("classroom/existing").model_dump(mode="json", exclude_none=True)
    data["period"] = ROOM["period"]

    def effect(**changes):
        case = Case.model_validate({**data, **changes})
        return plan(case, daylight(case)).effects["pane_to_pane"]

    assert not effect().on
    strips = [{"bottom": 0.9, "top": 2.0, "material": "open"}]
    both = {**data["facade"], "north": {"strips": strips}}
    assert effect(facade=both).on
    assert "south" in effect(facade=both).reason
    adaptive = effect(facade=both, sun={"model": "adaptive"})
    assert adaptive.missing
    assert not adaptive.on


def test_a_room_without_openings_is_dark_and_traces_nothing():
    result = evaluate(Case.model_validate({**ROOM, "facade": {}}))
    assert float(abs(result.illuminance["total"]).max()) == 0
    assert float(abs(result.coefficients["replicates"]).max()) == 0
    assert sum(result.plan["cost"]["actual"]["rays"].values()) == 0
    assert result.metrics["sDA"]["value"] == 0


def test_a_summed_year_leaves_out_images_in_polished_floors_and_not_in_panes(tmp_path):
    """The floor is polished in the open state; a sum over groups of panes has it diffuse."""
    (tmp_path / "room.rad").write_text(
        "void plastic floor 0 0 5 .2 .2 .2 .03 0\nvoid glass pane 0 0 3 .9 .9 .9\n"
        "floor polygon f 0 0 12 0 0 0 4 0 0 4 5 0 0 5 0\n"
        "pane polygon p 0 0 12 0 0 1 0 0 2 4 0 2 4 0 1\n"
        "pane polygon q 0 0 12 4 5 1 4 5 2 0 5 2 0 5 1\n"
    )
    (tmp_path / "case.toml").write_text(
        "[model]\nfiles = ['room.rad']\n[sensors]\nfloors = ['floor']\n[period]\nmonths = [6]\n"
        "[materials.shade]\ntype = 'diffuser'\ntransmittance = 0.1\n[shading]\nmaterial = 'shade'\n"
    )
    case = load_case(tmp_path / "case.toml")
    own = plan(case, daylight(case))
    summed = own.summed()
    assert own.effects["mirrors"].on
    assert not own.notes()
    assert summed.scope == own.scope
    changed = {name for name in own.effects if summed.effects[name] != own.effects[name]}
    assert changed == {"mirrors"}
    mirrors = summed.effects["mirrors"]
    assert (mirrors.on, mirrors.missing) == (True, True)  # the panes still mirror
    assert mirrors.reason.startswith("images in polished surfaces (floor; diffuse")
    assert summed.notes() == [mirrors.reason]
    assert plan(case.without_polish(), daylight(case)).summed().notes() == []


def test_a_summed_year_leaves_out_what_films_send_to_panes():
    strips = {m: {"strips": [{"bottom": 1, "top": 2, "material": m}]} for m in ("film", "glass")}
    film = {"type": "bsdf", "file": str(ROOT / "scenes" / "films" / "prism.xml")}
    glass = {"type": "glazing", "transmittance": 0.6, "reflectance": 0.1}
    own = planned(
        facade={"south": strips["film"], "east": strips["glass"]},
        materials={"film": film, "glass": glass},
    )
    assert own.effects["pane_to_pane"].on
    for always, when in ((False, "left out of all hours in which a group"), (True, "openings and")):
        entry = own.summed(always=always).effects["pane_to_pane"]
        assert (entry.on, entry.missing) == (False, True)
        assert when in entry.reason
        assert "−1.1 % of the light of sky and suns" in entry.reason


def test_a_summed_year_of_a_room_without_mirrors_leaves_nothing_out():
    own = planned()
    assert own.summed().effects == own.effects
