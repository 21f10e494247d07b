"""New windows in the walls of a model, against the same search in a room of boxes.

The room of boxes and the Honeybee model are one room, whose southern wall is cut into four tiles.
Their light by tile and fill has to agree, and so has what a search finds; windows that are really
drawn into the model are a third route, and differences the second one to gradients.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import drjit as dr
import mitsuba as mi
import numpy as np
import pandas as pd
import pytest
from drcmitsuba_plugins.patches import Patches

import drcmitsuba
from drcmitsuba.annual import attributes
from drcmitsuba.case.design import Design
from drcmitsuba.design.facade_year import FacadeYear
from drcmitsuba.design.layout import Layout
from drcmitsuba.design.model_layout import ModelLayout
from drcmitsuba.design.optimise import optimise
from drcmitsuba.glare_year import EyesOfSearch
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.scene.enabled_effects import ALL_EFFECTS
from drcmitsuba.scene.prepared_case import prepared
from drcmitsuba.scene.scene import load
from drcmitsuba.scene.tiled_walls import WallPane
from drcmitsuba.sky.daylight import daylight
from drcmitsuba.transport.coefficients import compute
from tests.differences import slopes
from tests.system.every_room import MODELS, write_models
from tests.unit.model import box_room as box

CASE = """
[period]
months = [3]
days_per_week = 1
hours = [10, 14]
[materials.glass]
type = "glazing"
transmittance = 0.65
reflectance = 0.1
[materials.opal]
type = "diffuser"
transmittance = 0.5
reflectance = 0.3
[materials.shade]
type = "diffuser"
transmittance = 0.1
[shading]
material = "shade"
[sensors]
corner = [0.0, 0.0, 0.8]
count = [4, 6]
spacing = 1.0
[metrics]
sda_threshold = 500.0
ase_hours = 4.0
[accuracy]
replicates = {replicates}
paths = {paths}
[design]
film = "opal"
clear = "glass"
parameters = "strips"
side = "south"
rows = 2
segments = 2
band = [0.8, 2.8]
wwr = [0.2, 0.4]
ase_limit = 40.0
starts = 1
sharpness = [8.0]
pareto = 0
"""
ROOM = "[room]\nsize = [4.0, 6.0, 3.0]\nfloor = 0.2\nwalls = 0.5\nceiling = 0.8\n"
FILLS = ("glass", "opal")
FINER = {"replicates": 8, "paths": 16}
SCATTER = 0.0115
"""Relative scatter of the difference of both means from seed to seed: by eight seeds of elements
0.9 %, of an evaluation 0.7 %."""
SENSOR = 100 / 24
"""Share of one sensor [%]."""
WEST = """window,material,x1,y1,z1,x2,y2,z2,x3,y3,z3,x4,y4,z4
0,glass,0,1,1,0,3,1,0,3,2,0,1,2
"""
"""Window in the western wall."""
PANE = "generic_exterior_window_vis_0.64"
MODEL = '[model]\nfiles = ["room.hbjson"]\n'


@pytest.fixture(autouse=True)
def _backend():
    backend.select()


def case_of(folder, tables, more="", replicates=2, paths=32, window=False):
    room = box.room("Room")
    if not window:
        room["faces"][1].pop("apertures")
    box.written(folder, box.model(room), "room.hbjson")
    text = CASE.format(replicates=replicates, paths=paths) + tables + more
    (folder / "case.toml").write_text(text)
    return drcmitsuba.load_case(folder / "case.toml")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Layout of the model without a window, its light and its daylight."""
    backend.select()
    layout = ModelLayout.of(case_of(tmp_path_factory.mktemp("model"), MODEL, **FINER))
    return layout, *layout.light()


def light_under_a_sky(tiled, composition, closed):
    """Replicates (replicate, sensor) of E [lx] under a sky of 4 kcd/m² and all suns."""
    C = tiled.coefficients(composition, int(closed))
    labels = [*Patches(1).labels, *(b for b in C["bin"].values if b.startswith("sun_"))]
    L = np.where(np.char.startswith(np.array(labels, str), "sun_"), 1e8, 4e3)
    return (C["replicates"].sel(bin=labels).values * L).sum(-1)


