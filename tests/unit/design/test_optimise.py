"""The search on a year by formula: known optima, constraints, history, and what becomes of it."""

import json
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import mitsuba as mi
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.design import gradient_search, pictures
from drcmitsuba.design.facade_maps import Panes, Strips, Window
from drcmitsuba.design.goal import Goal, LeastArea
from drcmitsuba.design.measure import HARD
from drcmitsuba.design.optimise import Search, optimise, pareto
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.problem import HOURS, FacadeProblem
from drcmitsuba.design.search import History, Optimum
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime import backend
from tests.fast import slowly
from tests.synthetic_year import MATERIALS, SyntheticYear, Tiles

RULES = Rules(Metrics(sda_threshold=300.0, ase_hours=10.0), 1000.0, 0.02, 1.0)
WALL = 8.8 * 3.6
ONE_SENSOR = 100 / 24


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.fixture(scope="module")
def year():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return SyntheticYear(Tiles.grid(6, 6), time=120, grid=(4, 6))


def by_window(year, **goal):
    panes = Panes(year.tiles, year.materials, "glass", "film")
    dwr, position = (Parameter(k, 0.0, 1.0, 0.5) for k in ("dwr", "position"))
    fixed = Parameter.fixed("sill", 0.9), Parameter.fixed("wwr", 0.5)
    facade = Window(panes, WALL, *fixed, dwr, position)
    return FacadeProblem(year, facade, Goal(RULES, "film", film_cost=5.0, **goal))


def by_strips(year, window=None, **goal):
    panes = Panes(year.tiles, year.materials, "glass", "film")
    window = window or Parameter.fixed("window", 1.0)
    facade = Strips(panes, window, Parameter("film", 0.0, 1.0, 0.5, panes.count))
    return FacadeProblem(year, facade, Goal(RULES, "film", film_cost=5.0, **goal))


def named(year, **rows):
    """Compositions with glass everywhere but film in some rows of six."""
    shares = {}
    for name, film in rows.items():
        shares[name] = np.zeros((36, 4))
        shares[name][:, 1] = 1
        for row in film:
            shares[name][6 * row : 6 * row + 6, 1:3] = 0, 1
    return shares


VARIANTS = {"existing": [], "o1": [3, 4, 5], "o2": [0, 1, 2], "o3": [2, 3], "all": range(6)}


@pytest.fixture(scope="module")
def sweep(year):
    """Hard numbers of 496 windows, over the film's part and its position."""
    problem = by_window(year)
    ratios = [
        (dwr, position) for dwr in np.linspace(0, 1, 31) for position in np.linspace(0, 1, 16)
    ]
    shares = (problem.facade.share(problem.values(mi.Float(np.float32(x)))) for x in ratios)
    return [problem.hard(share.numpy()) for share in shares]


@pytest.mark.parametrize("limit", slowly([10.0, 60.0], 60.0))
def test_the_search_finds_what_a_sweep_finds(year, sweep, limit):
    problem = by_window(year, ase_limit=limit)
    best = max(score.value for score in sweep if problem.is_feasible(score))
    optimum = optimise(problem, Search(starts=2))
    assert optimum.finished
    assert optimum.is_feasible
    # A local search: over four seeds, two and three starts it ended −0.2 to 0.8 below the sweep.
    assert best - ONE_SENSOR / 4 <= optimum.best.hard.value <= best + ONE_SENSOR
    assert optimum.evaluations < len(sweep)


@pytest.mark.slow
def test_36_tiles_of_their_own_beat_every_named_composition(year):
    """Each under the ASE of the named one, in fewer than 120 evaluations; 3**36 have whole tiles.

    At 700 lx, so that no sDA is full.
    """
    problem = by_strips(year)
    bright = replace(RULES, metrics=Metrics(sda_threshold=700.0, ase_hours=10.0))
    gain = {}
    for name, share in named(year, **VARIANTS).items():
        score = replace(problem, goal=replace(problem.goal, rules=bright)).hard(share)
        goal = replace(problem.goal, rules=bright, ase_limit=score.ase)
        optimum = optimise(replace(problem, goal=goal), Search(starts=1, iterations=12))
        assert optimum.best.hard.ase <= score.ase
        assert optimum.evaluations < 120
        gain[name] = optimum.best.hard.value - score.value
    assert gain.pop("all") >= 0  # film everywhere is all that has no sun
    assert min(gain.values()) > 5


