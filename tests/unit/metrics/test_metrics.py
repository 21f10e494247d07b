"""The metrics on series whose answer can be counted by eye, and what has to hold for any series."""

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from drcmitsuba import metrics
from drcmitsuba.metrics import thresholds
from drcmitsuba.runtime.errors import InputError

PROPERTY = settings(derandomize=True, deadline=None, max_examples=60)


def series(values, start="2015-01-01T08", step=60):
    """Array [time, sensor] with a stamp each `step` minutes."""
    values = np.asarray(values)
    time = np.datetime64(start, "ns") + np.arange(len(values)) * np.timedelta64(step, "m")
    return xr.DataArray(values, dims=("time", "sensor"), coords={"time": time})


def reached_for(counts, stamps, lux=300.0, step=60):
    """Sensors that have `lux` at their first `counts` of the stamps, and nothing after."""
    return series(np.where(np.arange(stamps)[:, None] < np.asarray(counts), lux, 0.0), step=step)


def working_year():
    """The five-day weeks of the EvalDRC calendar, 8 to 18 h, in 2015."""
    time = np.arange("2015-01-01", "2016-01-01", dtype="datetime64[h]")
    hour = (time - time.astype("datetime64[D]")).astype(int)
    return time[np.is_busday(time.astype("datetime64[D]")) & (hour >= 8) & (hour < 18)]


# ---- counted by eye --------------------------------------------------------------------------


def test_sda_counts_the_sensors_that_reach_half_the_time():
    assert metrics.sda(reached_for([0, 1, 2, 3], stamps=4)) == 50.0


def test_sda_with_other_thresholds():
    E = reached_for([0, 1, 2, 3], stamps=4, lux=500.0)
    assert metrics.sda(E, threshold=500.0, fraction=0.75) == 25.0
    assert metrics.sda(E, threshold=500.1, fraction=0.25) == 0.0


def test_ase_counts_the_sensors_with_too_many_hours():
    assert metrics.ase(reached_for([249, 250, 251, 0], stamps=300, lux=1000.0)) == 50.0
    assert metrics.ase(reached_for([249, 250, 251, 0], stamps=300, lux=999.9)) == 0.0


def test_ase_counts_hours_not_stamps():
    quarters = reached_for([999, 1000, 1001], stamps=1200, lux=1000.0, step=15)
    assert metrics.ase(quarters, step_hours=0.25) == pytest.approx(200 / 3)
    assert metrics.ase(quarters) == 100.0


def test_shade_closes_with_the_share_of_sensors_in_sun():
    direct = np.zeros((4, 50))
    direct[1, 7] = 1000.0
    direct[2, :2] = 999.0
    direct[3] = 5000.0
    closed = metrics.shade_closed(series(direct))
    assert closed.values.tolist() == [False, True, False, True]
    assert metrics.shade_closed(series(direct), area=0.03).values.tolist() == [0, 0, 0, 1]


def test_shade_keeps_the_coordinates_of_time_and_no_others():
    direct = series(np.zeros((3, 2))).assign_coords(x=("sensor", [0.0, 1.0]))
    direct = direct.assign_coords(clock=("time", direct.time.values + np.timedelta64(1, "h")))
    closed = metrics.shade_closed(direct.transpose("sensor", "time"))
    assert closed.dtype == bool
    assert closed.dims == ("time",)
    assert set(closed.coords) == {"time", "clock"}
    assert "units" not in closed.attrs


def test_months_are_counted_apart():
    january, march = np.full((4, 2), 300.0), np.full((4, 2), 300.0)
    march[:3, 1] = 0.0
    E = xr.concat([series(january), series(march, "2015-03-02T08")], "time")
    msda = metrics.msda(E)
    assert msda.dims == ("month",)
    assert msda.month.values.tolist() == list(range(1, 13))
    assert msda.sel(month=[1, 3]).values.tolist() == [100.0, 50.0]
    assert msda.isnull().sum() == 10
    assert metrics.sda(E) == 100.0


def test_clock_decides_the_month_where_there_is_one():
    E = series([[300.0], [0.0]], "2015-03-31T22").assign_coords(
        clock=("time", np.array(["2015-03-31T23", "2015-04-01T00"], "datetime64[ns]"))
    )
    assert metrics.msda(E).sel(month=[3, 4]).values.tolist() == [100.0, 0.0]
    assert metrics.msda(E.drop_vars("clock")).sel(month=3) == 100.0


