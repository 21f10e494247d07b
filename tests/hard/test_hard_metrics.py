"""Metrics, their draws and their smooth twins at every corner: right by hand, and finite."""

import dataclasses
import itertools

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr

from drcmitsuba import metrics
from drcmitsuba.case.case import Case
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.design.facade_maps import Panes, Strips, Window
from drcmitsuba.design.film import ParametricFilm
from drcmitsuba.design.film_bins import FilmBins
from drcmitsuba.design.goal import Goal
from drcmitsuba.design.measure import Measure
from drcmitsuba.design.parameters import Parameter
from drcmitsuba.design.problem import FacadeProblem
from drcmitsuba.design.reflectances import Interior
from drcmitsuba.metrics import evaluate_metrics, illuminance, intervals, smooth
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals import Rules
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from drcmitsuba.sky import daylight
from drcmitsuba.sky.sun_models import Suns
from drcmitsuba.transport.elements.state_illuminances import Illuminances
from tests.synthetic_year import SyntheticYear, Tiles
from tests.unit.design.test_design_film import irradiance_of

RULES = Rules(Metrics(sda_threshold=500.0, sda_fraction=0.5, ase_hours=250.0), 1000.0, 0.02, 1.0)
REPLICATES = 4
SHARPEST = 1e6


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


def dated(values, start="2015-01-01T08:00"):
    values = np.asarray(values, np.float32)
    time = np.datetime64(start, "ns") + np.arange(len(values)) * np.timedelta64(1, "h")
    return xr.DataArray(values, {"time": time}, ("time", "sensor"))


CORNERS = {
    # E, direct sun (time, sensor); sDA, ASE and shade closed that follow by hand [%].
    "all at the thresholds": (np.full((300, 5), 500.0), np.full((300, 5), 1000.0), 100, 100, 100),
    "one step below them": (
        np.full((300, 5), np.nextafter(np.float32(500), np.float32(0))),
        np.full((300, 5), np.nextafter(np.float32(1000), np.float32(0))), 0, 0, 0,
    ),
    "dark": (np.zeros((300, 5)), np.zeros((300, 5)), 0, 0, 0),
    "brightest float32": (np.full((300, 5), 3e38), np.full((300, 5), 3e38), 100, 100, 100),
    "smallest float32": (np.full((300, 5), 1e-45), np.full((300, 5), 1e-45), 0, 0, 0),
    "one sensor": (np.full((300, 1), 500.0), np.full((300, 1), 1000.0), 100, 100, 100),
    "one hour": (np.full((1, 5), 500.0), np.full((1, 5), 1000.0), 100, 0, 100),
    "one sensor, one hour": (np.full((1, 1), 500.0), np.full((1, 1), 1000.0), 100, 0, 100),
    "exactly half of the hours": (
        np.repeat([[500.0], [499.0]], 150, axis=0), np.repeat([[1000.0], [0.0]], [250, 50], axis=0),
        100, 100, 100 * 250 / 300,
    ),
    "one hour short": (
        np.repeat([[500.0], [499.0]], [149, 151], axis=0),
        np.repeat([[1000.0], [0.0]], [249, 51], axis=0), 0, 0, 100 * 249 / 300,
    ),
    "one of fifty sensors closes": (
        np.full((4, 50), 500.0), np.where(np.arange(50) == 0, 1000.0, 0.0) + np.zeros((4, 1)),
        100, 0, 100,
    ),
    "one of fifty-one does not": (
        np.full((4, 51), 500.0), np.where(np.arange(51) == 0, 1000.0, 0.0) + np.zeros((4, 1)),
        100, 0, 0,
    ),
}  # fmt: skip