@pytest.mark.slow
def test_light_by_element_is_that_of_the_room_of_boxes(simulated, tmp_path):
    _, ours, _ = simulated
    as_box = Layout.of(case_of(tmp_path, ROOM, **FINER))
    theirs, _ = as_box.light(as_box.heights)
    assert ours.tiles.bounds == pytest.approx(theirs.tiles.bounds)
    assert ours.materials == theirs.materials[:3]
    for tile in range(4):
        for column in (1, 2):
            for closed in (False, True):
                share = np.eye(4, dtype=np.float32)[[0] * 4]
                share[tile] = np.eye(4)[column]
                a = light_under_a_sky(ours, share[:, :3], closed)
                b = light_under_a_sky(theirs, share, closed)
                n = len(a)
                z = (a.mean(0) - b.mean(0)) / np.sqrt((a.var(0) + b.var(0)) / (n - 1))
                assert np.abs(z).max() < 7  # 384 of them, t of 7 degrees
                a, b = a.mean(1), b.mean(1)
                error = np.sqrt((a.var() + b.var()) / (n - 1))
                assert abs(a.mean() - b.mean()) < 4.5 * error
                assert error < 0.03 * b.mean()  # or the line above would say little


@pytest.mark.slow
def test_light_on_outer_walls_enters_no_room_beside_them(tmp_path):
    """Walls of two rooms, 1 m apart, are tiles: closed, they are the rooms as drawn."""
    write_models(tmp_path)
    file = tmp_path / "case.toml"
    text = MODELS["Honeybee model"].replace("[period]", "[period]\nhours = [12, 13]")
    text = text.replace("replicates = 2\npaths = 16", "replicates = 4\npaths = 64")
    walls = '[design]\nfilm = "opal"\nclear = "glass"\nrows = 1\nwwr = [0.0, 0.6]\n'
    file.write_text(text + walls)
    layout = ModelLayout.of(drcmitsuba.load_case(file))
    light, sky = layout.light()
    ours = light.coefficients(layout.as_drawn(light))["interreflected"]
    world, (points, normals) = load(layout.case), prepared(layout.case).receivers.at()
    accuracy = layout.case.accuracy.model_copy(update={"seed": 99})
    theirs = compute(world, points, normals, sky.suns, accuracy)["interreflected"]
    of_sky = theirs["bin"].str.startswith("sky")
    for room in np.split(np.arange(len(points)), 2):
        mine, other = (C[room].sel(bin=of_sky).sum() for C in (ours, theirs))
        assert float(mine) == pytest.approx(float(other), rel=0.15)


@pytest.mark.slow
def test_the_search_finds_what_it_finds_in_the_room_of_boxes(tmp_path):
    problems, best = [], []
    for kind, tables in ((ModelLayout, MODEL), (Layout, ROOM)):
        layout = kind.of(case_of(tmp_path, tables, paths=128))
        problem = layout.problem(layout.year())
        problems.append(problem)
        best.append(optimise(problem, layout.search, known=layout.known(problem)).best)
    assert problems[0].goal.window_area == pytest.approx(problems[1].goal.window_area)
    assert problems[0].size == problems[1].size
    for problem in problems:  # either optimum is as good in the other's light
        a, b = (problem.evaluate(candidate.x, 8.0) for candidate in best)
        assert a.hard.value == pytest.approx(b.hard.value, abs=SENSOR + 0.1)
        assert a.hard.ase == pytest.approx(b.hard.ase, abs=SENSOR + 0.1)
        assert a.hard.window_area == pytest.approx(b.hard.window_area, rel=2e-3)
        assert a.hard.value > problem.evaluate(problem.start, 8.0).hard.value


