"""Façades by parameters: exact areas, rows that add up, gradients, those at the bounds too."""

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from drcmitsuba.case.metrics import Metrics
from drcmitsuba.design.facade_maps import Edges, Panes, Strips, Window
from drcmitsuba.design.goal import Goal
from drcmitsuba.design.parameters import Factor, Parameter, inward
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.metrics.intervals.rules import Rules
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.synthetic_year import MATERIALS, SyntheticYear, Tiles

RULES = Rules(Metrics(sda_threshold=500.0, ase_hours=20.0), 1000.0, 0.02, 1.0)
WALL = 8.8 * 3.6


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


@pytest.fixture(scope="module")
def year():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")
    return SyntheticYear(Tiles.grid(6, 3))


def panes(tiles):
    return Panes(tiles, MATERIALS, "glass", "film")


def values(**given):
    return {key: mi.Float(np.atleast_1d(value).astype(np.float32)) for key, value in given.items()}


@dataclass(frozen=True)
class Heights:
    """Window given by the heights of its edges [m], over the whole width of the tiles."""

    panes: Panes
    sill: Parameter
    head: Parameter
    film_bottom: Parameter
    film_top: Parameter

    @property
    def parameters(self):
        return self.sill, self.head, self.film_bottom, self.film_top

    def drawn(self, values):
        return values

    def share(self, values):
        within = inward(values, self.parameters)
        edges, at = (Edges(*(v[p.key] for p in self.parameters)) for v in (values, within))
        return self.panes.between(edges, at)


def heights(tiles):
    return Heights(panes(tiles), *(Parameter(k, 0.9, 2.7, 0.9) for k in
                   ("sill", "head", "film_bottom", "film_top")))  # fmt: skip


def window(tiles, wwr=(0.1, 0.5), sill=(0.9, 1.5)):
    return Window(
        panes(tiles),
        WALL,
        Parameter("sill", *sill, sill[0]),
        Parameter("wwr", *wwr, wwr[0]),
        Parameter("dwr", 0.0, 1.0, 0.5),
        Parameter("position", 0.0, 1.0, 1.0),
    )


def overlap(tiles, low, high):
    """Area of the tiles between two heights [m²], row by row."""
    left, right, bottom, top = tiles.bounds.T
    return np.clip(np.minimum(top, high) - np.maximum(bottom, low), 0, None) * (right - left)


@pytest.mark.parametrize(
    ("sill", "head", "film_bottom", "film_top"),
    [
        (0.9, 2.7, 1.8, 2.7),
        (1.0, 2.5, 1.33, 2.01),
        (1.0, 2.5, 0.9, 2.7),
        (1.2, 1.25, 1.21, 1.22),
        (1.3, 1.3, 1.3, 1.3),
        (1.0, 2.0, 2.1, 2.4),
        (1.0, 2.0, 1.8, 1.2),
    ],
)
def test_areas_of_heights_are_their_overlap_with_the_tiles(sill, head, film_bottom, film_top):
    tiles = Tiles.grid(6, 3)
    given = values(sill=sill, head=head, film_bottom=film_bottom, film_top=film_top)
    area = heights(tiles).share(given).numpy() * tiles.area[:, None]
    film = overlap(tiles, max(sill, film_bottom), min(head, film_top))
    np.testing.assert_allclose(area[:, 2], film, atol=2e-6)
    np.testing.assert_allclose(area[:, 1], overlap(tiles, sill, head) - film, atol=2e-6)
    np.testing.assert_allclose(area.sum(axis=1), tiles.area, rtol=1e-6)
    np.testing.assert_array_equal(area[:, 3], 0)


