"""Forecasts beside what is counted: rays by kind, bytes; nothing for what is off; never times."""

import json
import os
import subprocess
import sys

import drjit as dr
import numpy as np
import pytest
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import evaluate, load_case
from drcmitsuba.annual.run import Run
from drcmitsuba.annual.simulation import coefficients
from drcmitsuba.case.case import Case
from drcmitsuba.case.schedule import HOURS
from drcmitsuba.case.shipped import shipped_folder
from drcmitsuba.plan import plan
from drcmitsuba.plan.forecast import cost as cost_of
from drcmitsuba.plan.forecast import forecast, is_short, work
from drcmitsuba.plan.forecast.cost import KERNELS
from drcmitsuba.plan.forecast.pilot import few_photons
from drcmitsuba.plan.forecast.pilot_paths import REPLICATES, PilotPaths
from drcmitsuba.plan.forecast.summed import is_summed, states_of_year
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.machine_speed import Speed, speed
from drcmitsuba.runtime.ray_counter import KINDS
from drcmitsuba.scene.prepared_case import PreparedCase, prepared
from drcmitsuba.scene.scene import load
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport import coefficients as transport
from drcmitsuba.transport.photons.tracer import of_patch
from tests import ROOT
from tests.fast import slowly

GLASS = {"type": "glazing", "transmittance": 0.65}
MILKY = {"type": "diffuser", "transmittance": 0.3, "reflectance": 0.2}
FILM = {"type": "bsdf", "file": str(shipped_folder() / "films/prism.xml")}


def windows(side, *materials):
    height = 1.8 / len(materials)
    strips = [
        {"bottom": 0.9 + i * height, "top": 0.9 + (i + 1) * height, "material": m}
        for i, m in enumerate(materials)
    ]
    return {side: {"strips": strips}}


ROOM = {
    "period": {"months": [3, 6], "days_per_week": 1},
    "room": {"size": [4.0, 5.0, 3.0]},
    "materials": {"glass": GLASS, "milky": MILKY},
    "facade": windows("south", "glass"),
    "sensors": {"corner": [0.5, 0.5, 0.8], "count": [5, 6], "spacing": 0.6},
    "accuracy": {
        "replicates": 2, "paths": 64, "cell_size": 0.5, "cell_sky_rays": 32,
        "sensor_sky_rays": 256, "pane_points": 32, "film_sky_samples": 8, "photons": 32,
    },
}  # fmt: skip
PIPE = {
    "pipe": {
        "type": "lightpipe", "centre": [2.0, 2.5], "width": 0.6, "height": 1.0,
        "mirror": "silver", "top": "glass", "bottom": "milky",
    }
}  # fmt: skip
OVERCAST = {
    "sky": {"model": "cie", "type": "overcast"},
    "site": {"latitude": 46.0, "longitude": 6.0, "timezone": 1},
}
BLOCK = {"corner": [6.0, 2.0, 0.0], "size": [2.0, 2.0, 3.0]}
KINDS_OF_CASES = {
    "clear": {},
    "shade": {"shading": {"material": "milky"}},
    "diffuser": {"facade": windows("south", "milky", "glass")},
    "film": {
        "facade": windows("south", "glass", "film"),
        "materials": {"glass": GLASS, "film": FILM},
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
    },
    "pipe": {
        "facade": {}, "components": PIPE,
        "materials": {
            "glass": GLASS, "milky": MILKY, "silver": {"type": "mirror", "reflectance": 0.95},
        },
    },
    "no room": {"room": None, "facade": {}, "furniture": [BLOCK]},
    "outside": {"furniture": [{"corner": [-2.0, -6.0, 0.0], "size": [8.0, 1.0, 4.0]}]},
    "film behind a building": {
        "facade": windows("south", "glass", "film"),
        "materials": {"glass": GLASS, "film": FILM},
        "furniture": [{"corner": [-4.0, -12.0, 0.0], "size": [12.0, 4.0, 9.0]}],
        "sensors": {"corner": [0.5, 0.5, 0.8], "count": [3, 3], "spacing": 1.0},
    },
    "colour": {"room": {"size": [4.0, 5.0, 3.0], "walls": [0.6, 0.5, 0.4]}},
    "white": {"room": {"size": [4.0, 5.0, 3.0], "floor": 0.95, "ceiling": 0.95, "walls": 0.95}},
    "north, overcast": {"facade": windows("north", "glass"), **OVERCAST},
    "adaptive": {"sun": {"model": "adaptive"}},
}  # fmt: skip
WITHIN = {"shadow": 0.25, "path": 0.1, "pane": 0.25, "photon": 0.4}
"""Share by which forecast rays may be off: a pilot has 48 sensors, 128 suns and 16,000 photons."""
CHANCE = {
    ("adaptive", "shadow"): 1.0,  # a mesh of suns is as fine as it has to be
    ("adaptive", "path"): 1.0,
}