ONE_TILE = {"rows = 2": "rows = 1", "segments = 2": "segments = 1", "[0.2, 0.4]": "[0.02, 0.6]"}
LEAST = 'objective = "area"\nsda_least = 55\n'


@pytest.mark.parametrize(
    ("kind", "tables"), [pytest.param(ModelLayout, MODEL, marks=pytest.mark.slow), (Layout, ROOM)]
)
def test_the_least_area_of_windows_is_that_of_a_sweep(tmp_path, kind, tables):
    """One tile, by its shares of window and film: the least window with which any film does."""
    case_of(tmp_path, tables)
    text = (tmp_path / "case.toml").read_text().replace("[design]\n", "[design]\n" + LEAST)
    for old, new in ONE_TILE.items():
        text = text.replace(old, new)
    (tmp_path / "case.toml").write_text(text)
    layout = kind.of(drcmitsuba.load_case(tmp_path / "case.toml"))
    problem = layout.problem(layout.year())
    assert (problem.size, problem.goal.least.of) == (2, "panes")
    best = optimise(problem, layout.search, known=layout.known(problem)).best
    assert problem.holds(best)
    step, tile = 0.04, problem.year.tiles.area.sum()
    films = np.linspace(0, 1, 11)
    for window in np.arange(0, 1 + step, step):
        shares = np.array([(1 - window, window * (1 - f), window * f) for f in films])
        scores = [problem.hard(np.pad(s[None], ((0, 0), (0, len(problem.year.materials) - 3))))
                  for s in shares]  # fmt: skip
        if any(problem.is_feasible(score) for score in scores):
            break
    assert (window - step) * tile < best.hard.window_area <= window * tile * (1 + 1e-5)
    assert 0.1 < window < 0.9


def test_shares_are_windows_that_are_drawn(simulated):
    layout, light, daylight = simulated
    compare_with_windows(layout, FacadeYear.of(light, daylight))


@pytest.mark.slow
def test_shares_are_windows_beside_one_that_is_there(tmp_path):
    layout = ModelLayout.of(case_of(tmp_path, MODEL, **FINER, window=True))
    compare_with_windows(layout, layout.year())


FREE = {"glazing_transmittance": (0.4, 0.8), "shade_vlt": (0.05, 0.3)}


def with_transmittances(layout):
    """Layout whose search sets the transmittances of clear glass and shade free."""
    return replace(layout, design=layout.design.model_copy(update=FREE))


def both_in(folder):
    """Layout of a search of new windows in the southern wall, and of the film in its window."""
    return ModelLayout.of(case_of(folder, 'panes = ["*"]\n' + MODEL, **FINER, window=True))


def test_tiles_of_walls_and_panes_have_their_areas(tmp_path):
    openings = both_in(tmp_path).openings
    tiles = openings.tiles
    assert tiles.names[-1] == f"{PANE} (south)"
    assert len(tiles) == 5
    assert tiles.area[-1] == pytest.approx(2)
    assert tiles.area.sum() == pytest.approx(4 * 2, rel=1e-5)  # the band from 0.8 to 2.8 m
    left, right = tiles.bounds[:, :2].T
    assert left[-1] == pytest.approx(right[:-1].max())
    of_pane = [names for names in openings.names if PANE in names]
    assert of_pane == [(PANE,)]


def test_panes_of_one_material_are_searched_in_one_direction(tmp_path):
    """Every opening is filled once; the western window keeps its glass."""
    room = box.room("Room")
    west = np.array([[0.0, 3, 1], [0, 1, 1], [0, 1, 2], [0, 3, 2]])
    room["faces"][4]["apertures"] = [box.element("Aperture", "West", west)]
    case_of(tmp_path, MODEL)
    box.written(tmp_path, box.model(room), "room.hbjson")
    case = drcmitsuba.load_case(tmp_path / "case.toml")
    case = case.with_tables(design=Design(film="opal", side="south"))
    openings = ModelLayout.of(case).openings
    assert [str(panes) for panes in openings.every] == [f"{PANE} (south)", f"{PANE} (west)"]
    tiled = openings.tiled((), daylight(case).sky["time"])
    names = np.array(tiled.names)
    for column, (old, film) in ((1, (2, 0)), (2, (1, 1))):
        shares = tiled.shares(np.eye(3)[[column]])
        assert (shares[names == PANE].sum(), shares[names == "opal"].sum()) == (old, film)
        assert shares.sum() == 2