def test_the_least_windows_are_less_than_all_of_whole_tiles():
    """Four tiles that are wall, glass or film: 81 façades, of which some do."""
    year = SyntheticYear(Tiles.grid(2, 2), time=60, grid=(4, 6))
    window = Parameter("window", 0.0, 1.0, 0.5, 4)
    problem = by_strips(year, window, ase_limit=40.0, least=LeastArea("panes", 50.0))
    tiles = product(np.eye(4)[:3], repeat=4)
    scores = [score for share in tiles if problem.is_feasible(score := problem.hard(share))]
    assert 2 < len(scores) < 80
    best = optimise(problem, Search(starts=1, sharpness=(8.0, 16.0)), known=[np.ones(8)]).best
    assert problem.holds(best)
    assert best.hard.value > max(score.value for score in scores) + 1
    for tile in range(4):  # each is needed as it is
        for part in (0.0, 0.98):
            share = best.share.copy()
            share[tile, 1:3] *= part
            share[tile, 0] = 1 - share[tile, 1:3].sum()
            less = problem.hard(share)
            assert not (problem.is_feasible(less) and less.value > best.hard.value + 0.01)


def test_the_front_of_the_least_area_has_no_facade_below_the_least_sda(year):
    problem = by_window(year, ase_limit=60.0, least=LeastArea("film", 60.0))
    search = Search(starts=1, sharpness=(8.0,), iterations=6)
    front = pareto(optimise(problem, search), [30.0, 60.0], search)
    assert front.points
    assert min(point.hard.aim for point in front.points) >= 60


def test_a_better_point_of_the_front_is_where_the_search_goes_on():
    """From an optimum of windows all over, which a search of few steps may well end in."""
    year = SyntheticYear(Tiles.grid(2, 2), time=60, grid=(4, 6))
    window = Parameter("window", 0.0, 1.0, 0.5, 4)
    problem = by_strips(year, window, ase_limit=40.0, least=LeastArea("panes", 50.0))
    stuck = Optimum.of(History(problem), [lambda h, _: h.evaluate(np.ones(8), "stuck", 8.0)], float)
    assert stuck.is_feasible
    search = Search(starts=1, sharpness=(8.0,), iterations=6)
    front = pareto(stuck, [40.0, 60.0], search)
    within = [p.hard.value for p in front.points if p.hard.ase <= 40.0]
    assert front.optimum.is_feasible
    assert front.optimum.best.hard.value >= max(within) > stuck.best.hard.value
    labels = [step.label for step in front.history]
    assert labels[-1] == "least area"
    start = labels.index("from the front")
    assert front.optimum.best in front.history.candidates[start:]
    assert np.diff([step.seconds for step in front.history]).min() >= 0


@pytest.fixture(scope="module")
def long_year():
    """1,440 time stamps, ten a day, of which a search takes a third."""
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return SyntheticYear(Tiles.grid(3, 3), time=1440, grid=(4, 6))


LONG = replace(RULES, metrics=Metrics(sda_threshold=300.0, ase_hours=120.0))


def test_few_hours_are_near_all(long_year):
    problem = by_strips(long_year, Parameter.fixed("window", 1.0))
    problem = replace(problem, goal=replace(problem.goal, rules=LONG))
    few = problem.in_few_hours
    hours = few.year.hours
    assert len(np.unique(hours)) == len(few.year.months) == HOURS
    assert np.bincount(few.year.months)[1:] == pytest.approx(HOURS / 12, abs=1)
    assert few.year.step_hours == few.goal.rules.step_hours == 3
    for x in np.random.default_rng(2).random((6, problem.size)):
        a, b = (each.evaluate(x, 8.0) for each in (problem, few))
        # Suns are drawn hour by hour: a third of them scatters by one point and a half.
        assert b.smooth.value == pytest.approx(a.smooth.value, abs=4)
        assert b.smooth.ase == pytest.approx(a.smooth.ase, abs=4)
    short = by_strips(SyntheticYear(Tiles.grid(2, 2), time=60, grid=(4, 6)))
    assert short.in_few_hours is short


