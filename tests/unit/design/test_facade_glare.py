"""Hours of glare in a search: against façades that are drawn so, and gradients by differences."""

from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pytest

import drcmitsuba
from drcmitsuba import InputError
from drcmitsuba.design.layout import Layout
from drcmitsuba.glare_year import EyesOfSearch
from drcmitsuba.glare_year.searched_eyes import worst_view
from drcmitsuba.runtime import backend
from tests.fast import slowly

CASE = """
name = "room"
[period]
timestamps = "times.csv"
[room]
size = [2.8, 4.0, 3.0]
[facade.south]
strips = [{ bottom = 0.9, top = 2.7, material = "glass" }]
[materials.glass]
type = "glazing"
transmittance = 0.65
[materials.opal]
type = "diffuser"
transmittance = 0.3
[materials.shade]
type = "diffuser"
transmittance = 0.05
[sensors]
corner = [0.2, 0.2, 0.8]
count = [4, 6]
spacing = 0.6
[shading]
material = "shade"
[views.desk]
position = [1.4, 2.5, 1.2]
direction = [1, -1, 0]
[views.window]
position = [1.4, 2.5, 1.2]
direction = [0, -1, 0]
[accuracy]
paths = 64
cell_sky_rays = 32
sensor_sky_rays = 256
replicates = 4
"""
DESIGN = """
[design]
film = "opal"
sharpness = [8.0]
iterations = 4
ase_limit = 100.0
pareto = 0
parameters = "strips"
rows = 2
segments = 1
glazing_transmittance = [0.5, 0.8]
"""
DAYS = ("01-04", "03-18", "06-04", "09-18")
HOURS = [f"2015-{day}T{hour:02d}:30" for day in DAYS for hour in (9, 12, 15)]
SHARPNESS = 8.0
STEP = 0.02


CORNER = CASE.replace("size = [2.8, 4.0, 3.0]", "size = [5.0, 6.0, 3.0]").replace(
    "[1.4, 2.5, 1.2]", "[2.5, 2.0, 1.2]"
).replace("[materials.glass]", """[facade.east]
strips = [{ bottom = 0.9, top = 2.1, material = "glass" }]
[materials.glass]""")  # fmt: skip


def case_in(folder, design, text=CASE):
    (folder / "times.csv").write_text("time\n" + "\n".join(HOURS) + "\n")
    (folder / "case.toml").write_text(text + DESIGN + design)
    return folder / "case.toml"


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """Layout and problem of a room whose hours of glare are limited."""
    backend.select()
    file = case_in(tmp_path_factory.mktemp("room"), "glare_limit = 5.0\n")
    layout = Layout.of(drcmitsuba.load_case(file))
    return layout, layout.problem(layout.year(trace_eyes=EyesOfSearch.of))


def drawn(layout, problem, x):
    """Case of a design, with strips of one material each."""
    best = problem.evaluate(np.array(x, float), SHARPNESS)
    found = SimpleNamespace(problem=problem, best=best, values=problem.named(best.x))
    return layout.built(found), best


@pytest.mark.parametrize("x", slowly([(0, 0), (0, 1)], (0, 0)))
def test_tiles_of_one_material_have_the_glare_of_a_façade_that_is_drawn_so(searched, x):
    layout, problem = searched
    glass = (0.65 - 0.5) / 0.3
    case, found = drawn(layout, problem, [*x, glass])
    theirs = drcmitsuba.glare(case)
    year, share = problem.year, mi.TensorXf(found.share.astype(np.float32))
    states = year.eyes.dgp(*year.weights(share), None)
    for mine, state in zip(states, ("open", "shaded"), strict=True):
        dgp = theirs.hours.sel(state=state)
        apart = np.clip(mine.numpy(), 0, 1) - dgp["dgp"].values
        # Sources at the edges of tiles join in one of the two; the search has one replicate.
        assert np.abs(apart).max() < 0.02 + 6 * dgp["dgp_se"].values.max()
        assert abs(apart.mean()) < 0.006
    view, share_of_hours = worst_view(theirs)
    assert view in ("desk", "window")
    hour = 100 / len(HOURS)
    assert abs(found.hard.glare - float(share_of_hours["value"])) <= 1.5 * hour


def test_windows_that_meet_in_a_corner_are_one_source(tmp_path):
    """One view looks into the corner, one past it: by tiles alone DGP is off by 0.005 there."""
    file = case_in(tmp_path, 'glare_limit = 5.0\nside = "south"\n', CORNER)
    layout = Layout.of(drcmitsuba.load_case(file))
    year = layout.year(trace_eyes=EyesOfSearch.of)
    case, found = drawn(layout, layout.problem(year), [0, 0, 0.5])
    assert [joined.view for joined in year.eyes.joined] == [0, 1]
    for joined in year.eyes.joined:  # two tiles, the window to the east; fabrics are surfaces
        assert joined.near.all()
        assert len(joined.elements) == 3
    theirs = drcmitsuba.glare(case).hours.sel(state="open")
    mine, *_ = year.eyes.dgp(*year.weights(mi.TensorXf(found.share.astype(np.float32))), None)
    bright = theirs["illuminance"].values.min(axis=1) > 300
    apart = (mine.numpy() - theirs["dgp"].values)[bright]
    assert len(apart) > 5
    assert (abs(np.median(apart, axis=0)) < 0.003).all()