@pytest.mark.slow
def test_panes_take_the_film_while_walls_get_windows(tmp_path):
    layout = both_in(tmp_path)
    problem = layout.problem(layout.year())
    assert problem.goal.window_area == pytest.approx((0.2 * 12, 0.4 * 12))
    assert [(p.key, p.count) for p in problem.free] == [("window", 4), ("film", 5)]
    for film in (0, 1):
        x = problem.of_fractions({"window": [0, 1, 1, 0], "film": [0, 0, 1, 0, film]})
        drawn = layout.built(design_of(problem, x))
        films = {PANE: drawn.materials["opal"]} if film else {}
        result = drcmitsuba.evaluate(drawn.with_tables(materials=drawn.materials | films))
        agrees(problem, x, result)
    x = np.random.default_rng(1).uniform(0.2, 0.8, problem.size)
    compare_with_differences(problem, x)
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    fresh, best = layout.afresh(optimum), optimum.best.hard
    low, high = (fresh.metrics["sDA"][end] for end in ("low", "high"))
    assert low - SENSOR <= best.aim <= high + SENSOR
    drawn = box.area_of(layout.built(optimum).building.layers)
    area = sum(value for (_, role), value in drawn.items() if role == "pane")
    assert area == pytest.approx(best.window_area, rel=2e-3)
    alone = layout.design.model_copy(update={"panes": ()})
    walls = ModelLayout.of(layout.openings.walls.drawn.with_tables(design=alone))
    assert walls.openings.panes == ()


VIEW = "[views.desk]\nposition = [2.0, 3.0, 1.2]\ndirection = [0.0, -1.0, 0.0]\n"


@pytest.mark.slow
def test_glare_of_new_windows_and_panes_with_film_is_that_of_the_model_drawn_so(tmp_path):
    limited = 'panes = ["*"]\nglare_limit = 5.0\n' + MODEL
    layout = ModelLayout.of(case_of(tmp_path, limited, VIEW, **FINER, window=True))
    problem = layout.problem(layout.year(trace_eyes=EyesOfSearch.of))
    of_films = []
    for film in (0, 1):
        x = problem.of_fractions({"window": [0, 1, 0.5, 0], "film": [0, 0, 1, 0, film]})
        drawn = layout.built(design_of(problem, x))
        films = {PANE: drawn.materials["opal"]} if film else {}
        theirs = drcmitsuba.glare(drawn.with_tables(materials=drawn.materials | films))
        ours, theirs = (
            year.hours.isel(state=-1)
            for year in (layout.glare_afresh(design_of(problem, x)), theirs)
        )
        of_films.append(ours["dgp"].values)
        error = np.hypot(ours["dgp_se"].values, theirs["dgp_se"].values)
        assert (abs(ours["dgp"].values - theirs["dgp"].values) <= 5 * error + 5e-3).all()
    assert abs(of_films[1] - of_films[0]).max() > 0.05  # or the lines above would say little


def design_of(problem, x):
    """Design x (free,) as an optimum."""
    best = problem.evaluate(x, 8.0)
    return SimpleNamespace(problem=problem, best=best, values=problem.named(x))


def agrees(problem, x, result):
    """Compare E of a design with that of a result, the shade open and applied."""
    _, E = problem.illuminance(problem.values(mi.Float(x)))
    applied = problem.measure.groups.applied(E)
    theirs = result.illuminance.transpose("time", "sensor")
    for ours, name in ((E.open.numpy(), "total_open"), (applied, "total")):
        total, error = theirs[name].values, theirs[f"{name}_se"].values
        assert (abs(ours - total) > 6 * (error + 0.01 * total + 1e-3)).mean() < 0.01, name
        assert ours.mean() == pytest.approx(total.mean(), rel=3 * SCATTER), name