@pytest.fixture(autouse=True)
def _variant():
    backend.select()


def planned(**changes):
    case = Case.model_validate({**ROOM, **changes})
    return plan(case, daylight(case))


@pytest.mark.parametrize(
    "kind",
    slowly(KINDS_OF_CASES, "diffuser", "no room", "outside", "film behind a building", "white"),
)
def test_rays_are_those_that_are_traced(kind):
    case_plan = planned(**KINDS_OF_CASES[kind])
    facts, run = case_plan.facts, Run.of(case_plan.facts.case, case_plan.scope)
    coefficients(facts.case, facts.light, run)
    rays = run.ray_counter
    expected = work(case_plan).by_unit
    for name in KINDS:
        allowed = CHANCE.get((kind, name), WITHIN[name])
        assert (expected[name] == 0) == (rays[name] == 0), name
        if rays[name]:
            assert abs(np.log(expected[name] / rays[name])) < np.log(1 + allowed), name


@pytest.mark.slow
@pytest.mark.parametrize("name", ["classroom/existing", "prism/as_bsdf"])
def test_a_pilot_of_a_shipped_case_is_small_and_gives_its_rays_within_a_factor_of_2(name):
    case = load_case(name)
    case_plan = plan(case, daylight(case))
    run = Run.of(case, case_plan.scope)
    coefficients(case, case_plan.facts.light, run)
    counted = work(case_plan)
    for kind, rays in run.ray_counter.items():
        assert rays / 2 <= counted.by_unit[kind] <= 2 * rays, kind
    pilots = sum(sum(p.scene.ray_counter.counted().values()) for p in counted.pilots.values())
    # Fewer sensors and suns in two replicates: less than the share of these among all.
    assert pilots < sum(run.ray_counter.values()) * REPLICATES / case.accuracy.replicates


def test_a_north_room_under_an_overcast_sky_pays_for_no_sun_film_or_photon():
    case_plan = planned(**KINDS_OF_CASES["north, overcast"])
    costly = {"film_sun", "film_sum", "photon", "pane"}
    assert not costly & {unit for unit, amount in work(case_plan).by_unit.items() if amount}
    shares = forecast(case_plan, Speed()).shares
    off = {name for name, effect in case_plan.effects.items() if not effect.on}
    assert {"suns", "films", "components", "shaded_state"} <= off
    assert {name: shares[name] for name in off} == dict.fromkeys(off, 0.0)


@pytest.mark.parametrize(
    "kind", slowly(KINDS_OF_CASES, "diffuser", "no room", "film behind a building", "white")
)
def test_shares_add_up_and_what_is_off_costs_nothing(kind):
    case_plan = planned(**KINDS_OF_CASES[kind])
    expected = forecast(case_plan, Speed())
    assert sum(expected.shares.values()) == pytest.approx(1)
    assert set(expected.shares) == {*case_plan.effects, "rest"}
    for name, effect in case_plan.effects.items():
        if not effect.on:
            assert expected.shares[name] == 0, name
    entries = expected.beside(case_plan.to_dict())
    assert all(isinstance(entry["on"], bool) and entry["reason"] for entry in entries.values())
    assert sum(entry["share"] for entry in entries.values()) == pytest.approx(1, abs=0.002)


@pytest.mark.parametrize(
    ("effect", "kind", "units"),
    [
        ("suns", "clear", {"shadow"}),
        ("shaded_state", "shade", {"pane"}),
        ("scattering_panes", "diffuser", {"pane", "shadow"}),
        ("films", "film", {"film_sun", "product", "pane", "shadow"}),
        ("films", "film behind a building", {"film_sun", "film_sum", "pane", "shadow"}),
        ("components", "pipe", {"photon"}),
        ("interreflection", "clear", {"path", "product", "deposit"}),
        ("pictures", "clear", {"picture"}),
    ],
)
def test_what_is_switched_off_is_not_forecast(effect, kind, units):
    changes = KINDS_OF_CASES[kind]
    on, off = (
        work(planned(**changes, effects={effect: choice})).amounts for choice in ("auto", "off")
    )
    for unit in units:
        assert on[effect, unit] > 0
    assert not any(amount for (name, _), amount in off.items() if name == effect)


def test_more_of_anything_costs_more():
    def cost(**changes):
        tables = {"shading": {"material": "milky"}, "effects": {"solved_cells": "off"}, **changes}
        return forecast(planned(**tables), Speed())

    def more(**settings):
        return {"accuracy": {**ROOM["accuracy"], **settings}}

    least = cost()
    for changes in (
        {"sensors": {**ROOM["sensors"], "count": [10, 12], "spacing": 0.3}},
        {"period": {"months": [3, 6], "days_per_week": 5}},
        more(replicates=4), more(paths=128), more(cell_sky_rays=64), more(sensor_sky_rays=1024),
        more(sensor_sun_samples=16), more(cell_size=0.25), more(pane_points=128),
    ):  # fmt: skip
        expected = cost(**changes)
        assert expected.seconds > least.seconds, changes
        assert expected.memory_bytes >= least.memory_bytes, changes
        assert sum(expected.items.values()) > sum(least.items.values()), changes


