"""Metrics of points and rooms on series whose answer can be counted by eye."""

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest
import xarray as xr
from drcmitsuba_plugins.patches import Patches

from drcmitsuba import metrics
from drcmitsuba.metrics import intervals, smooth
from drcmitsuba.runtime import backend
from drcmitsuba.runtime.errors import InputError
from tests.unit.metrics.test_metrics import reached_for, series

CASE = {
    "da": lambda E: metrics.da(E),
    "cda": lambda E: metrics.cda(E),
    "udi": lambda E: metrics.udi(E),
    "mean_hours": lambda E: metrics.mean_hours(E),
    "worst_point_hours": lambda E: metrics.worst_point_hours(E),
    "light_exposure": lambda E: metrics.light_exposure(E),
    "uniformity": lambda E: metrics.uniformity(E),
    "sunlight_hours": lambda E: metrics.sunlight_hours(E),
    "median_illuminance": lambda E: metrics.median_illuminance(E),
    "provision": lambda E: metrics.provision(E),
}


@pytest.fixture(autouse=True)
def _variant():
    backend.select("llvm_ad_mono" if backend.llvm_version() else "cuda_ad_mono")


# ---- counted by eye --------------------------------------------------------------------------


def test_da_counts_the_stamps_of_each_point_and_its_share_is_sda():
    E = reached_for([0, 1, 2, 3], stamps=4).assign_coords(x=("sensor", [0.0, 1.0, 2.0, 3.0]))
    DA = metrics.da(E)
    assert DA.values.tolist() == [0, 25, 50, 75]
    assert DA.x.values.tolist() == [0, 1, 2, 3]
    assert metrics.share_of_points(DA, 50.0) == metrics.sda(E) == 50.0


def test_cda_gives_partial_credit_up_to_the_threshold():
    E = series([[0, 150, 300, 9000], [300, 150, 300, 0]])
    assert metrics.cda(E).values.tolist() == [50, 50, 100, 50]
    assert metrics.cda(E, 600.0).values.tolist() == [25, 25, 50, 50]


def test_udi_puts_ties_on_the_useful_side():
    E = series([[99.9, 100, 300, 3000], [100, 299.9, 3000, 3000.1]])
    udi = metrics.udi(E)
    assert udi.dims == ("range", "sensor")
    assert udi.sel(range="fell short").values.tolist() == [50, 0, 0, 0]
    assert udi.sel(range="supplementary").values.tolist() == [50, 100, 0, 0]
    assert udi.sel(range="autonomous").values.tolist() == [0, 0, 100, 50]
    assert udi.sel(range="exceeded").values.tolist() == [0, 0, 0, 50]
    assert udi.sum("range").values.tolist() == [100] * 4
    assert metrics.share_of_points(udi.sel(range="autonomous"), 50.0) == 50.0


def test_hours_by_the_mean_and_at_the_worst_point():
    E = series([[300, 300], [600, 0], [599, 0], [90, 90], [89, 1000]])
    assert metrics.mean_hours(E) == 3.0
    assert metrics.mean_hours(E, step_hours=0.5) == 1.5
    assert metrics.worst_point_hours(E) == 3.0  # the second point; the first has four
    assert metrics.worst_point_hours(E, 300.0) == 2.0


def test_worst_point_is_one_point_not_the_darkest_of_every_hour():
    E = series([[0, 90], [90, 0], [90, 90]])
    assert metrics.worst_point_hours(E) == 2.0


def test_exposure_is_the_sum_of_lux_times_hours():
    E = series([[100, 0], [50, 10]])
    H = metrics.light_exposure(E, step_hours=0.5)
    assert H.values.tolist() == [75, 5]
    assert H.attrs["units"] == "lx h"


def test_uniformity_is_the_least_over_the_mean_and_nothing_in_the_dark():
    U = metrics.uniformity(series([[50, 150], [100, 100], [0, 0]]))
    assert U.values[:2].tolist() == [0.5, 1.0]
    assert np.isnan(U.values[2])


