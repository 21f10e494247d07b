"""The least area that reaches a level of a standard, or the best margin of it: sweeps, verdicts."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import drcmitsuba
from drcmitsuba import InputError
from drcmitsuba.cli.optimise import _compared
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.runtime import backend
from drcmitsuba.standards import Evidence, verdict
from tests.differences import slopes
from tests.system.every_room import MODELS, write_models

BOX = """
name = "room"
[period]
{period}
[room]
size = [2.8, 4.0, 3.0]
[facade.south]
strips = [{{ bottom = 0.9, top = 2.7, material = "glass" }}]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.opal]
type = "diffuser"
transmittance = 0.3
[sensors]
corner = [0.2, 0.2, 0.8]
count = [4, 6]
spacing = {spacing}
[accuracy]
paths = 16
cell_sky_rays = 8
sensor_sky_rays = 32
replicates = 2
[design]
film = "opal"
sharpness = [8.0]
iterations = 5
ase_limit = 100.0
pareto = 0
"""
YEAR = 'calendar = "LM-83"'
ONE_TILE = 'parameters = "strips"\nrows = 1\nsegments = 1\n'
WINDOW = "wwr = [0.0, 0.9]\nband = [0.9, 2.9]\n" + ONE_TILE
AREA = 'objective = "area"\nstandard = "well-l01"\n'
LEED = AREA.replace("well-l01", "leed-v4.1") + 'level = "3 points"\n'
LM83 = AREA.replace("well-l01", "lm-83-12") + 'level = "preferred"\n'
STEP = 0.02


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def write(folder, design, period=YEAR, spacing=0.6):
    file = folder / "case.toml"
    file.write_text(BOX.format(period=period, spacing=spacing) + design)
    return file


@pytest.mark.slow
def test_the_least_window_is_that_of_a_sweep(run, tmp_path):
    file = write(tmp_path, AREA + WINDOW)
    layout = Layout.of(drcmitsuba.load_case(file))
    problem = layout.problem(layout.year())
    assert [p.key for p in problem.free] == ["window", "film"]
    windows = np.arange(0, 0.4, STEP)
    scores = [problem.evaluate(np.array([w, 0.0]), 8.0).hard for w in windows]
    least = next(w for w, s in zip(windows, scores, strict=True) if s.margin >= 0)
    assert STEP < least < 0.25
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    best = optimum.best
    tile = problem.year.tiles.area.sum()
    assert best.hard.margin >= 0
    assert (least - STEP) * tile < best.hard.window_area <= least * tile * (1 + 1e-5)
    # The smooth margin that the search follows, against differences.
    at = np.array([0.1, 0.3])
    theirs = slopes(lambda x: problem.evaluate(x, 8.0).smooth.aim, at, np.array([0.004, 0.02]))
    assert problem.evaluate(at, 8.0).aim_gradient == pytest.approx(theirs, rel=1e-3)
    _is_judged_as_by_comply(layout, optimum, run, tmp_path)


def _is_judged_as_by_comply(layout, optimum, run, folder):
    """The verdict on the optimum is that of `comply` on a case file with its strips."""
    mine = verdict("well-l01", Evidence.of_result(layout.afresh(optimum))).levels[0]
    strips = ", ".join(
        f'{{ bottom = {s.bottom!r}, top = {s.top!r}, material = "{s.material}" }}'
        for s in layout.built(optimum).facade["south"].strips
    )
    text = BOX.split("[design]")[0].format(period=YEAR, spacing=0.6)
    file = folder / "found.toml"
    file.write_text(re.sub(r"strips = \[.*\]", f"strips = [{strips}]", text))
    code, _, err = run("comply", file, "--standard", "well-l01", "-o", folder / "judged")
    assert (code, err) == (0, "")
    [judged] = json.loads((folder / "judged" / "compliance.json").read_text())["standards"]
    [theirs] = judged["levels"]
    assert (theirs["reached"], theirs["probability"]) == (mine.reached, mine.probability)
    assert theirs["margin"]["value"] == pytest.approx(mine.margin.value)


@pytest.mark.slow
def test_the_command_says_whether_the_level_is_reached_afresh(run, tmp_path):
    file = write(tmp_path, 'objective = "standard"\nstandard = "lm-83-12"\n')
    code, out, err = run("optimise", file, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    assert "margin of the standard" in out
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    assert optimum["value"] == pytest.approx(optimum["margin"])
    assert optimum["margin"] > 5
    assert "nominally accepted: reached afresh, probability " in out


@pytest.mark.slow
def test_the_optimum_is_no_worse_than_its_own_front(run, tmp_path):
    file = write(tmp_path, LM83 + WINDOW)
    file.write_text(file.read_text().replace("ase_limit = 100.0\npareto = 0", "pareto = 5"))
    code, out, err = run("optimise", file, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    front = pd.read_csv(tmp_path / "out" / "pareto.csv")
    assert optimum["feasible"]
    assert optimum["window_m2"] <= front.window_m2[front.ASE <= 10].min() + 1e-5  # as it is written
    assert optimum["window_m2"] < 1.3  # of starts by all hours one ended in 1.43 m²
    assert "preferred: reached afresh" in out  # its strip lies in the middle of its tile


def fresh_with(**values):
    return SimpleNamespace(metrics={name: {"value": value} for name, value in values.items()})


def test_a_least_area_that_fails_afresh_names_the_tiles_that_were_cut():
    goal = SimpleNamespace(requirement=None, least=SimpleNamespace(aim=75.0), ase_limit=10.0)
    problem = SimpleNamespace(goal=goal)
    best = SimpleNamespace(mixed=1, hard=SimpleNamespace(aim=75.4, ase=9.0))
    optimum = SimpleNamespace(problem=problem, best=best)
    lines = {
        (sda, ase): [*_compared(optimum, "", fresh_with(sDA=sda, ASE=ase), True)]
        for sda, ase in ((74.0, 9.0), (76.0, 9.0), (76.0, 10.1))
    }
    assert lines[76.0, 9.0] == []
    (line,) = lines[74.0, 9.0]
    assert lines[76.0, 10.1] == ["ASE is 10.1 % afresh, above its limit of 10 %", line]
    assert "within a tile, and 1 tile was cut in height afresh; give more rows" in line


@pytest.mark.slow
def test_the_command_tells_a_level_that_is_out_of_reach(run, tmp_path):
    unreached = write(tmp_path, LEED + WINDOW.replace("0.9]", "0.03]", 1))
    code, out, err = run("optimise", unreached, "-o", tmp_path / "out")
    assert (code, err) == (0, "")
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    assert not optimum["feasible"]
    assert "3 points is not reached: by the best that holds the other limits, its least" in out
    assert "3 points: not reached afresh, probability " in out


@pytest.mark.slow
def test_the_least_film_of_a_model_is_that_of_a_sweep(tmp_path):
    write_models(tmp_path)
    text = MODELS["mesh"].replace("months = [3]\ndays_per_week = 1\n", f"{YEAR}\n")
    text = text.replace("spacing = 1.4", "spacing = 0.6")
    file = tmp_path / "case.toml"
    design = 'film = "opal"\nase_limit = 100.0\npareto = 0\nsharpness = [8.0]\npanes = ["*_2"]\n'
    file.write_text(f"{text}[design]\n{design}{LEED}".replace("3 points", "2 points"))
    layout = ModelLayout.of(drcmitsuba.load_case(file))
    problem = layout.problem(layout.year())
    films = np.arange(0, 1 + STEP / 2, STEP)
    margins = [problem.evaluate(np.array([film]), 8.0).hard.margin for film in films]
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    least = films[np.argmax(np.array(margins) >= 0)]
    assert STEP < least < 0.9
    film = optimum.best.hard.film_area / problem.year.tiles.area.sum()
    assert least - STEP < film <= least * (1 + 1e-5)


BAD = {
    "an unknown standard": ('objective = "area"\nstandard = "leed"\n', '"leed" is no standard'),
    "an unknown level": (AREA + 'level = "gold"\n', 'design.level: "gold" is no level of'),
    "a level alone": ('level = "gold"\n', "level: no standard is named"),
    "another objective": ('standard = "well-l01"\n', "standard: the objective is sDA"),
    "two conditions": (AREA + "sda_least = 50\n", "sda_least: a standard is asked for, too"),
    "no standard": ('objective = "standard"\n', "standard: the objective is the margin"),
    "moments": (
        'objective = "area"\nstandard = "leed-v4.1-option-2"\n', "counts moments of clear days",
    ),
    "no levels": ('objective = "area"\nstandard = "lm-83-23"\n', "no level that a search can"),
}  # fmt: skip


@pytest.mark.parametrize(("design", "words"), BAD.values(), ids=BAD)
def test_what_cannot_be_asked_is_one_line(refused, tmp_path, design, words):
    assert words in refused("optimise", write(tmp_path, design), "-o", tmp_path / "out")


def test_another_period_or_too_coarse_a_grid_is_refused_before_any_light_is_traced(
    tmp_path, monkeypatch
):
    def trace(*_, **__):
        raise AssertionError

    monkeypatch.setattr("drcmitsuba.design.layout.light_of_channels", trace)
    short = write(tmp_path, AREA, period="months = [3]")
    with pytest.raises(InputError, match=r"period: .* of 3650 h from 8 to 18 h; evaluate with"):
        Layout.of(drcmitsuba.load_case(short)).year()
    with pytest.raises(InputError, match=r"sensors: 0\.65 m between points; give at most 0\.6"):
        Layout.of(drcmitsuba.load_case(write(tmp_path, LEED, spacing=0.65))).year()