@pytest.mark.parametrize("count", [960, 1440, 1830, 2610, 3624, 4392, 8760])
@pytest.mark.parametrize("daily", [8, 10, 24])
def test_few_hours_are_of_all_times_of_day_and_year(count, daily):
    problem = by_strips(SyntheticYear(Tiles.grid(1, 1), time=count, grid=(1, 1)))
    hours = problem.few_hours
    assert (np.diff(hours) > 0).all()
    assert len(hours) == HOURS
    assert np.diff(hours).max() <= 2 * count / HOURS
    expected = HOURS / daily  # each of them scatters by the root of this
    assert np.bincount(hours % daily, minlength=daily) == pytest.approx(
        expected, abs=4 * expected**0.5
    )


def test_a_stage_ends_at_the_point_that_slsqp_accepts(long_year, monkeypatch):
    """Not at one of its trials; after too many evaluations, at the best of them that holds."""
    goal = Goal(LONG, "film", film_cost=20.0, ase_limit=20.0)
    problem = replace(by_strips(long_year), goal=goal)
    start, ends, stop = np.linspace(0.2, 0.8, problem.size), [], gradient_search.minimize

    def kept(*args, **options):
        ends.append(stop(*args, **options).x)
        return SimpleNamespace(x=ends[-1])

    monkeypatch.setattr(gradient_search, "minimize", kept)
    of_stage = History(problem), "", 20.0, problem.in_few_hours
    x = gradient_search._stage(*of_stage, 12, start, 8.0)
    np.testing.assert_array_equal(x, np.clip(ends[-1], 0, 1))
    monkeypatch.setattr(gradient_search, "EVALUATIONS", 0.25)
    x = gradient_search._stage(*of_stage, 12, start, 8.0)
    few = problem.in_few_hours
    begin, end = (few.evaluate(at, 8.0).smooth for at in (start, x))
    assert len(ends) == 1
    assert end.ase < begin.ase or end.value > begin.value


@pytest.mark.parametrize("by", slowly(["strips", "window"], "strips", "window"))
def test_a_search_by_few_hours_ends_where_one_by_all_does(long_year, by):
    problem = {"strips": by_strips, "window": by_window}[by](long_year, ase_limit=30.0)
    problem = replace(problem, goal=replace(problem.goal, rules=LONG))
    search = Search(starts=1, iterations=12)
    optimum = optimise(problem, search)
    whole = replace(problem)
    whole.__dict__["in_few_hours"] = whole  # all hours at every step
    slow = optimise(whole, search)
    assert optimum.is_feasible
    assert slow.is_feasible
    assert optimum.best.hard.value >= slow.best.hard.value - ONE_SENSOR / 4
    assert optimum.evaluations < slow.evaluations / 2
    again = problem.evaluate(optimum.best.x, 32.0)  # all that is kept is by all hours
    assert again.hard.value == optimum.best.hard.value
    front = pareto(optimum, [10.0, 60.0], search)
    within = [max(p.hard.value for p in front.points if p.hard.ase <= at) for at in (10, 30, 60)]
    assert within == sorted(within)
    assert within[1] >= optimum.best.hard.value


def test_what_is_known_is_never_lost(year):
    problem = by_strips(year, ase_limit=62.5)
    o3 = named(year, o3=VARIANTS["o3"])["o3"]
    optimum = optimise(problem, Search(starts=1, sharpness=(8.0,), iterations=3), known=[o3[:, 2]])
    assert optimum.best.hard.value >= problem.hard(o3).value - 1e-3


def test_the_window_keeps_its_area_and_a_range_its_bounds(year):
    window = Parameter("window", 0.0, 1.0, 0.5, 36)
    for area in ((6.0, 6.0), (4.0, 7.0)):
        problem = by_strips(year, window, ase_limit=20.0, window_area=area)
        optimum = optimise(problem, Search(starts=1, iterations=12, sharpness=(8.0, 16.0)))
        assert optimum.is_feasible
        got = optimum.problem.year.tiles.area @ (1 - optimum.best.share[:, 0])
        assert area[0] * 0.998 <= got <= area[1] * 1.002