def test_a_faster_machine_needs_less_by_what_it_is_faster_in():
    case_plan = planned()
    slow, kernels, host = (
        forecast(case_plan, s).seconds for s in (Speed(), Speed(rays=2.0), Speed(host=2.0))
    )
    items = forecast(case_plan, Speed()).items
    by_kernel = sum(items.get(unit, 0) * seconds for unit, seconds in KERNELS.items())
    assert slow - kernels == pytest.approx(by_kernel / 2)
    assert slow - host == pytest.approx((slow - by_kernel) / 2)


def test_the_machine_is_measured_once():
    assert speed() is speed()
    assert speed().rays > 0
    assert speed().host > 0


@pytest.mark.parametrize(
    "kind",
    [
        "clear",
        *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("shade", "colour", "pipe")),
        "north, overcast",
    ],
)
def test_bytes_on_disk_and_the_actual_cost_are_written(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(cost_of, "SHORT", 0)
    case = Case.model_validate({**ROOM, **KINDS_OF_CASES[kind]})
    result = evaluate(case)
    result.save(tmp_path)
    cost = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))["cost"]
    written = [f for f in tmp_path.rglob("*") if f.is_file() and f.name != "plan.json"]
    disk = sum(f.stat().st_size for f in written)
    assert cost["actual"]["disk_bytes"] == disk
    assert 0.5 < cost["forecast"]["disk_bytes"] / disk < 2
    assert cost["actual"]["memory_bytes"] >= result.metrics["peak_memory_bytes"]
    assert set(cost["actual"]["rays"]) == set(KINDS)
    assert cost["on"] is True
    assert "forecast" in cost["reason"]
    assert "took" in cost["reason"]


def test_what_takes_little_longer_than_its_pilot_has_no_forecast():
    room = planned()
    assert is_short(room)
    result = evaluate(room.facts.case)
    assert "forecast" not in result.metrics["seconds"]
    assert set(result.plan["cost"]) == {"on", "reason", "actual"}
    assert result.plan["cost"]["reason"].startswith("took ")


@pytest.mark.parametrize(
    "tables",
    [
        KINDS_OF_CASES["pipe"],
        {"sun": {"model": "adaptive"}},
        {"accuracy": {**ROOM["accuracy"], "target": "1 point"}},
        {"accuracy": {**ROOM["accuracy"], "replicates": 16, "sensor_sky_rays": 1 << 20}},
        {
            "sensors": {"corner": [0.02, 0.02, 0.8], "count": [260, 260], "spacing": 0.012},
            "accuracy": {**ROOM["accuracy"], "replicates": 8},
        },
        {"accuracy": {**ROOM["accuracy"], "cell_sky_rays": 1 << 16, "cell_size": 0.2}},
    ],
    ids=["photons", "mesh of suns", "target", "rays", "sensors", "cells"],
)
def test_long_evaluations_have_a_forecast(tables):
    assert not is_short(planned(**tables))