@pytest.mark.parametrize("corner", CORNERS)
def test_metrics_by_hand(corner, holds):
    """Ties pass, a hair below does not, whatever the count of hours and sensors."""
    E, D, sda, ase, closed = CORNERS[corner]
    E, D = dated(E), dated(D)
    t, area = RULES.metrics, RULES.shade_area
    holds("sDA", abs(metrics.sda(E, t.sda_threshold) - sda), 0)
    holds("ASE", abs(metrics.ase(D) - ase), 0)
    percent = 100 * float(metrics.shade_closed(D, area=area).mean())
    holds("shade closed", abs(percent - closed), 1e-12)
    months, monthly = metrics.months(E), metrics.msda(E, t.sda_threshold).values
    there = np.isin(np.arange(1, 13), months)
    holds("months with hours that are NaN, or the other way", np.isnan(monthly) == there, 0)
    assert ((monthly[there] >= 0) & (monthly[there] <= 100)).all()
    if len(np.unique(months)) == 1:  # the year is one month
        holds("msDA − sDA", abs(monthly[there] - sda), 0)
        holds("MSE − ASE", abs(metrics.mse(D, hours=250).values[there] - metrics.ase(D)), 0)


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("error", [0.0, 1e-3, 3.0], ids=["certain", "0.1 %", "300 %"])
def test_intervals_are_finite_and_hold_the_value(corner, error, holds):
    """Draws of all metrics where nothing varies, all does, or one sensor and hour are all there is.

    Every hour has a bin of its own, so that C is E; the shaded state has a tenth of the light.
    """
    E, D, *_ = CORNERS[corner]
    scale = 1e-25 if E.max() > 1e30 else 1.0  # squares beyond 10¹⁹ lx have no room in float32
    E, D = E * scale, D * scale
    hours, sensors = E.shape
    rng = np.random.default_rng(1)
    noise = 1 + error * rng.standard_normal((REPLICATES, 1, sensors))
    is_open = np.maximum(E * noise, 0).swapaxes(1, 2)
    both = np.stack([is_open, is_open / 10]).astype(np.float32)
    straight = np.stack([D.T, D.T]).astype(np.float32)
    labels = np.array([f"sun_{i}" for i in range(hours)], object)
    dims = ("state", "sensor", "bin")
    zero = np.zeros((2, REPLICATES, sensors, 1), np.float32)
    C = xr.Dataset(
        {"replicates": (("state", "replicate", "sensor", "bin"),
                        np.concatenate([both, zero], axis=3)),
         "straight": (dims, np.concatenate([straight, zero[:, 0]], axis=2)),
         "straight_se": (dims, np.concatenate([straight * np.float32(min(error, 0.5)),
                                               zero[:, 0]], axis=2))},
        {"bin": np.append(labels, "ground"), "state": np.array(["open", "shaded"], object),
         **{axis: ("sensor", np.arange(sensors) + 0.5) for axis in "xyz"}},
        {"has_shade": 1, "shade_threshold": 1000.0, "shade_area": 0.02},
    )  # fmt: skip
    time = dated(E).time.values
    sky = xr.Dataset(
        {"sky": (("time", "bin"), np.zeros((hours, 1))), "sun": ("time", np.ones(hours))},
        {"time": time, "clock": ("time", time), "bin": np.array(["ground"], object),
         "sun_bin": ("time", labels)},
    )  # fmt: skip
    C = Coefficients.of(C)
    illuminances = illuminance.illuminance(C, sky)
    holds("E that is not finite", ~np.isfinite(illuminances.to_array().values), 0)
    draws = intervals.draw(C, sky, illuminances, RULES, rays=16, seed=2)
    summaries = [
        evaluate_metrics.summarise(illuminances, RULES, draws),
        evaluate_metrics.summarise(illuminances, RULES),
    ]
    for numbers in summaries:
        rows = [numbers[name] for name in ("sDA", "ASE", "shade_closed")]
        rows += [row for name in ("msDA", "MSE", "shade_closed_monthly") for row in numbers[name]]
        values = np.array([[r["low"], r["value"], r["high"]] for r in rows if r is not None])
        holds("ends that are not finite", ~np.isfinite(values), 0)
        holds("values beside their interval", np.diff(values, axis=1) < 0, 0)
        holds("per cent below 0 or above 100", np.maximum(-values, values - 100), 0)
    widths = [draws.half_width(summaries[0], unit) for unit in ("point", "%")]
    holds("half widths that are not finite", ~np.isfinite(widths), 0)


def test_what_is_not_finite_is_refused(holds):
    """All NaN, one NaN, one infinity: an error that says so, in every metric."""
    for bad in (np.full((3, 2), np.nan), [[np.nan, 1.0]], [[np.inf, 1.0]], [[-np.inf, 1.0]]):
        for metric in (metrics.sda, metrics.ase, metrics.msda, metrics.mse, metrics.shade_closed):
            with pytest.raises(InputError, match="NaN or infinite"):
                metric(dated(bad))
    refused = 0
    for shape in ((0, 3), (3, 0), (0, 0)):
        for metric in (metrics.sda, metrics.ase, metrics.msda, metrics.mse, metrics.shade_closed):
            with pytest.raises(InputError, match="give a time stamp and a sensor"):
                metric(dated(np.zeros(shape)))
            refused += 1
    holds("empty arrays that pass", 15 - refused, 0)


# Smooth twins


