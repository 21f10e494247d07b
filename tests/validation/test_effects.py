"""That leaving out is right: every effect in a scene that needs it, and in one that does not.

The two scenes of a pair differ in one feature, and their plans in exactly that effect. Where an
effect is left out, forcing it on ("all") traces more rays and gives the same answer: within 3
standard errors, and exactly where a proof says so. Where it is needed, "off" changes the answer.
"""

import copy
import re

import numpy as np
import pytest
from scipy.stats import t as student

from drcmitsuba import evaluate, schema
from drcmitsuba.bsdf import read
from drcmitsuba.case import case
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.plan import plan
from drcmitsuba.runtime import backend
from drcmitsuba.sky.daylight import daylight
from tests.fast import slowly

X, Y, Z = 3.0, 4.0, 2.8
GLASS = {"type": "glazing", "transmittance": 0.7}
FILM = str(shipped_folder() / "films" / "prism.xml")
BASE = {
    "name": "pair",
    "period": {"months": [12], "hours": [10, 15], "days_per_week": 1},
    "room": {"size": [X, Y, Z], "floor": 0.3, "ceiling": 0.7, "walls": 0.5},
    "facade": {"south": {"strips": [{"bottom": 0.8, "top": 1.5, "material": "open"}]}},
    "sensors": {"corner": [0.3, 0.3, 0.7], "count": [4, 4], "spacing": 0.7},
    # With seed 0 one ray of the run that forces clear panes, where only walls stop rays,
    # slips through the edge between floor and wall: 0.2 lx at one sensor.
    "accuracy": {"paths": 128, "photons": 512, "seed": 1},
}


def changed(base, **changes):
    """Copy of a case with some values, named by their path with `__`, replaced."""
    out = copy.deepcopy(base)
    for path, value in changes.items():
        *tables, key = path.split("__")
        table = out
        for name in tables:
            table = table.setdefault(name, {})
        table[key] = value
    return out


def strips(*materials):
    """Strips from below, 0.7 m high each."""
    return [
        {"bottom": 0.8 + 0.7 * i, "top": 1.45 + 0.7 * i, "material": m}
        for i, m in enumerate(materials)
    ]


def weather(folder, dhi, dni):
    """A December by dni and dhi [W/m²], the sun's own hours."""
    lines = ["place pair", "latitude 46.2", "longitude -6.1", "time_zone -15", "site_elevation 400"]
    lines += ["weather_data_file_units 1"]
    for day in range(1, 32):
        lines += [f"12 {day} {hour + 0.5} {dni(hour)} {dhi}" for hour in range(24)]
    file = folder / f"december_{dhi}_{dni(10)}.wea"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return {"file": str(file)}


def mirror(folder, reflectance):
    """A mirror at the window that throws light up."""
    file = folder / "mirror.obj"
    file.write_text(
        "v 0 0 0\nv 2 0 0\nv 2 0.6 0.1\nv 0 0.6 0.1\nf 1 2 3\nf 1 3 4\n", encoding="utf-8"
    )
    return {
        "materials": {"silver": {"type": "mirror", "reflectance": reflectance}},
        "components": {
            "plate": {
                "type": "mesh", "file": str(file), "material": "silver",
                "position": [0.5, 0.1, 1.5],
            }
        },
    }  # fmt: skip


def dark(folder):
    """The film's file with nothing but zeros."""
    text = (shipped_folder() / "films" / "prism.xml").read_text(encoding="utf-8")
    numbers = re.compile(r"(<ScatteringData>)(.*?)(</ScatteringData>)", re.DOTALL)
    zero = numbers.sub(lambda m: m[1] + re.sub(r"[^\s{},]+", "0", m[2]) + m[3], text)
    file = folder / "dark.xml"
    file.write_text(zero, encoding="utf-8")
    assert read(file).components
    return str(file)


def film(file=FILM, **more):
    return {"type": "bsdf", "file": file, **more}