def kernels(work):
    """Hashes of the kernels that some work launches."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        work()
        return {k["hash"] for k in dr.kernel_history([dr.KernelType.JIT])}


@pytest.mark.parametrize("kind", ["clear", "film"])
def test_the_pilot_compiles_no_kernel_that_the_evaluation_does_not_use(kind):
    case_plan = planned(**KINDS_OF_CASES[kind])
    facts = case_plan.facts
    evaluation = kernels(lambda: coefficients(facts.case, facts.light))
    assert not kernels(lambda: work(case_plan)) - evaluation


NOT_LOADED = """
import sys
from drcmitsuba import evaluate, load_case
from drcmitsuba.case.case import Case
from drcmitsuba.case.schedule import HOURS
case = Case.model_validate({case!r})
evaluate(case).save({folder!r})
unwanted = ("matplotlib", "drcmitsuba.report.plots", "drcmitsuba.report.figures")
print(*[name for name in unwanted if name in sys.modules])
"""


@pytest.mark.parametrize(
    ("pictures", "loaded"),
    [("off", ""), pytest.param("auto", "matplotlib", marks=pytest.mark.slow)],
)
def test_matplotlib_is_loaded_where_pictures_are_drawn(pictures, loaded, tmp_path):
    (tmp_path / "monthly.png").write_bytes(b"of an earlier evaluation")
    case = {
        **ROOM,
        "effects": {"pictures": pictures},
        "period": {"months": [6], "days_per_week": 1},
    }
    code = NOT_LOADED.format(case=case, folder=str(tmp_path))
    completed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        cwd=ROOT, env=os.environ,
    )  # fmt: skip
    assert completed.stdout.split(" ")[0].strip() == loaded
    assert bool(list(tmp_path.glob("*.png"))) == (pictures == "auto")


SIDES = ("north", "east", "south", "west")


def with_groups(*materials, schedule=None, **changes):
    """Plan of a room with windows in four sides, each strip a group of its own."""
    groups = {
        f"{side} {name}": {"panes": [name], "facing": side, "states": ["milky"]}
        for side in SIDES
        for name in materials
    }
    if schedule is not None:
        groups = {name: {**group, "schedule": schedule} for name, group in groups.items()}
    facade = {k: v for side in SIDES for k, v in windows(side, *materials).items()}
    kinds = dict.fromkeys(materials, GLASS) | {"milky": MILKY}
    return planned(facade=facade, materials=kinds, groups=groups, **changes)


def test_states_are_those_that_one_sun_may_close():
    """In June the sun shines on one side or on two that meet: open, four and four."""
    assert states_of_year(with_groups("glass")) == 9
    assert not is_summed(with_groups("glass"))
    # Two groups a side: 1 + 4 · (2² − 1) + 4 · (2² − 1)².
    assert states_of_year(with_groups("low", "high")) == 49
    assert is_summed(with_groups("low", "high"))


def test_scheduled_states_are_counted_as_they_come(tmp_path):
    names = [f"{side} glass" for side in SIDES]
    rows = [[hour >> g & 1 for g in range(4)] for hour in range(16)] * (HOURS // 16 + 1)
    lines = [",".join(map(str, row)) for row in rows[:HOURS]]
    (tmp_path / "s.csv").write_text("\n".join([",".join(names), *lines]) + "\n")
    scheduled = with_groups("glass", schedule=tmp_path / "s.csv")
    stamps = scheduled.facts.hours
    assert states_of_year(scheduled) == min(16, stamps)
    assert is_summed(scheduled)


def test_a_year_of_many_states_is_forecast_as_a_sum():
    few, many = with_groups("glass"), with_groups("low", "high")
    counted = work(many)
    assert counted.summed is not None
    assert work(few).summed is None
    # 16 elements and the light besides; each sun shines on some of the groups.
    bins, (patches, suns) = counted.summed.bins, counted.summed.panes_open.bins
    assert 17 * patches + suns < bins < 17 * patches + 9 * suns
    here, there = forecast(few), forecast(many)
    assert there.memory_bytes > here.memory_bytes
    assert there.summed_states == 49
    assert "sum over groups" in there.beside(many.to_dict())["shaded_state"]["reason"]
    assert "sum over groups" not in here.beside(few.to_dict())["shaded_state"]["reason"]


def test_cells_that_two_rooms_meet_are_lit_for_each(monkeypatch):
    monkeypatch.setattr(transport, "TOGETHER", 15)
    case = Case.model_validate(ROOM)
    scene, (points, normals) = load(case, "open"), prepared(case).receivers.at()
    rooms = (np.arange(len(points)) >= len(points) // 2).astype(int)
    accuracy = case.accuracy.of_points(len(points))
    alone, two = (PilotPaths.of(scene, points, normals, accuracy, told) for told in (None, rooms))
    assert len(alone.times) == alone.met
    assert two.met < len(two.times) <= 2 * len(alone.times) * 1.2
    assert two.times.sum() > 4 * alone.times.sum()  # more vertices meet rarer cells


def test_sensors_gather_from_the_cells_of_their_own_rooms(monkeypatch):
    case = Case.model_validate(ROOM | {"effects": {"solved_cells": "off"}})
    here = plan(case, daylight(case))
    alone = forecast(here)
    monkeypatch.setattr(transport, "TOGETHER", 15)
    halves = np.arange(len(prepared(case).receivers)) // 15
    monkeypatch.setattr(PreparedCase, "rooms_of", lambda case, points: halves)
    two = forecast(here)
    assert two.items["deposit"] > 1.5 * alone.items["deposit"]  # both see the one room
    assert two.items["product"] == pytest.approx(alone.items["product"], rel=0.2)


@pytest.mark.parametrize("subdivision", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("photons", [1024, 341, 256])
def test_photons_of_a_pilot_scale_for_suns_and_patches(subdivision, photons):
    """Those of patches of MF 6 were 27 % too few in the forecast."""
    few = few_photons(photons, subdivision, len(Patches(subdivision)), 128)
    ratio = of_patch(photons, subdivision) / of_patch(few, subdivision)
    assert ratio == pytest.approx(photons / few, rel=0.02)
    assert few <= photons