@pytest.mark.parametrize("dwr", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("position", [0.0, 0.6, 1.0])
def test_a_window_has_its_ratios_and_its_film_where_it_should_be(dwr, position):
    tiles = Tiles.grid(6, 3)
    given = values(sill=1.0, wwr=0.35, dwr=dwr, position=position)
    area = window(tiles).share(given).numpy() * tiles.area[:, None]
    glazed = area[:, 1:3].sum()
    assert glazed == pytest.approx(0.35 * WALL, rel=1e-5)
    assert area[:, 2].sum() == pytest.approx(dwr * glazed, abs=1e-4)
    height = 0.35 * 3.6
    foot = 1.0 + position * height * (1 - dwr)
    np.testing.assert_allclose(area[:, 2], overlap(tiles, foot, foot + dwr * height), atol=1e-5)


def test_a_window_that_would_reach_beyond_the_tiles_ends_there():
    tiles = Tiles.grid(6, 3)
    given = values(sill=1.5, wwr=0.5, dwr=0.0, position=0.0)
    area = window(tiles).share(given).numpy() * tiles.area[:, None]
    np.testing.assert_allclose(area[:, 1], overlap(tiles, 1.5, 2.7), atol=1e-5)


@pytest.mark.parametrize(("sill", "position"), [(1.0, 0.3), (1.5, 0.0), (1.5, 1.0), (1.4, 0.5)])
def test_values_are_told_as_the_window_is_drawn(sill, position):
    """The same composition follows from them: of what lies beyond the tiles nothing is told."""
    tiles = Tiles.grid(6, 3)
    given = {"sill": sill, "wwr": 0.5, "dwr": 0.6, "position": position}
    map_, given = window(tiles), {key: np.array([value]) for key, value in given.items()}
    told = map_.drawn(given)
    shares = [map_.share(values(**each)).numpy() for each in (given, told)]
    np.testing.assert_allclose(shares[1], shares[0], atol=1e-6)
    area = (shares[0] * tiles.area[:, None]).sum(axis=0)
    glazed = area[1:].sum()
    assert told["wwr"][0] == pytest.approx(glazed / WALL, abs=1e-6)
    assert told["dwr"][0] * glazed == pytest.approx(area[2], abs=1e-5)
    assert 0 <= told["position"][0] <= 1


def test_strips_are_what_their_tiles_say():
    tiles = Tiles.grid(6, 3)
    rng = np.random.default_rng(0)
    open_, film = rng.random((2, 18))
    strips = Strips(
        panes(tiles), Parameter("window", 0, 1, 0.5, 18), Parameter("film", 0, 1, 0.5, 18)
    )
    share = strips.share(values(window=open_, film=film)).numpy()
    np.testing.assert_allclose(share[:, 0], 1 - open_, atol=1e-6)
    np.testing.assert_allclose(share[:, 1], open_ * (1 - film), atol=1e-6)
    np.testing.assert_allclose(share[:, 2], open_ * film, atol=1e-6)
    one = Strips(panes(tiles), Parameter.fixed("window", 1.0), Parameter("film", 0, 1, 0.5, 18))
    np.testing.assert_allclose(one.share(values(window=1.0, film=film)).numpy()[:, 2], film)


def problem(year, facade, aim="sDA", factors=()):
    return FacadeProblem(year, facade, Goal(RULES, "film", aim, film_cost=3.0), factors)


def slopes(problem, x, k, axis, h):
    """Differences of value, ASE and window area by x[axis], of second order at a bound too."""
    ahead = {0.0: (0, h, 2 * h), 1.0: (0, -h, -2 * h)}.get(x[axis])
    moves, weights = ((-h, h), (-1, 1)) if ahead is None else (ahead, (-3, 4, -1))
    total = np.zeros(3)
    for move, weight in zip(moves, weights, strict=True):
        moved = x.copy()
        moved[axis] += move
        score = problem.evaluate(moved, k).smooth
        total += weight * np.array([score.value, score.ase, score.window_area])
    return total / (2 * (h if ahead is None else moves[1]))


def check(problem, x, k=4.0, h=1e-3, axes=None):
    """Every gradient is the difference within 2 %, or within 0.2 % of the largest of its kind."""
    candidate = problem.evaluate(x, k)
    reverse = np.array([candidate.gradient, candidate.ase_gradient, candidate.area_gradient])
    assert np.isfinite(reverse).all()
    axes = range(len(x)) if axes is None else axes
    scale = np.abs(reverse).max(axis=1)
    for axis in axes:
        at = slopes(problem, x, k, axis, h)
        for got, wanted, most in zip(reverse[:, axis], at, scale, strict=True):
            assert got == pytest.approx(wanted, rel=0.02, abs=0.002 * most + 2e-3)


def clear_of_kinks(window, x):
    """Whether no edge lies within 5 mm of one between tiles, where a difference sees two slopes."""
    sill, wwr, dwr, position = (
        p.low + v * (p.high - p.low) for p, v in zip(window.parameters, x, strict=True)
    )
    height = wwr * 3.6
    foot = sill + position * height * (1 - dwr)
    edges = np.array([sill, sill + height, foot, foot + dwr * height])
    return np.abs(edges[:, None] - np.arange(0.9, 2.8, 0.3)).min() > 5e-3


@pytest.mark.parametrize("aim", ["sDA", "worst month"])
def test_gradients_of_a_window_are_the_differences(year, aim):
    rng = np.random.default_rng(1)
    tried = 0
    while tried < 4:
        x, given = rng.uniform(0.1, 0.9, 4), window(year.tiles)
        if clear_of_kinks(given, x):
            check(problem(year, given, aim), x)
            tried += 1


@pytest.mark.parametrize("bound", [0.0, 1.0])
@pytest.mark.parametrize("axis", range(4))
def test_gradients_of_a_window_at_its_bounds_are_those_towards_the_inside(year, axis, bound):
    x = np.array([0.33, 0.47, 0.61, 0.27])
    x[axis] = bound
    check(problem(year, window(year.tiles)), x, axes=[axis])


@pytest.mark.parametrize("corner", range(16))
def test_gradients_in_the_corners_are_finite_and_one_sided(year, corner):
    x = np.array([(corner >> i) & 1 for i in range(4)], float)
    # No corner lies where an edge of the window meets one between tiles.
    given = window(year.tiles, wwr=(0.05, 0.3), sill=(0.9, 1.45))
    check(problem(year, given), x)


def test_gradients_of_heights_are_the_differences(year):
    h = heights(year.tiles)
    check(problem(year, h), np.array([0.11, 0.93, 0.42, 0.77]))
    # The window begins and ends with the tiles: towards the inside.
    check(problem(year, h), np.array([0.0, 1.0, 0.52, 0.9]))


def test_gradients_of_strips_are_the_differences(year):
    one = Parameter("window", 0, 1, 0.5, 18)
    film = Parameter("film", 0, 1, 0.5, 18)
    x = np.random.default_rng(2).random(36)
    x[[0, 5, 20]], x[[3, 11, 30]] = 0.0, 1.0
    check(problem(year, Strips(panes(year.tiles), one, film)), x)


def test_gradients_that_are_asked_for_later_are_the_same(year):
    """The graph of a design is gone once the next one is evaluated, and is made anew."""
    given, x = problem(year, window(year.tiles)), np.array([0.33, 0.47, 0.61, 0.27])
    first = given.evaluate(x, 8.0)
    again = given.evaluate(x, 8.0)
    x[:] = 0.5  # a search may reuse its array
    given.evaluate(x, 8.0)
    np.testing.assert_allclose(first.gradient, again.gradient, rtol=1e-5)
    np.testing.assert_allclose(first.ase_gradient, again.ase_gradient, rtol=1e-5)
    assert again.slopes.of is again.slopes.of
    assert (first.gradient != 0).all()


def test_tiles_that_are_windows_as_a_whole_have_film_alone(year):
    window, film = Parameter("window", 0, 1, 0.5, 12), Parameter("film", 0, 1, 0.5, 18)
    strips = Strips(panes(year.tiles), window, film, whole=6)
    x = np.random.default_rng(3).random(30)
    given = problem(year, strips)
    check(given, x)
    share = given.evaluate(x, 8.0).share
    wall, _, opal = share[:, :3].T
    assert (wall[12:] == 0).all()
    assert opal[12:] == pytest.approx(x[24:], abs=1e-6)
    for key, values in strips.values_of(share).items():
        assert values == pytest.approx(given.named(x)[key], abs=1e-5)


def test_gradients_of_transmittances_are_the_differences(year):
    factors = (
        Factor({"glass": 1.0}, Parameter("glazing_transmittance", 0.5, 1.5, 1.0)),
        Factor({"film": 0.6}, Parameter("film_transmittance", 0.3, 0.9, 0.6)),
    )
    x = np.array([0.33, 0.47, 0.61, 0.27, 0.5, 0.5])
    given = problem(year, window(year.tiles), factors=factors)
    check(given, x)
    for bound in (0.0, 1.0):
        x[4:] = bound
        check(given, x, axes=[4, 5])


def test_a_scale_multiplies_the_light_through_its_material(year):
    factors = (Factor({"glass": 1.0}, Parameter("glazing_transmittance", 0.5, 1.5, 1.0)),)
    given = problem(year, window(year.tiles), factors=factors)
    share, once = given.illuminance(given.values(mi.Float([0.3, 0.4, 0.0, 0.4, 0.5])))
    _, half = given.illuminance(given.values(mi.Float([0.3, 0.4, 0.0, 0.4, 0.0])))
    assert dr.sum(share.array)[0] == pytest.approx(18, rel=1e-5)
    np.testing.assert_allclose(half.open.numpy(), 0.5 * once.open.numpy(), rtol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda y: Parameter("dwr", 1.0, 0.0, 0.5), "parameter: dwr: 1 to 0; give the lower"),
        (lambda y: Parameter("dwr", 0.0, 1.0, 2.0), "parameter: dwr: start at 2; start between"),
        (lambda y: Panes(y.tiles, MATERIALS, "glas", "film"), 'did you mean "glass"?'),
        (lambda y: problem(y, window(y.tiles), factors=(
            Factor({"glass": 1.0}, Parameter("dwr", 0, 1, 1)),)), "give each its own key"),
        (lambda y: problem(y, Strips(panes(y.tiles), Parameter.fixed("window", 1.0),
                                     Parameter.fixed("film", 0.5))), "every value is fixed"),
        (lambda y: FacadeProblem(y, window(y.tiles), Goal(RULES, "foil")), "no material 'foil'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(year, make, message):
    with pytest.raises(InputError) as caught:
        make(year)
    assert message in str(caught.value)