def test_windows_with_wall_between_them_are_sources_of_their_own(tmp_path):
    """The wall in the middle has the best place: one source of both would be dazzling there."""
    strip = 'strips = [{ bottom = 0.9, top = 2.7, material = "glass"'
    wide = CASE.replace("[2.8, 4.0, 3.0]", "[9.0, 6.0, 3.0]").replace("1.4, 2.5", "4.5, 2.2")
    (tmp_path / "searched").mkdir()
    file = case_in(tmp_path / "searched", "glare_limit = 5.0\n", wide)
    file.write_text(file.read_text().replace("rows = 2\nsegments = 1", "rows = 1\nsegments = 3"))
    year = Layout.of(drcmitsuba.load_case(file)).year(trace_eyes=EyesOfSearch.of)
    apart = case_in(tmp_path, "", wide.replace(strip, f"segments = 3\n{strip}, segments = [0, 2]"))
    apart.write_text(apart.read_text().replace(DESIGN, ""))
    theirs = drcmitsuba.glare(drcmitsuba.load_case(apart)).hours.sel(state="open")
    share = np.zeros((3, len(year.materials)), np.float32)
    share[[0, 1, 2], [year.materials.index(name) for name in ("glass", "wall", "glass")]] = 1
    mine, *_ = year.eyes.dgp(*year.weights(mi.TensorXf(share)), None)
    difference = np.clip(mine.numpy(), 0, 1) - theirs["dgp"].values
    assert (abs(np.median(difference, axis=0)) < 0.003).all()


def test_gradients_of_the_hours_of_glare_are_those_of_differences(searched):
    """By the shares of both tiles, and by the transmittance of the glass."""
    _, problem = searched
    assert [p.key for p in problem.free] == ["film", "glazing_transmittance"]
    at = np.array([0.3, 0.6, 0.5])
    gradient = problem.evaluate(at, SHARPNESS).glare_gradient
    for i, ahead in enumerate(STEP * np.eye(3)):
        four = [problem.evaluate(at + k * ahead, SHARPNESS).smooth.glare for k in (-2, -1, 1, 2)]
        slope = (four[0] - 8 * four[1] + 8 * four[2] - four[3]) / (12 * STEP)
        assert gradient[i] == pytest.approx(slope, rel=1e-3)


def test_some_hours_are_as_bright_as_among_all(searched):
    _, problem = searched
    eyes, hours = problem.year.eyes, np.array([1, 2, 5, 6, 10])
    some = eyes.at(hours)
    assert any(len(np.unique(each.at.numpy())) > len(hours) for each in eyes.surfaces)
    np.testing.assert_array_equal(some.counted, eyes.counted[hours])
    values = problem.values(mi.Float([0.3, 0.8, 0.6]))
    weights = problem.year.weights(problem.facade.share(values), problem.scale(values))
    for sharpness in (None, SHARPNESS):
        whole, part = (each.dgp(*weights, sharpness) for each in (eyes, some))
        for a, b in zip(whole, part, strict=True):
            np.testing.assert_allclose(b.numpy(), a.numpy()[hours], rtol=1e-4)


def test_smooth_hours_tend_to_the_counted_ones(searched):
    _, problem = searched
    candidates = [problem.evaluate(np.array([0.4, 0.4, 0.5]), k) for k in (8.0, 2000.0)]
    apart = [abs(c.smooth.glare - c.hard.glare) for c in candidates]
    assert apart[1] < 0.5 < apart[0]


def test_a_limit_of_glare_ranks_designs_as_one_of_ase_does(searched):
    _, problem = searched
    glass, both = (problem.evaluate(np.array([x, x, 0.5]), SHARPNESS) for x in (1.0, 0.4))
    few, many = sorted((glass, both), key=lambda c: c.hard.glare)
    assert few.hard.glare < many.hard.glare
    limit = problem.goal.glare_limit
    assert limit == 5.0
    assert problem.glare_excess(many.hard) == pytest.approx(max(many.hard.glare - limit, 0))
    assert problem.holds(many) == (many.hard.glare <= limit)
    if not problem.holds(many):
        assert problem.merit(few) > problem.merit(many)
    assert problem.numbers(many)["glare"] == many.hard.glare


def test_a_search_without_an_eye_is_refused_before_any_light_is_traced(tmp_path, monkeypatch):
    def trace(*_, **__):
        raise AssertionError

    monkeypatch.setattr("drcmitsuba.design.layout.light_of_channels", trace)
    file = case_in(tmp_path, 'objective = "glare"\n')
    text, start = file.read_text(), "[views.desk]"
    file.write_text(text[: text.index(start)] + text[text.index("[accuracy]") :])
    with pytest.raises(InputError, match="views: no view; add a table"):
        Layout.of(drcmitsuba.load_case(file)).year(trace_eyes=EyesOfSearch.of)


def test_a_search_without_a_way_to_trace_eyes_says_so(searched):
    with pytest.raises(InputError, match="design: trace_eyes: hours of glare without"):
        searched[0].year()


@pytest.mark.parametrize("key", ['objective = "glare"', "glare_limit = 5.0"])
def test_tilts_know_no_glare(tmp_path, key):
    file = tmp_path / "case.toml"
    (tmp_path / "times.csv").write_text("time\n" + "\n".join(HOURS) + "\n")
    file.write_text(CASE + f'[design]\ncomponent = "lamellae"\n{key}\n')
    with pytest.raises(InputError, match=r"leave it out|by sDA or msDA alone"):
        drcmitsuba.load_case(file)