def pairs(folder):
    """Name of the effect: (the case that needs it, the one that does not)."""
    room, south = BASE, "facade__south__strips"
    glazed = changed(room, **{south: strips("glass"), "materials__glass": GLASS})
    with_film = changed(room, **{south: strips("film"), "materials__film": film()})
    opal = {"type": "diffuser", "transmittance": 0.5}
    both = changed(room, **{south: strips("open", "opal"), "materials__opal": opal})
    north = [{"bottom": 0.8, "top": 1.45, "material": "film"}]
    shade = changed(
        glazed,
        materials__opal={"type": "diffuser", "transmittance": 0.1},
        shading={"material": "opal", "threshold": 500.0},
    )
    wall = {"name": "wall", "corner": [-9.0, -3.0, 0.0], "size": [20.0, 0.5, 6.0]}
    black = {"floor": 0.0, "ceiling": 0.0, "walls": 0.0}
    return {
        "sky": (room, changed(room, weather=weather(folder, 0, lambda hour: 500))),
        "ground": (room, changed(room, outside__ground_reflectance=0.0)),
        "suns": (
            room,
            changed(room, facade={"north": {"strips": room["facade"]["south"]["strips"]}}),
        ),
        "dark_hours": (
            changed(room, weather=weather(folder, 100, lambda hour: 500)),
            changed(room, weather=weather(folder, 100, lambda hour: 500 * (hour % 2))),
        ),
        "straight_through": (
            changed(with_film, materials__film=film(straight_through="on")),
            with_film,
        ),
        "clear_panes": (both, changed(both, **{south: strips("opal")})),
        "scattering_panes": (
            both, changed(both, materials__opal={"type": "diffuser", "transmittance": 0.0})
        ),
        "films": (with_film, changed(with_film, materials__film=film(dark(folder)))),
        "pane_to_pane": (
            changed(with_film, facade__north__strips=north, accuracy__replicates=16),
            with_film,
        ),
        "components": (
            {**room, **mirror(folder, 0.9)},
            {**room, **mirror(folder, 0.0)},
        ),
        "obstructions": (changed(glazed, furniture=[wall]), glazed),
        "shaded_state": (shade, changed(shade, shading__threshold=1e6)),
        "interreflection": (room, changed(room, room={"size": [X, Y, Z], **black})),
        "colour": (
            changed(room, room__floor=[0.9, 0.1, 0.1], room__walls=[0.9, 0.1, 0.1]),
            changed(room, room__floor=[0.3, 0.3, 0.3], room__walls=[0.3, 0.3, 0.3]),
        ),
    }  # fmt: skip


EFFECTS = [
    "sky", "ground", "suns", "dark_hours", "clear_panes", "scattering_panes", "films",
    "straight_through", "pane_to_pane", "components", "obstructions", "shaded_state",
    "interreflection", "colour",
]  # fmt: skip
RARER = (
    "scattering_panes", "straight_through", "colour", "films", "obstructions", "clear_panes",
    "pane_to_pane", "components",
)  # fmt: skip
"""Effects that are forced on at night only."""
PROVED = set(EFFECTS) - {"straight_through"}
"""Forcing these on changes nothing at all, but for the order of sums."""
FREE = {"pane_to_pane"}
"""Forcing these on costs no ray: no photon starts on a pane before which nothing deviates light."""
ALSO = {
    "components": {"mirrors"},
    "films": {"straight_through"},
    "interreflection": {"solved_cells"},
}
"""Features flip these beside their own effects, by their nature."""


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def planned(data):
    made = case.Case.model_validate(data)
    return plan(made, daylight(made))


def simulated(data, **effects):
    """Mean illuminance of each sensor in every replicate and in the mean; rays by kind."""
    result = evaluate(case.Case.model_validate(changed(data, effects=effects)))
    L = result.sky["L"].mean("time")
    C = result.coefficients["replicates"].sel(state="open")
    if "channel" in C.dims:
        L, C = L.isel(channel=0), schema.luminance(C)
    E = (C.fillna(0) * L).sum("bin").transpose("replicate", "sensor").values
    total = result.illuminance["total"].mean("time").values
    return E, total, sum(result.plan["cost"]["actual"]["rays"].values())


def direct_sun(data, **effects):
    """Largest direct sun [lx]."""
    result = evaluate(case.Case.model_validate(changed(data, effects=effects)))
    return float(result.illuminance["direct_sun"].max())


def z_of(a, b):
    """Paired difference of the mean over the sensors in standard errors, two-sided normal."""
    difference = a.mean(axis=1) - b.mean(axis=1)
    error = difference.std(ddof=1) / np.sqrt(len(difference))
    return abs(difference.mean()) / error if error > 0 else np.inf * bool(difference.any())


@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "dark_hours"])
def test_one_feature_flips_one_effect(name, tmp_path):
    needs, without = pairs(tmp_path)[name]
    on, off = planned(needs).effects, planned(without).effects
    flipped = {effect for effect in on if on[effect].on != off[effect].on}
    assert flipped - ALSO.get(name, set()) == {name}
    assert on[name].on
    assert on[name].reason != off[name].reason