def test_the_reported_number_is_that_of_the_metrics_at_the_composition(year):
    optimum = optimise(by_window(year, ase_limit=30.0), Search(starts=1, sharpness=(8.0,)))
    again = optimum.problem.hard(optimum.best.share)
    assert again.ase == optimum.best.hard.ase
    assert again.value == pytest.approx(optimum.best.hard.value, abs=1e-3)
    assert optimum.to_dict()["value"] == optimum.best.hard.value


def test_hard_numbers_alone_are_those_beside_smooth_ones(year, tmp_path):
    """A sweep needs no slopes; what was not computed is neither ranked nor written."""
    problem, x = by_window(year), np.array([0.4, 0.7])
    alone, both = problem.evaluate(x, HARD), problem.evaluate(x, 16.0)
    assert alone.hard == both.hard
    np.testing.assert_array_equal(alone.share, both.share)
    assert np.isnan(alone.smooth.value)
    assert problem.merit(both) > problem.merit(alone)
    history = History(problem)
    history.evaluate(x, "sweep", HARD)
    Optimum(problem, history.best(), history, True).save(tmp_path)
    numbers = json.loads((tmp_path / "optimum.json").read_text())
    assert numbers["value"] == pytest.approx(both.hard.value)
    assert not any(name.startswith("smooth") for name in numbers)
    assert pd.read_csv(tmp_path / "history.csv")["smooth_value"].isna().all()


@pytest.mark.slow
def test_the_worst_month_is_an_aim_of_its_own(year):
    problem = by_window(year, aim="worst month", ase_limit=60.0)
    optimum = optimise(problem, Search(starts=2))
    start = problem.evaluate(problem.start, 8.0)
    assert optimum.best.hard.aim <= by_window(year).hard(optimum.best.share).aim  # of the year
    assert optimum.best.hard.value >= start.hard.value


def test_a_limit_that_nothing_holds_is_refused(year):
    narrow = by_window(year, ase_limit=0.0)
    facade = replace(narrow.facade, dwr=Parameter("dwr", 0.0, 0.4, 0.2))
    search = Search(starts=1, sharpness=(8.0,), iterations=6)
    optimum = optimise(replace(narrow, facade=facade), search)
    assert not optimum.is_feasible
    assert optimum.best.hard.ase == min(c.hard.ase for c in optimum.history.candidates)


def test_the_same_seed_gives_the_same_history(year):
    search = Search(starts=2, sharpness=(8.0,), iterations=5, seed=5)
    problem = by_strips(year, ase_limit=30.0)
    first, second = (optimise(problem, search).history.frame for _ in range(2))
    pd.testing.assert_frame_equal(first.drop(columns="seconds"), second.drop(columns="seconds"))
    other = optimise(problem, replace(search, seed=6)).history.frame
    assert not other["film_0"].equals(first["film_0"])


def test_progress_rises_to_one(year):
    shares = []
    optimise(by_window(year), Search(starts=2, sharpness=(8.0, 16.0)), shares.append)
    assert shares == sorted(shares)
    assert shares[0] < 0.5
    assert shares[-1] == 1


class Stopping:
    """A year that is stopped by Ctrl-C at its n-th evaluation."""

    def __init__(self, year, after, error):
        self._year, self.left, self.error = year, after, error

    def __getattr__(self, name):
        return getattr(self._year, name)

    def illuminance(self, share, scale=None):
        self.left -= 1
        if self.left < 0:
            raise self.error
        return self._year.illuminance(share, scale)


def as_runtime_error():
    error = RuntimeError("in a loop")
    error.__cause__ = KeyboardInterrupt()
    return error


@pytest.mark.parametrize("error", [KeyboardInterrupt(), as_runtime_error()])
def test_ctrl_c_keeps_the_best_so_far(year, error):
    optimum = optimise(by_window(Stopping(year, 7, error), ase_limit=60.0))
    assert not optimum.finished
    assert optimum.evaluations == 7
    assert any(optimum.best is step.candidate for step in optimum.history)
    front = pareto(replace(optimum, finished=True), [5.0, 50.0])
    assert not front.finished