def test_sunlight_is_counted_by_day():
    direct = series([[1000, 0], [1, 0.9], [5000, 3]] * 12, "2015-02-01T22")
    hours = metrics.sunlight_hours(direct)
    assert hours.sizes == {"day": 3, "sensor": 2}
    assert hours.sel(day="2015-02-01").values.tolist() == [2, 0]
    assert hours.sel(day="2015-02-02").values.tolist() == [24, 8]
    assert metrics.sunlight_hours(direct, step_hours=0.5).values.sum() == hours.values.sum() / 2


def test_daylight_hours_are_those_with_most_diffuse_light():
    diffuse = xr.DataArray([0, 5, 9, 5, 5, 1], dims="time")
    chosen = metrics.daylight_hours(diffuse, hours=3)
    assert chosen.values.tolist() == [False, True, True, True, False, False]
    halves = metrics.daylight_hours(diffuse, hours=2, step_hours=0.5)
    assert halves.values.tolist() == [False, True, True, True, True, False]
    with pytest.raises(InputError, match="give a whole year, at least 4380 h"):
        metrics.daylight_hours(diffuse)


def test_daylight_hours_of_a_year_are_half_of_it():
    hour = np.arange(8760) % 24
    light = np.maximum(np.sin((hour - 6) / 12 * np.pi), 0) * 10_000
    chosen = metrics.daylight_hours(xr.DataArray(light, dims="time"))
    assert chosen.sum() == 4380
    assert set(hour[chosen.values]) <= set(range(6, 19))


def test_provision_is_what_a_share_of_the_room_has_in_half_of_the_hours():
    E = series(np.outer([1, 2, 3, 4], [100, 200, 300, 400]))  # the second highest counts
    assert metrics.median_illuminance(E).values.tolist() == [300, 600, 900, 1200]
    assert metrics.provision(E, 0.5) == 900
    assert metrics.provision(E, 0.51) == 600
    assert metrics.provision(E, 0.95) == metrics.provision(E, 1.0) == 300
    assert metrics.provision(E, 0.25, fraction=1.0) == 400


@pytest.mark.parametrize("area", [0.05, 0.5, 0.55, 0.95])
def test_provision_reaches_a_level_where_the_count_of_points_does(area):
    rng = np.random.default_rng(5)
    E = series(rng.lognormal(5.7, 0.6, (41, 100)) * rng.lognormal(0, 0.3, 100))
    levels = np.linspace(50, 1500, 60)
    by_count = [metrics.sda(E, level, 0.5) >= 100 * area for level in levels]
    assert [metrics.provision(E, area) >= level for level in levels] == by_count
    assert 0 < sum(by_count) < 60


def test_loops_in_plain_python_count_the_same():
    E = series(np.random.default_rng(9).lognormal(5.7, 1.5, (60, 7)))
    rows, columns = E.values.tolist(), E.values.T.tolist()
    udi = metrics.udi(E)
    for j, column in enumerate(columns):
        assert metrics.da(E).values[j] == 100 * sum(e >= 300 for e in column) / 60
        partial = sum(min(e / 300, 1) for e in column)
        assert metrics.cda(E).values[j] == pytest.approx(100 * partial / 60, rel=1e-12)
        assert metrics.light_exposure(E).values[j] == pytest.approx(sum(column), rel=1e-12)
        assert metrics.median_illuminance(E).values[j] == sorted(column)[30]
        useful = [100 <= e < 300 for e in column], [300 <= e <= 3000 for e in column]
        for name, hits in zip(("supplementary", "autonomous"), useful, strict=True):
            assert udi.sel(range=name).values[j] == 100 * sum(hits) / 60
    assert metrics.mean_hours(E) == sum(sum(row) / 7 >= 300 for row in rows)
    assert metrics.worst_point_hours(E) == min(sum(e >= 90 for e in c) for c in columns)


# ---- daylight factor --------------------------------------------------------------------------


def sensors(subdivision, *weights):
    """C of free sensors, whose bins have these weights [sr]."""
    labels = np.array([*Patches(subdivision).labels, "sun_2015-06-21T12:00"], dtype=object)
    C = np.column_stack([np.stack(weights), np.full(len(weights), 7.0)])
    return xr.DataArray(C, {"bin": labels}, ("sensor", "bin"))