def test_calendar_of_evaldrc():
    time = working_year()
    days = [22, 20, 22, 22, 21, 22, 23, 21, 22, 22, 21, 23]
    assert len(time) == 2610
    month = (time.astype("datetime64[M]") - np.datetime64("2015-01", "M")).astype(int)
    assert (np.bincount(month) / 10).tolist() == days

    # Sensor k is exposed in the first k stamps of each month: those with k >= T_m = 250 t_m / t_y.
    order = np.concatenate([np.arange(10 * n) for n in days])
    direct = np.where(order[:, None] < np.arange(1, 31), 1000.0, 0.0)
    mse = metrics.mse(xr.DataArray(direct, {"time": time}, ("time", "sensor")))
    first = [math.ceil(250 * 10 * n / 2610) for n in days]
    assert first == [22, 20, 22, 22, 21, 22, 23, 21, 22, 22, 21, 23]
    assert np.rint(mse.values * 30 / 100).astype(int).tolist() == [31 - k for k in first]


def test_monthly_equals_annual_where_all_months_are_equal():
    rng = np.random.default_rng(3)
    day = rng.uniform(0, 2000, (20, 30))
    months = [series(day, f"2015-{m:02}-01T00") for m in range(1, 13)]
    year = xr.concat(months, "time")
    assert 0 < metrics.sda(year, 900.0) < 100
    assert 0 < metrics.ase(year, hours=120.0) < 100
    assert (metrics.msda(year, 900.0) == metrics.sda(year, 900.0)).all()
    assert (metrics.mse(year, hours=120.0) == metrics.ase(year, hours=120.0)).all()


# ---- ties ------------------------------------------------------------------------------------