@pytest.mark.parametrize("name", slowly(EFFECTS, *RARER))
def test_forcing_what_is_left_out_changes_nothing_and_costs_rays(name, tmp_path):
    _, without = pairs(tmp_path)[name]
    E, total, rays = simulated(without)
    forced, forced_total, more = simulated(without, **{name: "all"})
    assert more == rays if name in FREE else more > rays
    scale = max(float(total.max()), 1e-9)
    if name in PROVED:
        # Within 1 µm of an opening's edge, a wall may stop a ray that the opening lets pass, or let
        # one pass: one of a cell's rays, in one replicate.
        off = abs(forced - E).max(axis=1) / max(float(E.max()), 1e-9)
        assert np.median(off) <= 1e-5
        assert off.max() <= 1e-3
        assert abs(forced_total - total).max() <= 1e-3 * scale
    else:
        assert z_of(forced, E) < 3 or abs(forced - E).max() <= 1e-5 * E.max()


LONGER = (
    "pane_to_pane", "components", "colour", "obstructions", "clear_panes", "scattering_panes",
    "films",
)  # fmt: skip
"""Effects that are left out at night only."""


@pytest.mark.parametrize(
    "name", slowly([name for name in EFFECTS if name != "dark_hours"], *LONGER)
)
def test_leaving_out_what_is_needed_changes_the_answer(name, tmp_path):
    needs, _ = pairs(tmp_path)[name]
    if name == "straight_through":  # little light, but straight
        assert direct_sun(needs) > 0
        assert direct_sun(needs, straight_through="off") == 0
        return
    E, total, rays = simulated(needs)
    left, left_total, fewer = simulated(needs, **{name: "off"})
    if name == "shaded_state":
        assert abs(left_total - total).max() > 0.1 * total.max()
    else:
        # One in ten thousand by chance: Student's t of the replicates' paired differences.
        assert z_of(left, E) > student.isf(0.5e-4, len(E) - 1)
    if name != "obstructions":  # more light comes in without them
        assert fewer < rays


@pytest.mark.slow
@pytest.mark.parametrize("model", ["three_phase", "adaptive", "five_phase", "daysim"])
def test_with_other_models_of_the_sun(model, tmp_path):
    """Nothing that the plan leaves out counts: with a shade, a wall outside, to north and south.

    The grid of cells, and all that is drawn, stay the same where more is simulated.
    """
    cases = pairs(tmp_path)
    south = changed(cases["shaded_state"][0], sun={"model": model})
    wall = cases["obstructions"][0]["furniture"]
    wide = {"period": {"months": [6, 12], "hours": [8, 18], "days_per_week": 1}}
    for data in (
        {**south, **wide, "furniture": wall},
        {**south, **wide, "facade": {"north": south["facade"]["south"]}},
    ):
        E, total, _ = simulated(data)
        choices = ["shaded_state"] if model == "three_phase" else ["shaded_state", "suns"]
        for name in choices:
            forced, forced_total, _ = simulated(data, **{name: "all"})
            if name == "shaded_state":
                assert abs(forced - E).max() <= 1e-5 * E.max()
                assert abs(forced_total - total).max() <= 1e-5 * total.max()
            else:  # rays that pass no opening: one in 100,000 slips through an edge of the walls
                assert z_of(forced, E) < 3 or abs(forced - E).max() <= 1e-5 * E.max()


def test_a_three_phase_sun_that_is_off_to_the_side_closes_the_shade(tmp_path):
    """It stands before no opening yet, but some of the patches that it is spread over do."""
    stamps = tmp_path / "noon.csv"
    stamps.write_text("time\n2015-12-21T12:14\n2015-12-21T12:20\n", encoding="utf-8")
    data = pairs(tmp_path)["shaded_state"][0]
    data = changed(data, facade={"west": data["facade"]["south"]}, sun={"model": "three_phase"})
    data["period"] = {"timestamps": str(stamps)}
    _, total, _ = simulated(data)
    _, forced, _ = simulated(data, shaded_state="all")
    np.testing.assert_allclose(total, forced, rtol=1e-5)


@pytest.mark.slow
def test_sun_that_a_facade_mirrors_closes_the_shade(tmp_path):
    data = pairs(tmp_path)["shaded_state"][0]
    strips_ = [{"bottom": 0.3, "top": 2.5, "material": "mirror"}]
    data = changed(
        data,
        room={"size": [X, 1.5, Z]},
        facade__north__strips=strips_,
        facade__south__strips=[{"bottom": 0.3, "top": 2.5, "material": "open"}],
        materials__mirror={"type": "glazing", "transmittance": 0.05, "reflectance": 0.9},
        sensors={"corner": [0.3, 0.3, 0.7], "count": [4, 2], "spacing": 0.4},
    )
    effect = planned(data).effects["shaded_state"]
    most = float(re.search(r"at most (\d+)|$", effect.reason)[1] or 0)
    data = changed(data, shading__threshold=1.3 * max(most, 25_000.0))
    _, total, _ = simulated(data)
    _, forced, _ = simulated(data, shaded_state="all")
    np.testing.assert_allclose(total, forced, rtol=1e-5)