def vertical(subdivision):
    """∫cos dΩ of every bin on a wall that faces south, by fine sums."""
    low, high, west, east = Patches(subdivision).bounds.T
    out = []
    for bounds in zip(low, high, west, east, strict=True):
        a = np.linspace(bounds[0], bounds[1], 401)
        t = np.linspace(bounds[2], bounds[3], 401)
        a, t = (a[1:] + a[:-1]) / 2, (t[1:] + t[:-1]) / 2
        cos = np.cos(a)[:, None] * np.maximum(-np.cos(t), 0) * np.cos(a)[:, None]
        out.append(cos.mean() * (bounds[1] - bounds[0]) * (bounds[3] - bounds[2]))
    return np.array(out)


@pytest.mark.parametrize("subdivision", [1, 2])
@pytest.mark.parametrize("kind", [1, 16])
def test_the_daylight_factor_of_a_free_horizontal_sensor_is_100(subdivision, kind):
    up = Patches(subdivision).projected_solid_angles.copy()
    up[0] = 0
    DF = metrics.daylight_factor(sensors(subdivision, up, up / 2), kind=kind)
    np.testing.assert_allclose(DF.values, [100, 50], rtol=1e-12)


def test_the_daylight_factor_of_a_wall_is_that_of_moon_and_spencer():
    """3/7 · (1/2 + 4/(3π)) = 39.6 % of the sky, and half of the ground's reflectance."""
    wall = vertical(4)
    sky = 300 / 7 * (1 / 2 + 4 / (3 * np.pi))
    for reflectance in (0.0, 0.2):
        DF = metrics.daylight_factor(sensors(4, wall), reflectance, kind=16)
        assert DF.values[0] == pytest.approx(sky + 50 * reflectance, abs=0.05)


def test_the_overcast_zenith_is_three_times_the_horizon():
    L = metrics.overcast_luminances(6, kind=16)
    assert L.values[-1] / L.values[1] == pytest.approx(3, rel=0.05)


def test_coefficients_of_no_whole_sky_are_refused():
    up = sensors(1, Patches(1).projected_solid_angles)
    for wrong, complaint in (
        (up.isel(bin=slice(0, 100)), "99 patches of a sky"),
        (up.isel(sensor=0), "give C of one state"),
        (up * np.nan, "NaN or infinite"),
    ):
        with pytest.raises(InputError, match=complaint):
            metrics.daylight_factor(wrong)
    with pytest.raises(InputError, match="give 1 or 16"):
        metrics.daylight_factor(up, kind=5)


# ---- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", CASE)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_and_infinity_are_refused(name, bad):
    E = series(np.full((4, 3), 200.0))
    E[1, 2] = bad
    with pytest.raises(InputError, match="1 of 12 are NaN or infinite"):
        CASE[name](E)
    with pytest.raises(InputError, match="exactly the dims time, sensor"):
        CASE[name](E.isel(time=0))


@pytest.mark.parametrize(
    "call",
    [
        lambda E: metrics.cda(E, 0.0),
        lambda E: metrics.udi(E, (300.0, 100.0, 3000.0)),
        lambda E: metrics.udi(E, (100.0, 300.0)),
        lambda E: metrics.sunlight_hours(E, 0.0),
        lambda E: metrics.provision(E, area=0.0),
        lambda E: metrics.provision(E, area=50),
        lambda E: metrics.median_illuminance(E, 0.0),
        lambda E: metrics.mean_hours(E, -1.0),
        lambda E: metrics.share_of_points(E, 50.0),
    ],
)
def test_thresholds_out_of_range_are_refused(call):
    with pytest.raises(InputError):
        call(series(np.full((4, 3), 200.0)))


# ---- smooth twins -----------------------------------------------------------------------------


def room(seed=1):
    rng = np.random.default_rng(seed)
    E = rng.uniform(60, 900, 50) * rng.lognormal(0, 0.6, (240, 50))
    for limit in (90, 100, 300, 3000):
        E[np.abs(E / limit - 1) < 1e-3] *= 1.01
    return series(E.astype(np.float32))