def test_transmittances_are_those_of_windows_that_are_drawn(simulated):
    layout, light, daylight = simulated
    layout = with_transmittances(layout)
    problem = layout.problem(FacadeYear.of(light, daylight))
    fractions = {"glazing_transmittance": 0.0, "shade_vlt": 0.8}
    window, film = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 0])
    x = problem.of_fractions({"window": window, "film": film, **fractions})
    drawn = layout.built(design_of(problem, x))
    assert [drawn.materials[n].transmittance for n in ("glass", "opal", "shade")] == [
        pytest.approx(share) for share in (0.4, 0.5, 0.25)
    ]
    agrees(problem, x, drcmitsuba.evaluate(drawn))


def compare_with_windows(layout, year):
    """Compare a window in one tile and a film in another with an evaluation of the two."""
    problem = layout.problem(year)
    share = np.eye(3, dtype=np.float32)[[0, 1, 2, 0]]
    panes = [
        WallPane(name, tile.wall, tile.shape, tile.depth)
        for name, tile in zip(FILLS, layout.openings.walls.tiles[1:3], strict=True)
    ]
    drawn = layout.openings.walls.with_windows(layout.openings.walls.windows(panes))
    E = problem.year.illuminance(mi.TensorXf(share))
    result = drcmitsuba.evaluate(drawn)
    theirs = result.illuminance.transpose("time", "sensor")
    for ours, name in ((E.open, "total_open"), (E.direct, "direct_sun")):
        total, error = theirs[name].values, theirs[f"{name}_se"].values
        off = abs(ours.numpy() - total) > 6 * (error + 0.01 * total + 1e-3)
        assert off.mean() < 0.01, name
        assert ours.numpy().mean() == pytest.approx(total.mean(), rel=0.01), name
    low, high = (result.metrics["sDA"][end] for end in ("low", "high"))
    assert low - SENSOR <= problem.hard(share).aim <= high + SENSOR


def test_gradients_are_differences(simulated):
    """Derivatives of the mean E by shares of window and film, and by transmittances, to 0.1 %."""
    layout, light, daylight = simulated
    problem = with_transmittances(layout).problem(FacadeYear.of(light, daylight))
    x = np.random.default_rng(1).uniform(0.2, 0.8, problem.size)

    compare_with_differences(problem, x)


def compare_with_differences(problem, x):
    """Derivatives of the mean E at a design x (free,), to 0.1 %."""

    def mean(at):
        _, E = problem.illuminance(problem.values(at))
        return dr.mean(E.open.array) + dr.mean(E.shaded.array)

    free = mi.Float(x)
    dr.enable_grad(free)
    dr.backward(mean(free))
    by_differences = slopes(lambda at: mean(mi.Float(at))[0], x, 0.1)
    assert dr.grad(free).numpy() == pytest.approx(by_differences, rel=1e-3)


def test_the_command_writes_windows_that_a_case_reads(run, tmp_path, monkeypatch):
    case_of(tmp_path, MODEL)
    monkeypatch.chdir(tmp_path)
    code, out, err = run("optimise", "case.toml", "-o", "out")
    assert (code, err) == (0, "")
    assert "windows.csv: to draw the new windows into the model, lay it beside the case" in out
    optimum = json.loads((tmp_path / "out" / "optimum.json").read_text())
    fresh = json.loads((tmp_path / "out" / "fresh_metrics.json").read_text())
    table = pd.read_csv(tmp_path / "out" / "windows.csv")
    assert set(table.material) <= {"glass", "opal"}
    assert (tmp_path / "out" / "facade.png").stat().st_size > 5000
    again = case_of(tmp_path, MODEL + 'windows = "out/windows.csv"\n').with_tables(design=None)
    areas = box.area_of(again.building.layers)
    area = sum(value for (_, role), value in areas.items() if role == "pane")
    assert area == pytest.approx(optimum["window_m2"], rel=2e-3)
    assert areas["generic_wall_0.50", "surface"] == pytest.approx(60 - area, rel=1e-4)
    assert drcmitsuba.evaluate(again).metrics["sDA"] == fresh["sDA"]


