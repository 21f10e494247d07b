"""Draws of the metrics on replicates whose truth is known, and where nothing is in doubt."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t as student

from drcmitsuba import metrics
from drcmitsuba.case.metrics import Metrics
from drcmitsuba.metrics import accumulate, evaluate_metrics, intervals
from drcmitsuba.metrics.coefficients_by_state import Coefficients
from drcmitsuba.metrics.intervals import Bounds, Rules, t_factor
from drcmitsuba.metrics.intervals.autonomy import multipliers
from drcmitsuba.metrics.intervals.facade_draws import draw_closures
from drcmitsuba.metrics.intervals.rules import DRAWS
from drcmitsuba.metrics.intervals.sun import _exceeds, draw_sun, hidden_share, unpacked
from drcmitsuba.schema import LUMINANCE_WEIGHTS

HOURS = 60
TIMES = np.datetime64("2015-03-02T00", "ns") + np.arange(HOURS) * np.timedelta64(24, "h")
RULES = Rules(Metrics(sda_threshold=500, sda_fraction=0.5, ase_hours=20), 1000, 0.25, 1.0)
RAYS = 32


def coefficients(is_open, shaded=None, sun=None, sun_se=None):
    """C of which every hour has a bin of its own, so that C is E; arrays (…, time, sensor)."""
    by_state = {"open": is_open} if shaded is None else {"open": is_open, "shaded": shaded}
    sun = np.zeros(is_open.shape[1:]) if sun is None else sun
    sun_se = np.zeros_like(sun) if sun_se is None else sun_se

    def with_ground(a):
        return np.concatenate([np.zeros((*a.shape[:-1], 1)), a], axis=-1).astype(np.float32)

    def state(E):
        return xr.Dataset(
            {
                "replicates": (("replicate", "sensor", "bin"), with_ground(E.swapaxes(1, 2))),
                "straight": (("sensor", "bin"), with_ground(sun.T)),
                "straight_se": (("sensor", "bin"), with_ground(sun_se.T)),
            },
            coords={
                "bin": np.array(["ground", *SKY["sun_bin"].values], object),
                **{axis: ("sensor", np.arange(E.shape[2]) + 0.5) for axis in "xyz"},
            },
        )

    names = xr.DataArray(np.array(list(by_state), object), dims="state", name="state")
    both = [state(E) for E in by_state.values()]
    joined = xr.concat(both, names, coords="minimal", compat="override")
    return joined.assign_attrs(has_shade=int(shaded is not None))


SKY = xr.Dataset(
    {"sky": (("time", "bin"), np.zeros((HOURS, 1))), "sun": ("time", np.ones(HOURS))},
    coords={
        "time": TIMES,
        "bin": np.array(["ground"], object),
        "sun_bin": ("time", np.array([f"sun_{i}" for i in range(HOURS)], object)),
        "clock": ("time", TIMES),
    },
)


def illuminance(C, rules=RULES):
    is_open = C.sel(state="open", drop=True)
    closed = xr.zeros_like(SKY["sun"], dtype=bool)
    shaded = None
    if C.attrs["has_shade"]:
        direct = accumulate.direct_sun(is_open, SKY)["direct_sun"]
        closed = metrics.shade_closed(direct, rules.shade_threshold, rules.shade_area)
        shaded = C.sel(state="shaded", drop=True)
    E = accumulate.illuminance(is_open, [shaded], SKY, closed.values.astype(int))
    return E.assign_attrs(has_shade=C.attrs["has_shade"])


def drawn(C, rules=RULES, seed=0):
    E = illuminance(C, rules)
    return E, intervals.draw(Coefficients.of(C), SKY, E, rules, rays=RAYS, seed=seed)


def replicates(mean, error, n=8, seed=1):
    """Replicates with independent errors; `error` is that of their mean."""
    rng = np.random.default_rng(seed)
    mean, error = np.broadcast_arrays(mean, error)
    return mean + error * np.sqrt(n) * rng.standard_normal((n, *mean.shape))


# ---- single entries ----------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 4, 8, 16])
def test_the_factor_is_students(n):
    assert t_factor(n) == pytest.approx(student.ppf(0.975, n - 1), rel=1e-9)


@pytest.mark.parametrize("n", [3, 8])
def test_draws_of_an_entry_cover_its_truth_as_students_t_does(n):
    E = replicates(np.zeros(4000), 1.0, n)
    mean, se = E.mean(axis=0), E.std(axis=0, ddof=1) / np.sqrt(n)
    covered = np.zeros(0)
    for seed in range(8):  # entries share the draws, so these have to differ, too
        part = slice(seed * 500, (seed + 1) * 500)
        d = mean[part] + multipliers(n, seed).replicates.T @ (E[:, part] - mean[part])
        low, high = np.quantile(d, [0.025, 0.975], axis=0)
        covered = np.append(covered, (low <= 0) & (high >= 0))
        if n == 8:  # the spread of t with 7 degrees of freedom
            assert np.median(d.std(axis=0) / se[part]) == pytest.approx(np.sqrt(7 / 5), abs=0.09)
    assert covered.mean() == pytest.approx(0.95, abs=0.012)


def test_entries_that_share_their_error_move_together():
    shared = replicates(np.full((HOURS, 1), 500.0), 0.0) + replicates(0.0, 20.0).reshape(8, 1, 1)
    apart = replicates(np.full((HOURS, 1), 500.0), 20.0)
    moved = []
    for E in (shared, apart):
        E = E - E.mean(axis=0) + 500.5
        _, draws = drawn(coefficients(np.concatenate([E] * 4, axis=2)))
        assert set(np.unique(draws.annual["sDA"])) == {0.0, 100.0}  # equal sensors pass together
        moved.append(draws.annual["sDA"].mean())
        assert 40 < moved[-1] < 90
    # Hours that move together pass at once: a month is all or nothing, too.
    half = Rules(Metrics(sda_threshold=500, sda_fraction=0.99), 1000, 0.25, 1.0)
    of_shared, of_apart = (
        drawn(coefficients(E - E.mean(axis=0) + 500.5), half)[1].annual["sDA"].mean()
        for E in (shared, apart)
    )
    assert of_shared > 40
    assert of_apart < 5


# ---- counts ------------------------------------------------------------------------------------


def test_ties_pass_for_certain():
    E = np.full((8, HOURS, 2), 500.0)
    E[:, 30:] = 0  # exactly half of the hours
    E[:, 0, 1] = 499.9
    sun = np.where(np.arange(HOURS)[:, None] < [20, 19], 1000.0, 0.0)
    _, draws = drawn(coefficients(E, sun=sun))
    np.testing.assert_array_equal(draws.passing["sDA"], [1, 0])
    np.testing.assert_array_equal(draws.passing["ASE"], [1, 0])
    assert set(draws.annual["sDA"]) == set(draws.annual["ASE"]) == {50.0}


def test_where_all_is_certain_intervals_have_no_width():
    E = replicates(np.full((HOURS, 3), [100.0, 900.0, 2000.0]), 1.0)
    C = coefficients(E, E / 10, np.full((HOURS, 3), [0.0, 0.0, 5000.0]))
    lux, draws = drawn(C)
    numbers = evaluate_metrics.summarise(lux, RULES, draws)
    for name in ("sDA", "ASE", "shade_closed"):
        assert numbers[name]["low"] == numbers[name]["value"] == numbers[name]["high"]
    assert numbers["shade_closed"]["value"] == 100
    assert numbers["ASE"]["value"] == pytest.approx(100 / 3)
    assert numbers["undecided"] == []
    assert draws.half_width(numbers, "point") == 0


def test_months_without_hours_are_none_and_nothing_else_is_nan():
    E = replicates(np.full((HOURS, 4), 500.0), 30.0)
    lux, draws = drawn(
        coefficients(E, E / 5, np.full((HOURS, 4), 900.0), np.full((HOURS, 4), 90.0))
    )
    numbers = evaluate_metrics.summarise(lux, RULES, draws)
    for name in ("msDA", "MSE", "shade_closed_monthly"):
        known = [month for month, i in enumerate(numbers[name], start=1) if i is not None]
        assert known == [3, 4]
        assert all(0 <= numbers[name][m - 1]["low"] <= numbers[name][m - 1]["value"] for m in known)
        assert all(
            numbers[name][m - 1]["value"] <= numbers[name][m - 1]["high"] <= 100 for m in known
        )
        assert np.isnan(draws.monthly[name]).all(axis=1).sum() == 10
    assert all(np.isfinite(d).all() for d in draws.annual.values())
    assert all(np.isfinite(p).all() for p in draws.passing.values())


def test_months_and_year_count_the_same_draws():
    """One month alone is the year: msDA of it has the draws of sDA, MSE those of ASE."""
    rng = np.random.default_rng(4)
    level = rng.uniform(300, 700, (31, 6))
    E = np.concatenate([replicates(level, 60.0), np.zeros((8, HOURS - 31, 6))], axis=1)
    sun = np.concatenate([rng.uniform(0, 2000, (31, 6)), np.zeros((HOURS - 31, 6))])
    C = coefficients(E, sun=sun, sun_se=0.3 * sun).sel(bin=["ground", *SKY["sun_bin"].values[:30]])
    march = SKY.isel(time=slice(0, 30))
    is_open = C.sel(state="open", drop=True)
    lux = accumulate.illuminance(is_open, [], march, np.zeros(march.sizes["time"], int))
    draws = intervals.draw(
        Coefficients.of(C), march, lux.assign_attrs(has_shade=0),
        Rules(Metrics(sda_threshold=500, ase_hours=15), 1000, 0.25, 1.0), rays=RAYS, seed=0,
    )  # fmt: skip
    assert np.ptp(draws.annual["sDA"]) > 0
    assert np.ptp(draws.annual["ASE"]) > 0
    np.testing.assert_array_equal(draws.monthly["msDA"][2], draws.annual["sDA"])
    np.testing.assert_array_equal(draws.monthly["MSE"][2], draws.annual["ASE"])


def test_too_close_to_call():
    mean = np.full((HOURS, 3), [460.0, 500.0, 540.0])
    E = replicates(mean, 1.0) + replicates(0.0, 8.0, seed=5).reshape(8, 1, 1)
    lux, draws = drawn(coefficients(E))
    numbers = evaluate_metrics.summarise(lux, RULES, draws)
    (one,) = numbers["undecided"]
    assert one == {
        "sensor": 1, "x": 1.5, "y": 1.5, "z": 1.5, "metric": "sDA",
        "probability": pytest.approx(draws.passing["sDA"][1], abs=1e-4),
    }  # fmt: skip
    assert 0.025 < one["probability"] < 0.975
    assert numbers["sDA"]["high"] - numbers["sDA"]["low"] >= 100 / 3 - 1e-9
    assert draws.half_width(numbers, "point") == pytest.approx(
        (numbers["sDA"]["high"] - numbers["sDA"]["low"]) / 2
    )
    assert draws.hours["sDA"].max() == 1  # in doubt at one sensor
    assert draws.hours["sDA"].sum() > HOURS / 2
    assert draws.hours["ASE"].sum() == 0


def test_the_mean_illuminance_has_the_interval_of_its_replicates():
    E = replicates(np.full((HOURS, 3), 500.0), 1.0) + replicates(0.0, 8.0).reshape(8, 1, 1)
    lux, draws = drawn(coefficients(E))
    of_replicate = E.mean(axis=(1, 2))
    half = student.ppf(0.975, 7) * of_replicate.std(ddof=1) / np.sqrt(8)
    assert draws.mean_illuminance.value == pytest.approx(float(lux["total"].mean()), rel=1e-5)
    assert draws.half_width({}, "%") == pytest.approx(100 * half / of_replicate.mean(), rel=1e-3)


def test_the_same_seed_draws_the_same():
    E = replicates(np.full((HOURS, 5), np.linspace(480, 520, 5)), 20.0)
    C = coefficients(E, None, np.full((HOURS, 5), 1000.0), np.full((HOURS, 5), 300.0))
    asked = Rules(Metrics(sda_threshold=500, ase_hours=35), 1000, 0.25, 1.0)
    first, again, other = (drawn(C, asked, seed=seed)[1] for seed in (0, 0, 1))
    for name in ("sDA", "ASE"):
        np.testing.assert_array_equal(first.annual[name], again.annual[name])
        assert not np.array_equal(first.annual[name], other.annual[name])


def test_channels_are_weighed_to_luminance():
    E = replicates(np.full((HOURS, 5), np.linspace(480, 520, 5)), 20.0)
    grey = coefficients(E)
    lux, expected = drawn(grey)
    channel = xr.DataArray(list(LUMINANCE_WEIGHTS), dims="channel")
    factors = xr.DataArray([0.5, 1.2, 0.4], dims="channel")  # weighed: 1
    factors /= float((factors * list(LUMINANCE_WEIGHTS.values())).sum())
    coloured = (grey * factors).assign_coords(channel=channel).assign_attrs(grey.attrs)
    draws = intervals.draw(Coefficients.of(coloured), SKY, lux, RULES, rays=RAYS, seed=0)
    np.testing.assert_allclose(draws.passing["sDA"], expected.passing["sDA"], atol=0.01)


# ---- the sun and the shade -----------------------------------------------------------------------


def on_edges(rays, pairs=200_000, replicates=8):
    """True part of the sun, and hits in every replicate, of pairs on the edge of a shadow."""
    rng = np.random.default_rng(3)
    depth = rng.uniform(-1, 1, pairs)  # of the edge in the disk
    part = (np.arccos(-depth) + depth * np.sqrt(1 - depth**2)) / np.pi
    return part, rng.binomial(rays // replicates, part, (replicates, pairs)) / (rays // replicates)


@pytest.mark.parametrize("rays", [8, 32, 128])
def test_as_many_parts_hide_as_the_prior_tells(rays):
    _, hits = on_edges(rays)
    seen = hits.mean(axis=0)
    dark, edge = (seen == 0).sum(), ((seen > 0) & (seen < 1)).sum()
    assert dark / edge == pytest.approx(hidden_share(rays), rel=0.1)


@pytest.mark.parametrize("limit", [0.03, 0.1, 0.5])
def test_probabilities_at_edges_come_true(limit):
    """Among pairs that are seen in part, the part is above a limit as often as computed."""
    part, hits = on_edges(32)
    edge = (hits.mean(axis=0) > 0) & (hits.mean(axis=0) < 1)
    hits, part = hits[:, edge], part[edge]
    p = _exceeds(hits.mean(axis=0), hits.std(axis=0, ddof=1) / np.sqrt(8), limit)
    assert p.mean() == pytest.approx((part >= limit).mean(), abs=0.02)
    doubtful = (p > 0.2) & (p < 0.8)
    assert doubtful.sum() > 1000
    assert p[doubtful].mean() == pytest.approx((part >= limit)[doubtful].mean(), abs=0.1)


def test_hidden_parts_are_drawn_as_often_as_they_occur():
    part, hits = on_edges(32, 3000)
    rng = np.random.default_rng(6)
    shape = (100, 60)
    full = rng.permutation(np.repeat([True, False, False], 2000)).reshape(shape)
    value = np.where(full, 20_000.0, 0.0)
    edge = rng.permutation(6000)[:3000]
    value.ravel()[edge] = 20_000 * hits.mean(axis=0)
    error = np.zeros(shape)
    error.ravel()[edge] = 20_000 * hits.std(axis=0, ddof=1) / np.sqrt(8)
    true = ((hits.mean(axis=0) == 0) & (20_000 * part >= 400)).sum()
    sun = draw_sun(value, error, (400, 400), RAYS, 0)
    hidden = value[sun.time, sun.sensor] == 0
    assert true > 20
    assert unpacked(sun.exposed[hidden]).sum() / DRAWS == pytest.approx(true, rel=0.3)


def test_both_thresholds_see_the_same_draw():
    value, error = np.full((50, 4), 1000.0), np.full((50, 4), 300.0)
    sun = draw_sun(value, error, (900, 1200), RAYS, 0)
    exposed, closing = unpacked(sun.exposed), unpacked(sun.closing)
    assert (exposed >= closing).all()  # above 1200 is above 900
    assert exposed.mean() > closing.mean() + 0.2


def test_hours_close_by_the_share_of_their_sensors():
    sun = np.zeros((HOURS, 4))
    sun[:20] = [5000, 5000, 0, 0]
    sun[20:40, 0] = 5000
    sun[30:40, 1] = 1000
    error = np.where(sun == 1000, 300.0, 0)
    half = Rules(Metrics(), 1000, 0.5, 1.0)
    draws = draw_sun(sun, error, (1000, 1000), RAYS, 0)
    closures = draw_closures(sun, None, np.zeros(4, int), SKY["time"], draws, half.shade)
    assert closures.states == ("open", "shaded")
    assert closures.state[:20].all()
    assert not closures.state[20:30].any()
    assert closures.state[30:40].all()  # a tie passes
    np.testing.assert_array_equal(closures.hours[-10:], np.arange(30, 40))
    assert 0.3 < closures.drawn[-10:].mean() < 0.9
    assert not closures.possible[1, 40:].any()


def test_some_hours_of_closures_keep_their_draws():
    sun, error = np.zeros((HOURS, 4)), np.zeros((HOURS, 4))
    sun[::2, 0], error[::2, 0] = 1000, 300
    draws = draw_sun(sun, error, (1000, 1000), RAYS, 0)
    rule = Rules(Metrics(), 1000, 0.25, 1.0).shade
    closures = draw_closures(sun, None, np.zeros(4, int), SKY["time"], draws, rule)
    kept = np.flatnonzero(np.arange(HOURS) % 3 == 0)
    some = closures.at(kept)
    np.testing.assert_array_equal(some.possible, closures.possible[:, kept])
    np.testing.assert_array_equal(kept[some.hours], np.intersect1d(closures.hours, kept))
    rows = np.isin(closures.hours, kept)
    np.testing.assert_array_equal(some.drawn, closures.drawn[rows])
    assert 0 < len(some.hours) < len(closures.hours)


def test_an_hour_takes_the_state_that_it_is_drawn_to():
    """Every hour closes by one sensor in doubt; open all pass, shaded none."""
    sun, error = np.zeros((HOURS, 4)), np.zeros((HOURS, 4))
    sun[:, 0], error[:, 0] = 1000, 300
    E = replicates(np.full((HOURS, 4), 5000.0), 1.0)
    _, draws = drawn(coefficients(E, E / 100, sun, error))
    for share, sda in zip(draws.annual["shade_closed"], draws.annual["sDA"], strict=True):
        assert sda == (100 if share <= 50 else 0)
    assert set(draws.annual["sDA"]) == {0.0, 100.0}


def test_without_a_shade_nothing_closes():
    sun = np.full((HOURS, 3), 1000.0)
    C = coefficients(replicates(np.full((HOURS, 3), 500.0), 20.0), None, sun, sun / 3)
    _, draws = drawn(C)
    assert not draws.annual["shade_closed"].any()
    assert set(C["state"].values) == {"open"}


# ---- without replicates --------------------------------------------------------------------------


def test_bounds_hold_the_intervals_of_draws():
    E = replicates(np.full((HOURS, 9), np.linspace(400, 600, 9)), 20.0)
    lux, draws = drawn(coefficients(E))
    lux = lux.assign_attrs(interval_factor=t_factor(8))
    narrow, wide = (
        evaluate_metrics.summarise(lux, RULES, draws),
        evaluate_metrics.summarise(lux, RULES),
    )
    assert wide["sDA"]["low"] <= narrow["sDA"]["low"] < narrow["sDA"]["high"] <= wide["sDA"]["high"]
    assert wide["sDA"]["value"] == narrow["sDA"]["value"]
    assert "undecided" not in wide


def test_bounds_use_the_factor_that_the_illuminance_names():
    E = replicates(np.full((HOURS, 1), 500.0), 0.0) + np.linspace(-1, 1, 8).reshape(8, 1, 1)
    lux, _ = drawn(coefficients(E))
    se = float(lux["total_se"][0, 0])
    for factor, passes in ((1.9, 0.0), (2.1, 100.0)):
        asked = Rules(Metrics(sda_threshold=float(500 + 2 * se)), 1000, 0.25, 1.0)
        named = lux.assign_attrs(interval_factor=factor)
        assert Bounds.of(named, asked).annual["sDA"] == (0.0, passes)