@pytest.mark.parametrize("stamps", [20, 100, 200, 3650])
@pytest.mark.parametrize("percent", [5, 7, 14, 29, 35, 50, 55, 56, 57, 58, 70, 95])
def test_tie_of_count_passes(percent, stamps):
    tie = -(-percent * stamps // 100)
    E = reached_for([tie - 1, tie], stamps)
    assert metrics.sda(E, fraction=percent / 100) == 50.0
    january = E.assign_coords(time=np.full(stamps, np.datetime64("2015-01-01", "ns")))
    assert metrics.msda(january, fraction=percent / 100).sel(month=1) == 50.0


def test_tie_that_floating_point_loses():
    assert 0.55 * 100 > 55  # the trap
    assert metrics.sda(reached_for([55], 100), fraction=0.55) == 100.0
    assert metrics.msda(reached_for([55], 100), fraction=0.55).sel(month=1) == 100.0


@pytest.mark.parametrize("minutes", [1, 5, 6, 10, 12, 15, 20, 30])
def test_tie_of_hours_passes_at_any_step(minutes):
    stamps = 7 * 60 // minutes
    direct = reached_for([stamps - 1, stamps], 2 * stamps, lux=1000.0, step=minutes)
    assert metrics.ase(direct, hours=7, step_hours=minutes / 60) == 50.0
    assert metrics.mse(direct, hours=7, step_hours=minutes / 60).sel(month=1) == 50.0


@pytest.mark.parametrize(("sensors", "area"), [(50, 0.02), (100, 0.07), (100, 0.29), (3, 1 / 3)])
def test_tie_of_area_closes_the_shade(sensors, area):
    n = round(sensors * area)
    direct = reached_for([2] * (n - 1) + [1] + [0] * (sensors - n), 2, lux=1000.0)
    assert metrics.shade_closed(direct, area=area).values.tolist() == [True, False]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_tie_of_illuminance_in_the_precision_of_the_array(dtype):
    E = series(np.full((2, 1), 300.3, dtype=dtype))
    assert metrics.sda(E, threshold=300.3) == 100.0
    assert metrics.sda(series(np.nextafter(E.values, dtype(0))), threshold=300.3) == 0.0


# ---- any series ------------------------------------------------------------------------------


@st.composite
def illuminances(draw):
    shape = draw(st.tuples(st.integers(1, 40), st.integers(1, 12)))
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    some = st.sampled_from([0.0, 299.0, 300.0, 999.0, 1000.0, 20000.0])
    start = draw(st.sampled_from(["2015-01-01T00", "2015-01-31T12", "2015-12-31T00"]))
    return series(draw(hnp.arrays(dtype, shape, elements=some)), start)


def all_metrics(E):
    monthly = [*metrics.msda(E).values, *metrics.mse(E, hours=3.0).values]
    return np.array([metrics.sda(E), metrics.ase(E, hours=3.0), *monthly])


@PROPERTY
@given(illuminances())
def test_within_bounds_and_nan_only_without_hours(E):
    result = all_metrics(E)
    assert np.nanmin(result) >= 0
    assert np.nanmax(result) <= 100
    without = ~np.isin(np.arange(1, 13), E.time.dt.month)
    assert np.isnan(result).tolist() == [False, False, *without, *without]


@PROPERTY
@given(illuminances(), st.floats(1.0, 5.0), st.floats(0.0, 500.0))
def test_more_light_never_lowers_a_metric(E, times, plus):
    brighter = E * E.dtype.type(times) + E.dtype.type(plus)
    more, less = all_metrics(brighter), all_metrics(E)
    assert (more >= less)[~np.isnan(less)].all()
    assert (metrics.shade_closed(brighter) >= metrics.shade_closed(E)).all()


@PROPERTY
@given(illuminances(), st.randoms(use_true_random=False))
def test_order_does_not_matter(E, random):
    sensors, stamps = list(range(E.sizes["sensor"])), list(range(E.sizes["time"]))
    random.shuffle(sensors)
    random.shuffle(stamps)
    expected = all_metrics(E)
    np.testing.assert_array_equal(all_metrics(E.isel(sensor=sensors)), expected)
    np.testing.assert_array_equal(all_metrics(E.isel(time=stamps)), expected)
    np.testing.assert_array_equal(all_metrics(E.transpose("sensor", "time")), expected)


def test_blocks_do_not_show(monkeypatch):
    E = series(np.random.default_rng(5).uniform(0, 2000, (100, 7)))
    whole, closed = all_metrics(E), metrics.shade_closed(E, area=0.6)
    monkeypatch.setattr(thresholds, "BLOCK", 20)
    np.testing.assert_array_equal(all_metrics(E), whole)
    xr.testing.assert_identical(metrics.shade_closed(E, area=0.6), closed)


# ---- bad input -------------------------------------------------------------------------------

METRICS = [metrics.sda, metrics.ase, metrics.msda, metrics.mse, metrics.shade_closed]


@pytest.mark.parametrize("metric", METRICS)
def test_bad_arrays_are_refused(metric):
    good = series(np.full((3, 2), 500.0))
    with pytest.raises(InputError, match="1 of 6 are NaN"):
        metric(good.where((good.sensor != 1) | (good.time.dt.hour != 9)))
    with pytest.raises(InputError, match="dims: time, sensor, channel"):
        metric(good.expand_dims(channel=3).transpose("time", "sensor", "channel"))
    with pytest.raises(InputError, match="dims: time;"):
        metric(good.isel(sensor=0))
    with pytest.raises(InputError, match="size"):
        metric(good.isel(time=[]))
    with pytest.raises(InputError, match="DataArray"):
        metric(good.values)
    with pytest.raises(InputError, match="dtype"):
        metric(good > 3)


@pytest.mark.parametrize("metric", [metrics.msda, metrics.mse])
def test_months_need_dates(metric):
    good = series(np.full((3, 2), 500.0))
    with pytest.raises(InputError, match="time: no dates"):
        metric(good.assign_coords(time=[0, 1, 2]))
    with pytest.raises(InputError, match="time: no dates"):
        metric(good.drop_vars("time"))
    with pytest.raises(InputError, match="clock: NaT"):
        metric(good.assign_coords(clock=("time", np.full(3, np.datetime64("NaT", "ns")))))


def test_thresholds_out_of_range_are_refused():
    good = series(np.full((3, 2), 500.0))
    for metric, field, value in [
        (metrics.sda, "fraction", 50),
        (metrics.msda, "fraction", -0.1),
        (metrics.sda, "threshold", math.nan),
        (metrics.ase, "hours", math.inf),
        (metrics.mse, "step_hours", 0.0),
        (metrics.shade_closed, "area", 2.0),
        (metrics.shade_closed, "threshold", -1.0),
    ]:
        with pytest.raises(InputError, match=f"{field}: {value}"):
            metric(good, **{field: value})


# ---- intervals -------------------------------------------------------------------------------