def twins(E, k):
    """Every twin beside its metric, as (soft, hard)."""
    soft = mi.TensorXf(E.values)
    return {
        "da": (smooth.da(soft, 300.0, sharpness=k), metrics.da(E)),
        "cda": (smooth.cda(soft, 300.0), metrics.cda(E)),
        "udi": (smooth.udi(soft, sharpness=k), metrics.udi(E)),
        "mean": (smooth.mean_hours(soft, 580.0, sharpness=k), metrics.mean_hours(E, 580.0)),
        "worst": (smooth.worst_point_hours(soft, sharpness=k), metrics.worst_point_hours(E)),
    }


def test_twins_tend_to_their_metrics():
    E = room()
    for name, (soft, hard) in twins(E, 1 << 16).items():
        hard = np.asarray(hard, float)
        assert np.ptp(hard) > 1 or 1 < hard < 239
        np.testing.assert_allclose(soft.numpy().reshape(hard.shape), hard, atol=2e-2, err_msg=name)


@pytest.mark.parametrize("name", ["da", "cda", "udi", "mean", "worst"])
def test_gradients_are_those_of_finite_differences(name):
    E = room()
    x = mi.TensorXf(E.values)
    dr.enable_grad(x)
    k, weights = 8, np.random.default_rng(2).random(200)

    def value(tensor):
        soft = {
            "da": lambda: smooth.da(tensor, 300.0, sharpness=k),
            "cda": lambda: smooth.cda(tensor, 300.0),
            "udi": lambda: smooth.udi(tensor, sharpness=k),
            "mean": lambda: smooth.mean_hours(tensor, 580.0, sharpness=k),
            "worst": lambda: smooth.worst_point_hours(tensor, sharpness=k),
        }[name]()
        flat = soft if isinstance(soft, mi.Float) else soft.array
        return dr.sum(flat * mi.Float(weights[: dr.width(flat)]))

    dr.backward(value(x))
    along = 1e-3 * np.random.default_rng(3).standard_normal(E.shape)
    ends = [
        value(mi.TensorXf((E.values * (1 + sign * along)).astype(np.float32)))[0]
        for sign in (1, -1)
    ]
    slope = 2 * (dr.grad(x).numpy() * E.values * along).sum()
    assert slope == pytest.approx(ends[0] - ends[1], rel=0.02, abs=2e-3)


# ---- intervals --------------------------------------------------------------------------------


def noisy(E, error, n=8, seed=0):
    """Replicates of E with relative noise of each sensor."""
    rng = np.random.default_rng(seed)
    factors = 1 + error * rng.standard_normal((n, 1, E.sizes["sensor"]))
    return xr.DataArray(E.values * factors, dims=("replicate", *E.dims), coords=E.coords)


def test_the_interval_of_an_exposure_is_that_of_students_t():
    from scipy.stats import t

    E = room()
    replicates = noisy(E, 0.05)
    out = intervals.interval_of(metrics.light_exposure, replicates, draws=600)
    H = replicates.sum("time").values
    half = t.ppf(0.975, 7) * H.std(axis=0, ddof=1) / np.sqrt(8)
    np.testing.assert_allclose(out["value"].values, H.mean(axis=0), rtol=1e-9)
    ratio = (out["high"] - out["low"]).values / 2 / half
    # The wider of the percentiles and their mirror images; 600 draws.
    assert 1.0 < ratio.mean() < 1.15


@pytest.mark.slow
def test_intervals_hold_the_truth_in_95_of_100_repetitions():
    E = room().isel(sensor=slice(0, 12))
    names = ("da", "cda", "mean_hours")

    def of_room(e):
        return xr.DataArray([float(np.mean(CASE[name](e))) for name in names], dims="metric")

    truth, held = of_room(E), np.zeros(len(names), int)
    for seed in range(60):
        replicates = noisy(E, 0.2, seed=seed)
        out = intervals.interval_of(of_room, replicates, draws=120, seed=seed)
        held += ((out["low"] <= truth) & (truth <= out["high"])).values
    assert (held / 60 >= 0.9).all(), held


def test_a_single_replicate_and_too_few_draws_are_refused():
    replicates = noisy(room(), 0.1)
    with pytest.raises(InputError, match="1 replicates"):
        intervals.interval_of(metrics.da, replicates.isel(replicate=[0]))
    with pytest.raises(InputError, match="from 40 to 600"):
        intervals.interval_of(metrics.da, replicates, draws=10)