def test_other_errors_and_ctrl_c_before_the_first_evaluation_are_not_hidden(year):
    with pytest.raises(RuntimeError, match="broken"):
        optimise(by_window(Stopping(year, 7, RuntimeError("broken"))))
    with pytest.raises(KeyboardInterrupt):
        optimise(by_window(Stopping(year, 0, KeyboardInterrupt())))


@pytest.mark.slow
def test_the_front_falls_nowhere_and_holds_the_optimum(year, tmp_path):
    optimum = optimise(by_window(year, ase_limit=30.0), Search(starts=1))
    front = pareto(optimum, [0.0, 15.0, 30.0, 60.0], Search())
    ase = [p.hard.ase for p in front.points]
    value = [p.hard.value for p in front.points]
    assert ase == sorted(set(ase))
    assert value == sorted(set(value))
    assert len(ase) >= 3
    within = [p.hard.value for p in front.points if p.hard.ase <= 30.0]
    assert max(within) >= optimum.best.hard.value
    replace(front, points=()).save(tmp_path / "pareto.csv")
    assert len(pd.read_csv(tmp_path / "pareto.csv")) == 0
    front.save(tmp_path / "pareto.csv")
    table = pd.read_csv(tmp_path / "pareto.csv")
    np.testing.assert_allclose(table.ASE, ase, atol=1e-3)
    assert {"sDA", "dwr", "position", "film_m2", "value"} <= set(table.columns)
    scores = {n: optimum.problem.hard(s) for n, s in named(year, **VARIANTS).items()}
    figure = pictures.front(front, scores, optimum.best.hard)
    texts = {t.get_text() for t in figure.axes[0].texts}
    assert set(VARIANTS) <= texts


def test_files_of_a_search(year, tmp_path):
    optimum = optimise(by_strips(year, ase_limit=30.0), Search(starts=1, sharpness=(8.0,)))
    optimum.save(tmp_path)
    table = pd.read_csv(tmp_path / "history.csv")
    assert len(table) == optimum.evaluations
    assert (np.diff(table.seconds) >= 0).all()
    assert {"search", "sharpness", "value", "sDA", "ASE", "smooth_sDA", "smooth_ASE"} <= set(table)
    assert [c for c in table if c.startswith("film_") and c != "film_m2"] == [
        f"film_{i}" for i in range(36)
    ]
    saved = json.loads((tmp_path / "optimum.json").read_text())
    assert saved["evaluations"] == optimum.evaluations
    np.testing.assert_allclose(np.sum(list(saved["composition"].values()), axis=0), 1, atol=1e-4)
    figure = pictures.facade(year.tiles, optimum.best.share, MATERIALS, "film", "best")
    wall = to_rgba(pictures.WALL)
    bars = [p for p in figure.axes[0].patches if p.get_fill() and p.get_facecolor() != wall]
    drawn = sum(p.get_width() * p.get_height() for p in bars)
    assert drawn == pytest.approx(year.tiles.area.sum(), rel=1e-5)
    pictures.search(optimum).savefig(tmp_path / "search.png")


def test_a_picture_of_panes_has_the_area_of_the_film_in_each():
    names, areas, film = ["glass (south)", "roof"], np.array([4.0, 2.0]), np.array([0.25, 1.0])
    (ax,) = pictures.panes(names, areas, film, "film").axes
    assert [bar.get_width() for bar in ax.patches] == [1.0, 2.0, 3.0, 0.0]
    assert [label.get_text() for label in ax.get_yticklabels()] == names
    assert [text.get_text().strip() for text in ax.texts] == ["25 %", "100 %"]


def test_the_picture_shows_a_façade_as_it_is_drawn():
    """Film in the upper part of a tile below film, and in the lower part of one above it."""
    tiles = Tiles.grid(4, 1)
    share = np.array([[0, 0.75, 0.25, 0], [0, 0, 1, 0], [0, 0.25, 0.75, 0], [1, 0, 0, 0]], float)
    axes = pictures.facade(tiles, share, MATERIALS, "film").axes[0]
    film = [p for p in axes.patches if p.get_facecolor() == to_rgba(pictures.FILM)]
    (pane,) = film
    high = 1.8 / 4
    assert pane.get_y() == pytest.approx(0.9 + 0.75 * high)
    assert pane.get_height() == pytest.approx(2 * high)