@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("k", [1.0, 8.0, 512.0, SHARPEST])
def test_twins_and_gradients_are_finite(corner, k, holds):
    """From the softest to a sharpness beyond any use; at, beside and infinitely far from a step."""
    E, D, sda, ase, closed = CORNERS[corner]
    months = metrics.months(dated(E))
    off, wrong = 0, 0.0
    for name, threshold in itertools.product(("sda", "ase", "msda", "mse", "shade"), (0.0, 500.0)):
        x = mi.TensorXf(np.asarray(E if "sda" in name else D, np.float32))
        dr.enable_grad(x)
        limit = threshold if "sda" in name else 2 * threshold
        if name in ("msda", "mse"):
            y = getattr(smooth, name)(x, months, limit, sharpness=k)
        elif name == "shade":
            y = 100 * smooth.shade_closed(x, limit, sharpness=k)
        else:
            y = mi.TensorXf(getattr(smooth, name)(x, limit, sharpness=k))
        if dr.grad_enabled(y):
            dr.backward(y)
            off += (~np.isfinite(dr.grad(x).numpy())).sum()
        values = y.numpy()
        off += (~np.isfinite(values)).sum()
        wrong = max(wrong, float(np.maximum(-values, values - 100).max()))
        if threshold == 0 and k >= 512 and name not in ("ase", "mse"):
            wrong = max(wrong, float((100 - values).max()))  # 0 lx are always reached
    holds("values and derivatives that are not finite", off, 0)
    holds("per cent beyond 0 … 100", max(wrong, 0.0), 1e-4)
    if k == SHARPEST and corner in ("dark", "brightest float32", "smallest float32"):
        # No value lies at its threshold: the sharpest twins are the metrics.
        x, y = (mi.TensorXf(np.asarray(a, np.float32)) for a in (E, D))
        twins = smooth.sda(x, 500.0, sharpness=k)[0], smooth.ase(y, sharpness=k)[0]
        holds("sharpest twins − metrics", abs(np.array(twins) - [sda, ase]), 1e-3)
        shade = smooth.shade_closed(y, sharpness=k).numpy()
        holds("sharpest shade − shade", abs(100 * shade.mean() - closed), 1e-3)


@pytest.mark.parametrize("aim", ["sDA", "worst month"])
@pytest.mark.parametrize("corner", CORNERS)
def test_objectives_are_finite(corner, aim, holds):
    """Optimisers see value and gradient, with the soft minimum over months and the shade."""
    E, D, *_ = CORNERS[corner]
    measure = Measure(RULES, aim, metrics.months(dated(E)))
    for k in (1.0, 8.0, 512.0):
        parts = [mi.TensorXf(np.asarray(a, np.float32)) for a in (E, np.asarray(E) / 10, D)]
        for part in parts:
            dr.enable_grad(part)
        value, ase = measure.smooth(Illuminances(*parts), k)
        dr.backward(value + ase)
        both = [value.numpy(), ase.numpy(), *(dr.grad(part).numpy().ravel() for part in parts)]
        holds("values and derivatives that are not finite", ~np.isfinite(np.concatenate(both)), 0)
    hard = measure.hard(Illuminances(*(dr.detach(part) for part in parts)))
    holds("hard numbers that are not finite", ~np.isfinite(hard), 0)


# Designs