@pytest.mark.parametrize(
    ("design", "message"),
    [
        ('side = "south-west"', "design.side: no outer wall faces south-west"),
        ('walls = ["brick"]', 'design.walls: none is called "brick"'),
        ('spaces = ["Hall"]', 'design.spaces: none is called "Hall"; choose from: "Room"'),
        ('wwr = "fixed"', "design.wwr: fixed: the walls would get no window"),
        ("wwr = [0.01, 0.1]", "at most 0.1, the panes as drawn take 0.167 of the walls"),
        ("wwr = [0.9, 1.0]", "a window-to-wall ratio of 0.9, the tiles have"),
        ('parameters = "window"', "design.parameters: panes and walls of a model are no one"),
        ('panes = ["door"]', "design.panes: no clear pane is meant"),
        ('clear = "generic_exterior_window_vis_0.64"\npanes = ["*"]', 'design.clear: "generic_ext'),
        ('clear = "opal"', 'design.clear: "opal" is no such material'),
        ("glazing_transmittance = [0.1, 0.95]", "glazing_transmittance: up to 0.95: 0.95 + 0.1 is"),
    ],
)
def test_what_cannot_be_searched_is_refused_in_one_line(tmp_path, design, message):
    key = design.split(" =")[0]
    case_of(tmp_path, MODEL, window=True)
    text = (tmp_path / "case.toml").read_text()
    kept = [line for line in text.splitlines() if not line.startswith(key + " =")]
    text = "\n".join(kept).replace("[design]", f"[design]\n{design}")
    (tmp_path / "case.toml").write_text(text)
    case = drcmitsuba.load_case(tmp_path / "case.toml")
    with pytest.raises(InputError) as error:
        ModelLayout.of(case)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_the_wall_around_a_window_is_a_fill_of_it(tmp_path):
    """Without its western window the room has the light of the room that never had one."""
    (tmp_path / "windows.csv").write_text(WEST)
    both = case_of(tmp_path, MODEL + 'windows = "windows.csv"\n', window=True)
    light = drcmitsuba.elements(both, fills={"west": ["wall"]})
    ours = light.evaluate({"west": "wall"}).illuminance
    theirs = drcmitsuba.evaluate(case_of(tmp_path, MODEL, window=True)).illuminance
    assert ours.total_open.mean().item() == pytest.approx(theirs.total_open.mean().item(), rel=0.02)
    assert ours.direct_sun.values == pytest.approx(theirs.direct_sun.values, abs=1.0)
    with pytest.raises(InputError, match="no fill"):
        drcmitsuba.elements(both, fills=["wal"])


def test_a_table_of_windows_counts_in_the_origin_of_a_result(tmp_path):
    marks = []
    for text in (WEST, WEST, WEST.replace("glass", "opal")):
        (tmp_path / "windows.csv").write_text(text)
        case = case_of(tmp_path, MODEL + 'windows = "windows.csv"\n')
        marks.append(attributes.fingerprint(case, ALL_EFFECTS))
    assert marks[0] == marks[1] != marks[2]


