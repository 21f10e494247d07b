"""Searches in buildings of gbXML and IFC: areas of the files, and what is found, afresh."""

import json

import mitsuba as mi
import pandas as pd
import pytest

import drcmitsuba
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.runtime import backend
from tests import skips
from tests.system.test_optimise_models import agrees, compare_with_differences
from tests.unit.model import gbxml_building as house

CASE = """
[model]
files = ["{file}"]
[period]
months = [3]
days_per_week = 1
hours = [9, 15]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.opal]
type = "diffuser"
transmittance = 0.5
[materials.shade]
type = "diffuser"
transmittance = 0.1
[shading]
material = "shade"
[sensors]
spaces = ["*"]
spacing = 1.0
[metrics]
sda_threshold = 300.0
ase_hours = 2.0
[accuracy]
replicates = 6
paths = 128
[design]
film = "opal"
pareto = 0
starts = 1
sharpness = [8.0]
"""
PANES = "ase_limit = {limit}\nglazing_transmittance = [0.3, 0.9]\n"
WALLS = """clear = "glass"
spaces = ["Office (Level 1, 2)"]
side = "south"
rows = 2
wwr = [0.1, 0.3]
"""


def case_of(folder, file, design):
    (folder / "case.toml").write_text(CASE.format(file=file) + design, encoding="utf-8")
    return drcmitsuba.load_case(folder / "case.toml")


def search_of_panes(case, area):
    """Search film and glass of all panes [m²]; compare E, gradients and verdict afresh."""
    backend.select()
    layout = ModelLayout.of(case)
    problem = layout.problem(layout.year())
    assert problem.year.tiles.area.sum() == pytest.approx(area, rel=1e-3)
    compare_with_differences(problem)
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    best = optimum.best
    assert best.hard.window_area == pytest.approx(area, rel=1e-3)
    film = best.share[:, problem.year.materials.index("opal")]
    assert best.hard.film_area == pytest.approx(film @ problem.year.tiles.area, rel=1e-4)
    assert best.share.sum(axis=1) == pytest.approx(1, abs=1e-5)
    fresh = layout.afresh(optimum)
    _, E = problem.illuminance(problem.values(mi.Float(best.x)))
    agrees(problem.measure.groups.applied(E), fresh)
    sensor = 100 / E.open.shape[1]
    low, high = (fresh.metrics["sDA"][end] for end in ("low", "high"))
    assert low - sensor <= best.hard.aim <= high + sensor
    return best


@pytest.mark.slow
def test_panes_of_a_gbxml_building(tmp_path):
    """Film and glass share the panes, since the sun through all the glass would exceed ASE."""
    house.written(tmp_path, house.text(house.with_window_above().values()))
    best = search_of_panes(case_of(tmp_path, "house.xml", PANES.format(limit=5.0)), area=4.0)
    assert 0 < best.hard.film_area < 4
    assert best.hard.ase <= 5


@pytest.mark.slow
def test_panes_of_an_ifc_building(tmp_path):
    """The clearest glass is best where ASE has no limit."""
    skips.module("ifcopenshell")
    from tests.unit.model import ifc_building

    ifc_building.house().written(tmp_path)
    best = search_of_panes(case_of(tmp_path, "house.ifc", PANES.format(limit=100.0)), area=1.44)
    assert best.hard.film_area == pytest.approx(0, abs=0.01)
    assert best.x[-1] == pytest.approx(1)


@pytest.mark.slow
def test_new_windows_in_a_gbxml_building(run, tmp_path):
    """In the wall of 12 m² of a room that has no window."""
    house.written(tmp_path, house.text(house.with_window_above().values()))
    case_of(tmp_path, "house.xml", WALLS)
    code, _, err = run("optimise", tmp_path / "case.toml", "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    best, fresh = (
        json.loads((tmp_path / "out" / f"{name}.json").read_text())
        for name in ("optimum", "fresh_metrics")
    )
    assert 1.2 * (1 - 2e-3) <= best["window_m2"] <= 3.6 * (1 + 2e-3)
    shares = pd.DataFrame(best["composition"])
    assert shares.sum(axis=1).values == pytest.approx(1, abs=1e-4)
    assert 6 * (1 - shares["wall"]).sum() == pytest.approx(best["window_m2"], rel=1e-3)
    assert 6 * shares["opal"].sum() == pytest.approx(best["film_m2"], rel=1e-3, abs=1e-3)
    sensor = 100 / 80
    low, high = (fresh["sDA"][end] for end in ("low", "high"))
    assert low - sensor <= best["sDA"] <= high + sensor