@pytest.mark.parametrize("kind", ["window", "strips"])
def test_film_share_at_its_bounds(kind, holds):
    """No film, all film, no window, all window, every edge on a tile's border: finite gradients.

    And at a bound the gradient of the film's share is the one towards the inside.
    """
    year = SyntheticYear(Tiles.grid(4, 3), time=120, grid=(3, 4))
    panes = Panes(year.tiles, year.materials, "glass", "film")
    sharp = 8.0
    if kind == "window":
        facade = Window(
            panes, 8.8 * 3.6, Parameter("sill", 0.9, 1.8, 0.9), Parameter("wwr", 0.0, 0.5, 0.25),
            Parameter("dwr", 0.0, 1.0, 0.5), Parameter("position", 0.0, 1.0, 0.5),
        )  # fmt: skip
    else:
        window = Parameter("window", 0.0, 1.0, 0.5, panes.count)
        facade = Strips(panes, window, Parameter("film", 0.0, 1.0, 0.5, panes.count))
    rules = dataclasses.replace(RULES, metrics=Metrics(sda_threshold=300.0, ase_hours=10.0))
    problem = FacadeProblem(year, facade, Goal(rules, "film", film_cost=5.0))
    size = problem.size
    corners = list(itertools.product((0.0, 0.5, 1.0), repeat=size)) if size < 5 else [
        np.full(size, v) for v in (0.0, 0.5, 1.0)] + list(np.eye(size)) + [
        np.repeat(pair, size // 2) for pair in itertools.product((0.0, 1.0), repeat=2)]  # fmt: skip
    for x in corners:
        evaluation = problem.evaluate(np.array(x), sharp)
        scores = dataclasses.asdict(evaluation.smooth), dataclasses.asdict(evaluation.hard)
        numbers = [value for score in scores for value in score.values() if value is not None]
        numbers += [*evaluation.gradient, *evaluation.ase_gradient, *evaluation.area_gradient]
        holds("numbers and derivatives that are not finite", ~np.isfinite(numbers), 0)
        holds("shares that do not add up", abs(evaluation.share.sum(axis=1) - 1), 1e-6)
        holds("shares below 0", np.maximum(-evaluation.share, 0), 1e-6)
    if kind == "window":
        return
    for at, inward in ((0.0, 2e-3), (1.0, -2e-3)):  # film nowhere, and everywhere
        x = np.concatenate([np.ones(panes.count), np.full(panes.count, at)])
        step = np.concatenate([np.zeros(panes.count), np.full(panes.count, inward)])
        slope = problem.evaluate(x, sharp).gradient @ step
        near, far = (problem.evaluate(x + f * step, sharp).smooth.value for f in (0.5, 1.0))
        start = problem.evaluate(x, sharp).smooth.value
        # Richardson's one-sided difference; its own error is the distance to the plain one.
        plain, better = far - start, 4 * (near - start) - (far - start)
        assert abs(better) > 1e-4
        holds("derivative by film − difference", abs(slope - better),
              abs(better - plain) + 3e-4)  # fmt: skip


def test_reflectances_at_0_and_1(holds):
    """Black and perfectly white surfaces, one by one and all: powers 0ⁿ and 1ⁿ and their slopes."""
    case = Case.model_validate({
        "room": {"size": (3.0, 3.0, 3.0), "floor": 0.2, "ceiling": 0.8, "walls": 0.0},
        "facade": {"south": {"strips": [{"bottom": 0.9, "top": 2.8, "material": "open"}]}},
        "sensors": {"corner": (0.5, 0.5, 0.8), "count": (2, 2), "spacing": 1.5},
        "period": {"months": [3], "hours": (10, 14), "days_per_week": 1},
        "accuracy": {"replicates": 2, "paths": 128, "cell_sky_rays": 32, "sensor_sky_rays": 128},
    })  # fmt: skip
    interior = Interior.of(case, daylight.daylight(case))
    keys = ("floor", "ceiling", "walls")
    mean = {}
    for at in itertools.product((0.0, 1.0), repeat=3):
        rho = {key: mi.Float(value) for key, value in zip(keys, at, strict=True)}
        for value in rho.values():
            dr.enable_grad(value)
        illuminances = interior.illuminance(rho)
        dr.backward(dr.mean(illuminances.open.array))
        slopes = [dr.grad(value).numpy()[0] for value in rho.values()]
        E = illuminances.open.numpy()
        holds("E that is not finite or negative", ~(np.isfinite(E) & (E >= 0)), 0)
        holds(
            "slopes that are not finite or negative",
            ~(np.isfinite(slopes) & (np.array(slopes) >= 0)),
            0,
        )
        error = interior.standard_error(rho)
        holds("standard errors that are not finite", ~np.isfinite(error), 0)
        mean[at] = E.mean()
    black = interior.states[0].deposited.sensors.numpy().mean()
    holds("E of a black room − what comes straight", abs(mean[0, 0, 0] / black - 1), 1e-6)
    assert mean[1, 1, 1] > mean[0, 1, 0] > mean[0, 0, 0]
    # A white floor alone sends no light to sensors that face up.
    holds("E by a white floor in a black room − nothing", abs(mean[1, 0, 0] / black - 1), 1e-6)


FILM_BOUNDS = {"transmittance": (0, 1), "redirected": (0, 1), "tilt": (-90, 90), "spread": (2, 90)}


def test_films_at_their_bounds(holds):
    """All sixteen corners of a film's parameters: the answer and every derivative of it.

    The lobe may leave along the pane or straight back; what leaves is what came in times T.
    """
    directions = np.array([[0, -1.0, 0], [0, -1e-3, 1], [0.07, -0.8, 0.6], [1, -1e-3, 0]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    south = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])
    bins = FilmBins(south, 1, Suns(tuple(f"sun_{i}" for i in range(4)), directions), depth=2)
    irradiance = irradiance_of(bins)
    for corner in itertools.product(*FILM_BOUNDS.values()):
        values = dict(zip(FILM_BOUNDS, map(mi.Float, map(float, corner)), strict=True))
        for value in values.values():
            dr.enable_grad(value)
        answer = ParametricFilm(**values).answer(bins)
        dr.backward(dr.sum(answer.array * dr.arange(mi.Float, dr.width(answer.array))))
        slopes = [dr.grad(value).numpy()[0] for value in values.values()]
        A = answer.numpy().astype(float)
        holds("answers that are not finite or negative", ~(np.isfinite(A) & (A >= 0)), 0)
        holds("derivatives that are not finite", ~np.isfinite(slopes), 0)
        # Every outgoing cell has the projected solid angle π / cells.
        out = A.sum(axis=0) * np.pi / bins.cells
        off = abs(out - corner[0] * irradiance)
        holds("light that leaves − T · light that arrives", off / irradiance.max(), 1e-5)