def test_a_file_that_a_models_file_calls_for_counts_in_the_origin_of_a_result(tmp_path):
    (tmp_path / "scene.rad").write_text("!xform -t 0 0 1 inner.rad\n")
    (tmp_path / "case.toml").write_text(
        '[model]\nfiles = ["scene.rad"]\nleaks = "allow"\n'
        "[sensors]\ncorner = [0.5, 0.5, 0.5]\ncount = [1, 1]\n"
    )
    marks = []
    for reflectance in (0.5, 0.5, 0.05):
        polygon = "paint polygon wall 0 0 12  0 0 0  1 0 0  1 1 0  0 1 0\n"
        paint = f"void plastic paint 0 0 5 {reflectance} {reflectance} {reflectance} 0 0\n"
        (tmp_path / "inner.rad").write_text(paint + polygon)
        case = drcmitsuba.load_case(tmp_path / "case.toml")
        marks.append(attributes.fingerprint(case, ALL_EFFECTS))
    assert marks[0] == marks[1] != marks[2]


@pytest.mark.slow
def test_one_space_may_count_alone_by_its_worst_month(tmp_path):
    """Two rooms, of which one counts and gets windows, against an evaluation of what is found."""
    rooms = box.room("Office"), box.room("Studio", shift=6.0)
    box.written(tmp_path, box.model(*rooms), "room.hbjson")
    text = CASE.format(replicates=4, paths=64) + MODEL
    grid = text[text.index("corner") : text.index("[metrics]")]
    text = text.replace(grid, 'spaces = ["*"]\nspacing = 1.0\n')
    text = text.replace("[design]", '[output]\nspaces = ["Office"]\n[design]\nspaces = ["Off*"]')
    text = text.replace("months = [3]", "months = [3, 12]")
    text = text.replace("wwr = [0.2, 0.4]", 'wwr = [0.3, 0.3]\nobjective = "worst month"')
    (tmp_path / "case.toml").write_text(text)
    layout = ModelLayout.of(drcmitsuba.load_case(tmp_path / "case.toml"))
    problem = layout.problem(layout.year())
    optimum = optimise(problem, layout.search, known=layout.known(problem))
    assert {wall.space for wall in layout.openings.walls.walls} == {"Office"}
    fresh = layout.afresh(optimum)
    sensors = fresh.illuminance.sizes["sensor"]
    months = [month for month in fresh.metrics["msDA"] if month]
    least = min(months, key=lambda month: month["value"])
    point = 100 / sensors
    assert least["low"] - point <= optimum.best.hard.aim <= least["high"] + point
    assert optimum.best.hard.window_area == pytest.approx(0.3 * 12 - 2, rel=2e-3)


BLINDS = """[groups.blinds]
panes = ["glass", "generic_exterior_window*"]
states = ["shade"]
"""


@pytest.mark.slow
@pytest.mark.parametrize("groups", ["", BLINDS])
def test_shades_and_groups_close_new_windows(tmp_path, groups):
    """A western window and film, beside the southern window, close as the drawn ones do."""
    case_of(tmp_path, MODEL, groups, replicates=6, paths=32, window=True)
    text = (tmp_path / "case.toml").read_text().replace('side = "south"', 'side = "west"')
    if groups:
        text = text.replace('[shading]\nmaterial = "shade"\n', "")
    (tmp_path / "case.toml").write_text(text)
    layout = ModelLayout.of(drcmitsuba.load_case(tmp_path / "case.toml"))
    problem = layout.problem(layout.year())
    walls = layout.openings.walls
    assert len(problem.year.groups.rule.groups) == (1 if groups else 2)
    share = mi.TensorXf(np.eye(3, dtype=np.float32)[[0, 1, 2, 0]])
    panes = [WallPane(n, t.wall, t.shape) for n, t in zip(FILLS, walls.tiles[1:3], strict=True)]
    ours = problem.measure.groups.applied(problem.year.illuminance(share))
    result = drcmitsuba.evaluate(walls.with_windows(walls.windows(panes)))
    theirs = result.illuminance[["total", "total_se"]].transpose("time", "sensor")
    total, error = theirs.total.values, theirs.total_se.values
    assert 0 < result.metrics["shade_closed"]["value"] < 100
    assert (abs(ours - total) > 6 * (error + 0.01 * total)).mean() < 0.02
    assert ours.mean() == pytest.approx(total.mean(), rel=0.01)
